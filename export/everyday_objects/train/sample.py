"""Look at what a model paints: a sheet of samples, one prompt a row, one view a column.

`python -m export.everyday_objects.train.sample OUT.png FOLDER "a red armchair" "a blue car"`, FOLDER a
bundle, or the WORK of a training, whose averaged weights are taken. The views of a row are made together,
each told its camera.
"""

import argparse
import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from PIL import Image

from export.everyday_objects.networks.autoencoder import Decoder
from export.everyday_objects.train.batches import TIMESTEPS
from export.everyday_objects.train.loss import BETAS, Model
from pipeline.diffusion import sessions
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.prompts import view_words
from pipeline.diffusion.schedule import Schedule
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.diffusion.view_gradient import told_cameras

AZIMUTHS, POLAR, DISTANCE, FOV = (25.0, 115.0, 205.0, 295.0), 72.0, 2.5, 39.5
"""Of the views [deg, scene units]."""
GREY = 0.8
"""Of the backdrop."""


class Painter(NamedTuple):
    """A model as functions on arrays."""

    encode_text: Callable[[list[str]], np.ndarray]
    """Captions to embeddings (n, l, d)"""
    denoise: Callable[..., np.ndarray]
    """Latents, timesteps, embeddings and cameras (see `pipeline.diffusion.sessions.TellCamera`) to v"""
    decode: sessions.Decode
    backdrop: np.ndarray
    """(4,) latents of the grey backdrop"""
    size: int
    """Side of the latents"""


def ddim(
    denoise: sessions.Denoise,
    schedule: Schedule,
    cond: np.ndarray,
    uncond: np.ndarray,
    size: int,
    guidance: float,
    steps: int,
    seed: int,
) -> np.ndarray:
    """DDIM without fresh noise (Song et al. 2020) from noise to latents (b, 4, size, size)."""
    x = np.random.default_rng(seed).standard_normal((len(cond), 4, size, size)).astype(np.float32)
    timesteps = np.linspace(len(schedule.alphas_cumprod) - 1, 0, steps + 1).round().astype(np.int64)
    for now, after in itertools.pairwise(timesteps):
        t = np.full(len(cond), now)
        without, told = denoise(x, t, np.broadcast_to(uncond, cond.shape)), denoise(x, t, cond)
        output = without + guidance * (told - without)
        clean, noise = schedule.to_clean(output, x, t), schedule.to_epsilon(output, x, t)
        x = schedule.add_noise(clean, noise, np.full(len(cond), after))
    return x


def default_schedule() -> Schedule:
    """Return the schedule that the model is trained on."""
    betas = np.linspace(BETAS[0] ** 0.5, BETAS[1] ** 0.5, TIMESTEPS) ** 2
    return Schedule(np.cumprod(1 - betas), "v_prediction")


@contextmanager
def of_bundle(folder: Path) -> Iterator[Painter]:
    """Give the painter of an exported bundle."""
    bundle, tokenizer = open_bundle(folder), load_tokenizer(folder / "tokenizer")
    with (
        sessions.text_encoder(folder / "text_encoder") as encode_text,
        sessions.denoiser(folder / "unet", views=bundle.views) as denoise,
        sessions.vae_decoder(folder / "vae_decoder", bundle.latent_scale) as decode,
        sessions.vae_encoder(folder / "vae_encoder", bundle.latent_scale) as encode,
    ):
        flat = encode(np.full((1, bundle.image_size, bundle.image_size, 3), GREY, np.float32))[0]

        def encode_texts(texts: list[str]) -> np.ndarray:
            return encode_text(np.stack([tokenizer.encode(t) for t in texts]))

        yield Painter(encode_texts, denoise, decode, flat.mean((1, 2)), bundle.latent_size)


@contextmanager
def of_training(work: Path, state: str = "denoiser") -> Iterator[Painter]:
    """Give the painter of a training's averaged weights."""
    from export.everyday_objects.data.pictures import encode, load_encoder

    model = Model(load_tokenizer(work / "tokenizer"))
    model.load_state_dict(torch.load(work / f"{state}.pt", weights_only=True, map_location="cpu"))
    decoder = Decoder()
    decoder.load_state_dict(torch.load(work / "autoencoder.pt", weights_only=True)["decoder"])

    @torch.inference_mode()
    def encode_text(texts: list[str]) -> np.ndarray:
        ids = torch.from_numpy(np.stack([model.tokenizer.encode(t) for t in texts]))
        return model.text_encoder(ids).numpy()

    @torch.inference_mode()
    def denoise(x: np.ndarray, t: np.ndarray, text: np.ndarray, camera: np.ndarray | None) -> np.ndarray:
        with torch.autocast("cpu", torch.bfloat16, enabled=torch.cpu._is_avx512_bf16_supported()):
            inputs = (torch.from_numpy(np.ascontiguousarray(v)) for v in (x, t, text, camera))
            return model.denoiser(*inputs).float().numpy()

    @torch.inference_mode()
    def decode(latents: np.ndarray) -> np.ndarray:
        return decoder(torch.from_numpy(latents)).clamp(0, 1).permute(0, 2, 3, 1).numpy()

    flat = encode(load_encoder(work), np.full((1, 16, 16, 3), GREY, np.float32))[0, :, 1, 1].astype(
        np.float32
    )
    yield Painter(encode_text, denoise, decode, flat, 32)


def paint(
    painter: Painter, prompts: list[str], guidance: float = 4.0, steps: int = 25, seed: int = 0
) -> np.ndarray:
    """Return pictures (n, views, p, p, 3) in [0, 1] of prompts."""
    uncond = painter.encode_text([""])[0]
    row = [
        [1, np.radians(a), np.radians(POLAR), DISTANCE, np.radians(FOV), 1, *painter.backdrop]
        for a in AZIMUTHS
    ]
    cameras = np.array(row, np.float32)
    pictures = []
    for i, prompt in enumerate(prompts):
        texts = [f"{prompt}, {view_words('eight', float(c[1]), float(c[2]))}" for c in cameras]
        denoise, cond = told_cameras(painter.denoise, cameras), painter.encode_text(texts)
        latents = ddim(denoise, default_schedule(), cond, uncond, painter.size, guidance, steps, seed + i)
        pictures.append(painter.decode(latents))
    return np.stack(pictures)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("picture", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("prompts", nargs="+")
    parser.add_argument("--guidance", type=float, default=4.0)
    parser.add_argument("--steps", type=int, default=25)
    parser.add_argument("--columns", type=int, default=2, help="prompts beside each other")
    options = parser.parse_args()
    source = of_bundle if (options.folder / "bundle.json").exists() else of_training
    with source(options.folder) as painter:
        pictures = paint(painter, options.prompts, options.guidance, options.steps)
    rows = [np.concatenate(list(views), axis=1) for views in pictures]
    rows += [np.ones_like(rows[0])] * (-len(rows) % options.columns)
    lines = [np.concatenate(rows[i : i + options.columns], 1) for i in range(0, len(rows), options.columns)]
    Image.fromarray(np.round(np.concatenate(lines) * 255).astype(np.uint8)).save(options.picture)


if __name__ == "__main__":
    main()
