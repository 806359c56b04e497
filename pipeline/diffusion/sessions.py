"""Networks as plain callables on numpy arrays.

Each function opens one graph folder of a bundle (`<bundle>/unet` and so on) for the length of a
`with` block and releases it, and its memory, at the end:

    with denoiser(bundle / "unet") as denoise:
        output = denoise(latents, timesteps, text)

What exporters disagree about is settled by the graph's own signature (`graphs`): a batch or a timestep
that the graph fixes is served by several calls. Latents outside are multiplied by the
bundle's latent scale, graphs want them plain: the scaling happens here. `provider` is what onnxruntime
runs on, a name of `providers.PROVIDERS`. Letters: b batch, l tokens,
d text width, c latent channels, h and w latent pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from pipeline.diffusion.bundle import graph_scale
from pipeline.diffusion.graphs import Array, open_graph, usable_threads
from pipeline.errors import InputError

EncodeText: TypeAlias = Callable[[Int[Array, "b l"]], Float[Array, "b l d"]]
Denoise: TypeAlias = Callable[
    [Float[Array, "b c h w"], Int[Array, " b"], Float[Array, "b l d"]], Float[Array, "b c h w"]
]


@runtime_checkable
class TellCamera(Protocol):
    """A `Denoise` that can be told the cameras of its rows as well, k columns each."""

    def __call__(
        self,
        sample: Float[Array, "b c h w"],
        timesteps: Int[Array, " b"],
        text: Float[Array, "b l d"],
        camera: Float[Array, "b k"] | None = None,
        /,
    ) -> Float[Array, "b c h w"]:
        """Return the raw output; without cameras the network is told none."""
        ...


Decode: TypeAlias = Callable[[Float[Array, "b c h w"]], Float[Array, "b H W 3"]]
Encode: TypeAlias = Callable[[Float[Array, "b H W 3"]], Float[Array, "b c h w"]]
PullBack: TypeAlias = Callable[[Float[Array, "b H W 3"], Float[Array, "b c h w"]], Float[Array, "b H W 3"]]

GUIDANCE_WIDTH, LCM_GUIDANCE = 256, 7.5
LANE_ROWS = 4
"""Eight rows of the default bundle take 14 % less time as four on each of two threads, with the same bits."""


def guidance_embedding(guidance: float, width: int) -> Float[Array, " w"]:
    """Return how a latent consistency model is told its guidance w: sines and cosines of 1000 w.

    Luo et al. 2023, "Latent consistency models", section 4.2.
    Such a model has guidance inside, so train it with guidance_scale 1. As diffusers' pipeline has it, w is
    the guidance scale less 1: 7.5 is its 8.5.
    """
    frequencies = np.exp(-np.log(10000.0) * np.arange(width // 2) / (width // 2 - 1))
    phases = 1000.0 * guidance * frequencies
    return np.pad(np.concatenate([np.sin(phases), np.cos(phases)]), (0, width % 2)).astype(np.float32)


@contextmanager
def text_encoder(
    folder: Path, token_embeddings: Float[Array, "n d"] | None = None, provider: str = "cpu"
) -> Iterator[EncodeText]:
    """Give encode_text: token ids (b, l) -> last hidden states (b, l, d), one row at a time.

    `token_embeddings`: learnt rows after the vocabulary's own; the id vocabulary size + i picks row i.
    Raises InputError when there are some and the graph cannot take them.
    """
    with open_graph(folder, provider=provider) as graph:
        takes_rows = "token_embeddings" in graph.types
        width = graph.axis("token_embeddings", 1)
        if token_embeddings is not None and not takes_rows:
            raise InputError(
                f"{graph.path}: takes no learnt token (no input token_embeddings); export its checkpoint "
                "with make export"
            )
        if token_embeddings is not None and width not in (None, token_embeddings.shape[1]):
            raise InputError(
                f"{graph.path}: its tokens have {width} numbers, the learnt one has "
                f"{token_embeddings.shape[1]}; use a token learnt for this kind of model"
            )
        # A graph has no optional inputs: without a learnt token it gets a row that no id picks.
        rows = np.zeros((1, width or 1), np.float32) if token_embeddings is None else token_embeddings

        def encode_text(input_ids: Int[Array, "b l"]) -> Float[Array, "b l d"]:
            outputs = [graph.run({"input_ids": row[None], "token_embeddings": rows}) for row in input_ids]
            return np.concatenate([graph.pick(output, ("last_hidden_state",), 3) for output in outputs])

        yield encode_text


@contextmanager
def denoiser(
    folder: Path, threads: int | None = None, provider: str = "cpu", rows_expected: int = 1, views: int = 1
) -> Iterator[TellCamera]:
    """Give denoise: latents (b, c, h, w), timesteps (b,), text (b, l, d) -> raw network output (b, c, h, w).

    A fourth argument, cameras (b, k), goes to a graph that takes `camera`; without it such a graph is told
    nothing (zeros). `views` consecutive rows are never parted, b is a multiple of it.

    One run of the network where the graph allows it; one for each distinct timestep where its
    timestep is a scalar; blocks of its own size where its batch is fixed.
    `rows_expected`: b of most calls. When it gives every thread `LANE_ROWS`, each thread runs its own share
    of the rows, and they need not wait for each other in every operator.
    """
    threads = usable_threads() if threads is None else threads
    lanes = threads if provider == "cpu" and rows_expected >= LANE_ROWS * threads else 1
    with open_graph(folder, threads // lanes, provider) as graph, ThreadPoolExecutor(lanes) as pool:
        share = pool.map if lanes > 1 else map
        one_timestep = graph.rank("timestep") == 0 or graph.axis("timestep", 0) == 1
        fixed = graph.axis("sample", 0)

        width = graph.axis("camera", 1) or 0

        def call(sample: Array, timesteps: Array, text: Array, camera: Array | None) -> Array:
            rows = np.arange(len(sample))
            if fixed is not None:  # fill a fixed batch up with copies, drop them after
                rows = np.minimum(np.arange(fixed), len(sample) - 1)
            timestep = timesteps[rows]
            if one_timestep:
                timestep = timestep[:1].reshape((1,) * (graph.rank("timestep") or 0))
            feeds = {"sample": sample[rows], "timestep": timestep, "encoder_hidden_states": text[rows]}
            if "camera" in graph.types:
                feeds["camera"] = np.zeros((len(rows), width), np.float32) if camera is None else camera[rows]
            if "timestep_cond" in graph.types:
                size = graph.axis("timestep_cond", 1) or GUIDANCE_WIDTH
                feeds["timestep_cond"] = np.tile(guidance_embedding(LCM_GUIDANCE, size), (len(rows), 1))
            when = f" at timestep {', '.join(map(str, np.unique(timesteps)))}"
            return graph.pick(graph.run(feeds), ("out_sample", "sample"), 4, when)[: len(sample)]

        def denoise(
            sample: Float[Array, "b c h w"],
            timesteps: Int[Array, " b"],
            text: Float[Array, "b l d"],
            camera: Float[Array, "b k"] | None = None,
        ) -> Float[Array, "b c h w"]:
            groups = [np.arange(len(sample))]
            if one_timestep:
                groups = [np.flatnonzero(timesteps == t) for t in np.unique(timesteps)]
            size = fixed or -(-len(sample) // (lanes * views)) * views
            blocks = [rows[start : start + size] for rows in groups for start in range(0, len(rows), size)]
            result = np.empty(sample.shape, np.float32)
            told = [None if camera is None else camera[rows] for rows in blocks]
            found = share(
                lambda rows, seen: call(sample[rows], timesteps[rows], text[rows], seen), blocks, told
            )
            for rows, values in zip(blocks, found, strict=True):
                result[rows] = values
            return result

        yield denoise


@contextmanager
def vae_decoder(folder: Path, latent_scale: float | None = None, provider: str = "cpu") -> Iterator[Decode]:
    """Give decode: scaled latents (b, c, h, w) -> images (b, H, W, 3) in [0, 1], one image at a time.

    `latent_scale`: None reads it from the folder's config.json (else Stable Diffusion's 0.18215).
    """
    scale = graph_scale(folder) if latent_scale is None else latent_scale
    with open_graph(folder, provider=provider) as graph:

        def decode(latents: Float[Array, "b c h w"]) -> Float[Array, "b H W 3"]:
            images = []
            for index in range(len(latents)):
                outputs = graph.run({"latent_sample": latents[index : index + 1] / np.float32(scale)})
                image = graph.pick(outputs, ("sample",), 4, f" for image {index}")
                images.append(np.clip(image[0].transpose(1, 2, 0) / 2 + 0.5, 0.0, 1.0))
            return np.stack(images)

        yield decode


@contextmanager
def vae_encoder(folder: Path, latent_scale: float | None = None, provider: str = "cpu") -> Iterator[Encode]:
    """Give encode: images (b, H, W, 3) in [0, 1] -> scaled latents (b, c, h, w), one image at a time.

    The mean, where the graph gives mean and log-variance (`latent_parameters`, 2c channels); a sample
    where it draws one itself (`latent_sample`, c channels). `latent_scale` as in `vae_decoder`.
    """
    scale = graph_scale(folder) if latent_scale is None else latent_scale
    with open_graph(folder, provider=provider) as graph:

        def encode(images: Float[Array, "b H W 3"]) -> Float[Array, "b c h w"]:
            latents = []
            for index in range(len(images)):
                image = images[index : index + 1].transpose(0, 3, 1, 2) * 2 - 1
                outputs = graph.run({"sample": image})
                value = graph.pick(outputs, ("latent_parameters", "latent_sample"), 4, f" for image {index}")
                is_moments = "latent_parameters" in outputs or value.shape[1] == 8
                latents.append(value[0, : value.shape[1] // 2] if is_moments else value[0])
            return np.stack(latents) * np.float32(scale)

        yield encode


@contextmanager
def vae_encoder_vjp(
    folder: Path, latent_scale: float | None = None, provider: str = "cpu"
) -> Iterator[PullBack]:
    """Give pull_back: images (b, H, W, 3) in [0, 1], gradient of scaled latents (b, c, h, w) -> of images.

    The input gradient of `vae_encoder` (of its mean) with the same scalings inside, one image at a time.
    `latent_scale` as in `vae_decoder`. The graph is this project's own (export/encoder_vjp.py).
    """
    scale = graph_scale(folder) if latent_scale is None else latent_scale
    with open_graph(folder, provider=provider) as graph:

        def pull_back(
            images: Float[Array, "b H W 3"], cotangent: Float[Array, "b c h w"]
        ) -> Float[Array, "b H W 3"]:
            gradients = []
            for index in range(len(images)):
                image = images[index : index + 1].transpose(0, 3, 1, 2) * 2 - 1
                outputs = graph.run({"sample": image, "cotangent": cotangent[index : index + 1]})
                value = graph.pick(outputs, ("gradient",), 4, f" for image {index}")
                gradients.append(value[0].transpose(1, 2, 0))
            # The graph takes pictures in [-1, 1], twice as steep, and gives latents without the scale.
            return np.stack(gradients) * np.float32(2 * scale)

        yield pull_back
