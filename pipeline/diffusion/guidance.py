"""Score distillation as a scene sees it: rendered latents and their views in, a gradient out.

Letters: b views a step, h x w latent pixels, v view texts of l tokens of width d, k flat backgrounds.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pipeline import arrays
from pipeline.diffusion.distillation import Opposed, SdsStep, sds_gradient
from pipeline.diffusion.prompts import front_opposed, view_index, view_mix
from pipeline.diffusion.schedule import Schedule
from pipeline.diffusion.sessions import Denoise
from pipeline.distillation_options import Distillation
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


def view_embeddings(
    embeddings: Embeddings, options: Distillation, batch: Batch
) -> Float[np.ndarray, "b l d"]:
    """Return the text of each view: that of the nearest named view, or a mix of the two around it."""
    views = (embeddings.view_prompts, batch.azimuths, batch.polars)
    if options.view_text == "bins":
        return embeddings.cond[view_index(*views)]
    rows, share = view_mix(*views)
    share = share.astype(np.float32)[:, None, None]
    return (1 - share) * embeddings.cond[rows[:, 0]] + share * embeddings.cond[rows[:, 1]]


def distil(
    latents: Float[np.ndarray, "b 4 h w"],
    batch: Batch,
    denoise: Denoise,
    schedule: Schedule,
    embeddings: Embeddings,
    options: Distillation,
) -> SdsStep:
    """Return score distillation of rendered latents, each view told which side of the object it shows."""
    total = len(schedule.alphas_cumprod)
    opposed = None
    if options.perp_neg:
        rows, away = front_opposed(embeddings.view_prompts, batch.azimuths, batch.polars)
        opposed = Opposed(embeddings.cond[rows], options.perp_neg * away)
    return sds_gradient(
        latents,
        denoise,
        schedule,
        np.minimum((batch.noise_levels * total).astype(np.int64), total - 1),
        batch.noise,
        view_embeddings(embeddings, options, batch),
        embeddings.uncond,
        batch.guidance_scale,
        options.predicted_clean_clamp,
        options.signal_power,
        opposed,
        options.guidance_rescale,
        batch.gradient_clip,
    )


def diffusion_guidance(
    denoise: Denoise, schedule: Schedule, embeddings: Embeddings, options: Distillation
) -> Guidance:
    """Return score distillation from a denoiser, as training in latents takes it."""

    def guidance(latents: Float[np.ndarray, "b 4 h w"], batch: Batch) -> Float[np.ndarray, "b 4 h w"]:
        return distil(latents, batch, denoise, schedule, embeddings, options).gradient

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
