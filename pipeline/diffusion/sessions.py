"""Networks as plain callables on numpy arrays; the only module that imports onnxruntime.

Each function opens one graph folder of a bundle (`<bundle>/unet` and so on) for the length of a
`with` block and releases it, and its memory, at the end:

    with denoiser(bundle / "unet") as denoise:
        output = denoise(latents, timesteps, text)

Exporters disagree about names, types and ranks (Optimum, diffusers' script, Olive). The graph's own
signature decides: every feed is cast to it, inputs that the graph lacks are dropped, a batch or a
timestep that the graph fixes is served by several calls. Latents outside are multiplied by the
bundle's latent scale, graphs want them plain: the scaling happens here. Letters: b batch, l tokens,
d text width, c latent channels, h and w latent pixels.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float, Int

from pipeline.diffusion.bundle import check_graph, graph_scale
from pipeline.diffusion.onnx_file import OnnxFile
from pipeline.errors import InputError

Array: TypeAlias = np.ndarray
EncodeText: TypeAlias = Callable[[Int[Array, "b l"]], Float[Array, "b l d"]]
Denoise: TypeAlias = Callable[
    [Float[Array, "b c h w"], Int[Array, " b"], Float[Array, "b l d"]], Float[Array, "b c h w"]
]
Decode: TypeAlias = Callable[[Float[Array, "b c h w"]], Float[Array, "b H W 3"]]
Encode: TypeAlias = Callable[[Float[Array, "b H W 3"]], Float[Array, "b c h w"]]
PullBack: TypeAlias = Callable[[Float[Array, "b H W 3"], Float[Array, "b c h w"]], Float[Array, "b H W 3"]]

_DTYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(int32)": np.int32,
    "tensor(int64)": np.int64,
    "tensor(bool)": np.bool_,
}
# No network of a working bundle comes near this; a flipped exponent bit in a weight passes it.
LARGEST_OUTPUT = 1e6


class Graph:
    """One open ONNX graph: `run` casts named feeds to its signature and returns named float32 outputs."""

    def __init__(self, outline: OnnxFile, threads: int | None = None) -> None:
        import onnxruntime

        path = outline.path

        options = onnxruntime.SessionOptions()
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_ALL
        options.intra_op_num_threads = _threads() if threads is None else threads
        # Without this, onnxruntime's idle threads spin and take the cores from torch and numba.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = (
            4  # faults arrive as exceptions; its log would repeat them on the terminal
        )
        onnxruntime.set_seed(0)  # a VAE encoder that samples in the graph must repeat itself
        self.path = path
        try:
            self.session: Any = onnxruntime.InferenceSession(
                str(path), sess_options=options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:
            # onnxruntime's exceptions share no base class but Exception.
            raise InputError(f"{path}: {explain_load_error(str(error))}") from error
        # onnxruntime's shapes do not tell a scalar from an input of unknown rank; the file does.
        self.shapes = {name: port.shape for name, port in outline.inputs.items()}
        self.types = {port.name: port.type for port in self.session.get_inputs()}
        self.outputs = [port.name for port in self.session.get_outputs()]

    def axis(self, name: str, axis: int) -> int | None:
        """Return the size that the graph fixes for an axis of an input, None where any size will do."""
        shape = self.shapes.get(name) or ()
        return shape[axis] if axis < len(shape) else None

    def rank(self, name: str) -> int | None:
        """Return the number of axes of an input, None when the graph lacks it or takes any number."""
        shape = self.shapes.get(name)
        return None if shape is None else len(shape)

    def run(self, feeds: dict[str, Array]) -> dict[str, Array]:
        """Run once, dropping feeds that the graph lacks. Raises InputError for an input without a feed."""
        if missing := [name for name in self.types if name not in feeds]:
            raise InputError(
                f"{self.path}: wants the input(s) {', '.join(missing)}, this program has {', '.join(feeds)}; "
                "export the model with the usual inputs"
            )
        cast = {name: self._cast(name, feeds[name]) for name in self.types}
        values = self.session.run(self.outputs, cast)
        return {name: np.asarray(value, np.float32) for name, value in zip(self.outputs, values, strict=True)}

    def _cast(self, name: str, value: Array) -> Array:
        kind, shape = self.types[name], self.shapes.get(name)
        if kind not in _DTYPES:
            raise InputError(f"{self.path}: input {name} is {kind}, expected one of {', '.join(_DTYPES)}")
        if not np.isfinite(value).all():
            raise FloatingPointError(
                f"{self.path}: the input {name} holds NaN or infinity before the network runs"
            )
        value = np.asarray(value, _DTYPES[kind], order="C")
        if shape is None:
            return value
        if value.ndim != len(shape):
            raise InputError(f"{self.path}: input {name} has {len(shape)} axes, expected {value.ndim}")
        for axis, (found, wanted) in enumerate(zip(value.shape, shape, strict=True)):
            if wanted is not None and wanted != found:
                raise InputError(
                    f"{self.path}: input {name} is fixed to {wanted} on axis {axis}, here it is {found}; "
                    "use that size, or export the model with a free one"
                )
        return value

    def pick(self, outputs: dict[str, Array], names: tuple[str, ...], rank: int, when: str = "") -> Array:
        """Return the output with one of `names`, or the only one of that rank, checked to be sane."""
        name = next((name for name in names if name in outputs), None)
        if name is None:
            fitting = [name for name, value in outputs.items() if value.ndim == rank]
            if len(fitting) != 1:
                raise InputError(
                    f"{self.path}: its outputs are {', '.join(outputs)}, expected {' or '.join(names)}; "
                    "export the model with the usual names"
                )
            name = fitting[0]
        value = outputs[name]
        largest = float(np.abs(value).max(initial=0.0))
        if not largest < LARGEST_OUTPUT:  # NaN compares false
            what = f"values up to {largest:.1e}" if np.isfinite(largest) else "NaN or infinity"
            raise InputError(
                f"{self.path}: the output {name} holds {what}{when}, expected finite values below "
                f"{LARGEST_OUTPUT:.0e}; the weights are damaged or overflow fp16: copy or export them again"
            )
        return value


def _threads() -> int:
    """Cores this process may use; OMP_NUM_THREADS lowers it, as for torch and numpy."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    wished = os.environ.get("OMP_NUM_THREADS", "")
    return min(cores, int(wished)) if wished.isdigit() and int(wished) > 0 else cores


