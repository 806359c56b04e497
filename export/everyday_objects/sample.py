"""Look at what the exported model paints: a sheet of samples, one prompt a row, one view a column.

`python -m export.everyday_objects.sample OUT.png "a red armchair" "a blue car" [--folder BUNDLE]`
"""

import argparse
import itertools
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.diffusion import sessions
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.schedule import Schedule, load_schedule
from pipeline.diffusion.tokenizer import load_tokenizer

VIEWS = (
    "front view",
    "front left view",
    "left side view",
    "back view",
    "right side view",
    "overhead front view",
)


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


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("picture", type=Path)
    parser.add_argument("prompts", nargs="+")
    parser.add_argument("--folder", type=Path, default=Path("onnx_models/everyday-objects"))
    parser.add_argument("--guidance", type=float, default=5.0)
    parser.add_argument("--steps", type=int, default=25)
    options = parser.parse_args()
    bundle = open_bundle(options.folder)
    schedule = load_schedule(options.folder / "scheduler")
    tokenizer = load_tokenizer(options.folder / "tokenizer")
    texts = [f"{p}, {v}" for p in options.prompts for v in VIEWS]
    with sessions.text_encoder(options.folder / "text_encoder") as encode_text:
        embeddings = encode_text(np.stack([tokenizer.encode(t) for t in ["", *texts]]))
    with sessions.denoiser(options.folder / "unet") as denoise:
        latents = ddim(
            denoise,
            schedule,
            embeddings[1:],
            embeddings[0],
            bundle.latent_size,
            options.guidance,
            options.steps,
            0,
        )
    with sessions.vae_decoder(options.folder / "vae_decoder", bundle.latent_scale) as decode:
        images = decode(latents)
    rows = images.reshape(len(options.prompts), len(VIEWS), *images.shape[1:])
    sheet = np.concatenate([np.concatenate(list(row), axis=1) for row in rows], axis=0)
    Image.fromarray(np.round(np.clip(sheet, 0, 1) * 255).astype(np.uint8)).save(options.picture)


if __name__ == "__main__":
    main()
