"""Score distillation as a scene sees it: rendered latents and their views in, a gradient out.

Letters: b views a step, h x w latent pixels, v view texts of l tokens of width d, k flat backgrounds.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pipeline import arrays
from pipeline.diffusion.distillation import sds_gradient
from pipeline.diffusion.prompts import view_index
from pipeline.diffusion.schedule import Schedule
from pipeline.diffusion.sessions import Denoise
from pipeline.errors import InputError
from pipeline.scene.batch import Batch, Guidance

_DEFAULT_GREY = 2 / 3


class Embeddings(NamedTuple):
    """What stage `embed` wrote."""

    cond: Float[np.ndarray, "v l d"]
    uncond: Float[np.ndarray, "l d"]
    view_prompts: str
    backgrounds: Float[np.ndarray, "k 4"] | None
    """Latents of flat colours, a light grey one first; None: the bundle cannot encode any."""


def diffusion_guidance(
    denoise: Denoise, schedule: Schedule, embeddings: Embeddings, clean_clamp: float, signal_power: float
) -> Guidance:
    """Return score distillation from a denoiser, each view told which side of the object it shows."""

    def guidance(latents: Float[np.ndarray, "b 4 h w"], batch: Batch) -> Float[np.ndarray, "b 4 h w"]:
        total = len(schedule.alphas_cumprod)
        timesteps = np.minimum((batch.noise_levels * total).astype(np.int64), total - 1)
        rows = view_index(embeddings.view_prompts, batch.azimuths, batch.polars)
        return sds_gradient(
            latents,
            denoise,
            schedule,
            timesteps,
            batch.noise,
            embeddings.cond[rows],
            embeddings.uncond,
            batch.guidance_scale,
            clean_clamp,
            signal_power,
        ).gradient

    return guidance


def load_embeddings(path: Path) -> Embeddings:
    """Read embeddings.npz.

    Raises:
        InputError: it is damaged.
    """
    try:
        values = arrays.unpack(path.read_bytes())
        backgrounds = values.get("backgrounds")
        if backgrounds is not None:
            nearest = np.abs(values["background_rgb"] - _DEFAULT_GREY).sum(axis=1).argmin()
            backgrounds = np.roll(backgrounds, -nearest, axis=0)
        return Embeddings(values["cond"], values["uncond"], str(values["view_prompts"]), backgrounds)
    except (ValueError, KeyError) as error:
        raise InputError(f"{path} is damaged ({error}): delete it and run again") from None


def flat_backgrounds(embeddings: Embeddings) -> Float[np.ndarray, "k 4"]:
    """Return the latents of flat backgrounds. A bundle that cannot encode any gets standard normal ones: what
    a denoiser takes for plausible, though of no known colour."""
    if embeddings.backgrounds is not None:
        return embeddings.backgrounds
    drawn = np.random.default_rng(0).standard_normal((64, 4), np.float32)
    drawn[0] = 0
    return drawn