def explain_load_error(message: str) -> str:
    """Return in plain words, one line, what onnxruntime says when it cannot load a model."""
    operator = re.search(
        r"No Op registered for (\w+)|(\S+)\(-?\d+\) is not a registered|implementation for (\w+)", message
    )
    if operator:
        name = next(group for group in operator.groups() if group)
        return (
            f"needs the operator {name}, which onnxruntime's CPU provider lacks; export it with standard ones"
        )
    if "Opset" in message or "IR version" in message:
        return "newer than this onnxruntime understands; export it at opset 20, or update onnxruntime"
    if "external" in message.lower():
        return (
            "its external weights are missing, too short or outside its folder; copy the whole folder again"
        )
    if "Protobuf parsing failed" in message or "raw_data size" in message:
        return "damaged or no ONNX model; copy or export the file again"
    reason = " ".join(
        re.sub(r"^.*?failed:|^\[ONNXRuntimeError\] : \d+ : \w+ : ", "", message, count=1).split()
    )
    return f"onnxruntime cannot load it ({reason[:300]}); export the model again"


@contextmanager
def open_graph(folder: Path, threads: int | None = None) -> Iterator[Graph]:
    """Open `folder/model.onnx` (checked first), give the Graph, and release its session at the end.

    `threads`: intra-op threads; None is every core this process may use. Raises InputError with the
    file's name when it is missing, damaged or not loadable.
    """
    graph = Graph(check_graph(folder), threads)
    try:
        yield graph
    finally:
        del graph.session  # frees the weights now, not when the last closure goes


@contextmanager
def text_encoder(folder: Path, token_embeddings: Float[Array, "n d"] | None = None) -> Iterator[EncodeText]:
    """Give encode_text: token ids (b, l) -> last hidden states (b, l, d), one row at a time.

    `token_embeddings`: learnt rows after the vocabulary's own; the id vocabulary size + i picks row i.
    Raises InputError when there are some and the graph cannot take them.
    """
    with open_graph(folder) as graph:
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
def denoiser(folder: Path, threads: int | None = None) -> Iterator[Denoise]:
    """Give denoise: latents (b, c, h, w), timesteps (b,), text (b, l, d) -> raw network output (b, c, h, w).

    One call to the network where the graph allows it; one for each distinct timestep where its
    timestep is a scalar; blocks of its own size where its batch is fixed.
    """
    with open_graph(folder, threads) as graph:
        one_timestep = graph.rank("timestep") == 0 or graph.axis("timestep", 0) == 1
        fixed = graph.axis("sample", 0)

        def call(sample: Array, timesteps: Array, text: Array) -> Array:
            rows = np.arange(len(sample))
            if fixed is not None:  # fill a fixed batch up with copies, drop them after
                rows = np.minimum(np.arange(fixed), len(sample) - 1)
            timestep = timesteps[rows]
            if one_timestep:
                timestep = timestep[:1].reshape((1,) * (graph.rank("timestep") or 0))
            feeds = {"sample": sample[rows], "timestep": timestep, "encoder_hidden_states": text[rows]}
            when = f" at timestep {', '.join(map(str, np.unique(timesteps)))}"
            return graph.pick(graph.run(feeds), ("out_sample", "sample"), 4, when)[: len(sample)]

        def denoise(
            sample: Float[Array, "b c h w"], timesteps: Int[Array, " b"], text: Float[Array, "b l d"]
        ) -> Float[Array, "b c h w"]:
            groups = [np.arange(len(sample))]
            if one_timestep:
                groups = [np.flatnonzero(timesteps == t) for t in np.unique(timesteps)]
            size = fixed or len(sample)
            blocks = [rows[start : start + size] for rows in groups for start in range(0, len(rows), size)]
            result = np.empty(sample.shape, np.float32)
            for rows in blocks:
                result[rows] = call(sample[rows], timesteps[rows], text[rows])
            return result

        yield denoise


@contextmanager
def vae_decoder(folder: Path, latent_scale: float | None = None) -> Iterator[Decode]:
    """Give decode: scaled latents (b, c, h, w) -> images (b, H, W, 3) in [0, 1], one image at a time.

    `latent_scale`: None reads it from the folder's config.json (else Stable Diffusion's 0.18215).
    """
    scale = graph_scale(folder) if latent_scale is None else latent_scale
    with open_graph(folder) as graph:

        def decode(latents: Float[Array, "b c h w"]) -> Float[Array, "b H W 3"]:
            images = []
            for index in range(len(latents)):
                outputs = graph.run({"latent_sample": latents[index : index + 1] / np.float32(scale)})
                image = graph.pick(outputs, ("sample",), 4, f" for image {index}")
                images.append(np.clip(image[0].transpose(1, 2, 0) / 2 + 0.5, 0.0, 1.0))
            return np.stack(images)

        yield decode


@contextmanager
def vae_encoder(folder: Path, latent_scale: float | None = None) -> Iterator[Encode]:
    """Give encode: images (b, H, W, 3) in [0, 1] -> scaled latents (b, c, h, w), one image at a time.

    The mean, where the graph gives mean and log-variance (`latent_parameters`, 2c channels); a sample
    where it draws one itself (`latent_sample`, c channels). `latent_scale` as in `vae_decoder`.
    """
    scale = graph_scale(folder) if latent_scale is None else latent_scale
    with open_graph(folder) as graph:

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
def vae_encoder_vjp(folder: Path, latent_scale: float | None = None) -> Iterator[PullBack]:
    """Give pull_back: images (b, H, W, 3) in [0, 1], gradient of scaled latents (b, c, h, w) -> of images.

    The input gradient of `vae_encoder` (of its mean) with the same scalings inside, one image at a time.
    `latent_scale` as in `vae_decoder`. The graph is this project's own (export/encoder_vjp.py).
    """
    scale = graph_scale(folder) if latent_scale is None else latent_scale
    with open_graph(folder) as graph:

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
