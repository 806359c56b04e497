"""Score distillation as a scene sees it: rendered latents and their views in, a gradient out.

Letters: b views a step, h x w latent pixels, v view texts of l tokens of width d, k flat backgrounds.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pipeline import arrays
from pipeline.diffusion.conditions import Conditions, camera_rows, together
from pipeline.diffusion.distillation import Opposed, SdsStep, sds_gradient
from pipeline.diffusion.prompts import front_opposed, view_index, view_mix
from pipeline.diffusion.schedule import Schedule
from pipeline.diffusion.sessions import Denoise, TellCamera
from pipeline.errors import InputError
from pipeline.options.distillation import Distillation
from pipeline.training.batch import Batch, ViewGradient

_DEFAULT_GREY = 2 / 3


class Embeddings(NamedTuple):
    """What stage `embed` wrote."""

    cond: Float[np.ndarray, "v l d"]
    uncond: Float[np.ndarray, "l d"]
    view_prompts: str
    backgrounds: Float[np.ndarray, "k 4"] | None
    """Latents of flat colours, a light grey one first; None: the bundle cannot encode any."""
    background_rgb: Float[np.ndarray, "k 3"] | None = None
    """Those colours, in [0, 1]."""


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


def backdrops(embeddings: Embeddings, batch: Batch) -> Float[np.ndarray, "b 4"] | None:
    """Return the latents of each view's flat backdrop; None where it is not flat, or of no known latents.

    RGB scenes stand before colours of `background_rgb`: the nearest tells.
    """
    if batch.backgrounds is None or batch.backgrounds.shape[1] == 4:
        return batch.backgrounds
    if embeddings.backgrounds is None or embeddings.background_rgb is None:
        return None
    distances = np.abs(batch.backgrounds[:, None] - embeddings.background_rgb).sum(axis=2)
    return embeddings.backgrounds[distances.argmin(axis=1)]


def told_cameras(
    denoise: Callable[..., Float[np.ndarray, "n c h w"]], cameras: Float[np.ndarray, "r k"]
) -> Denoise:
    """Return a denoiser that is told the cameras of its rows, the same for every text they come with."""

    def denoise_told(
        sample: Float[np.ndarray, "n c h w"],
        timesteps: Int[np.ndarray, " n"],
        text: Float[np.ndarray, "n l d"],
    ) -> Float[np.ndarray, "n c h w"]:
        return denoise(sample, timesteps, text, np.tile(cameras, (len(sample) // len(cameras), 1)))

    return denoise_told


def distil(
    latents: Float[np.ndarray, "b 4 h w"],
    batch: Batch,
    denoise: Denoise | TellCamera,
    schedule: Schedule,
    embeddings: Embeddings,
    options: Distillation,
    conditions: Conditions = Conditions(),  # noqa: B008
) -> SdsStep:
    """Return score distillation of rendered latents, each view told which side of the object it shows, and
    what else the denoiser wants to know (`conditions`)."""
    rows = together(len(latents), conditions.views)
    if conditions.camera:
        denoise = told_cameras(
            denoise, camera_rows(conditions.camera, batch, backdrops(embeddings, batch))[rows]
        )
    if conditions.views > 1:
        step = distil_rows(
            latents[rows], rows_of(batch, rows, conditions.views), denoise, schedule, embeddings, options
        )
        first = np.unique(rows, return_index=True)[1]
        return SdsStep(step.gradient[first], step.predicted_clean[first], step.gradient_norm)
    return distil_rows(latents, batch, denoise, schedule, embeddings, options)


def rows_of(batch: Batch, rows: Int[np.ndarray, " r"], views: int) -> Batch:
    """Return the batch as `rows` of it say, `views` consecutive ones at the noise level of the first."""
    levels = np.repeat(batch.noise_levels[rows][::views], views)
    return batch._replace(
        cameras=[batch.cameras[i] for i in rows],
        azimuths=batch.azimuths[rows],
        polars=batch.polars[rows],
        backgrounds=None if batch.backgrounds is None else batch.backgrounds[rows],
        noise_levels=levels,
        noise=batch.noise[rows],
    )


def distil_rows(
    latents: Float[np.ndarray, "b 4 h w"],
    batch: Batch,
    denoise: Denoise,
    schedule: Schedule,
    embeddings: Embeddings,
    options: Distillation,
) -> SdsStep:
    """Return score distillation of the views of a batch as they stand, told by their texts."""
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
        clean_clamp=options.predicted_clean_clamp,
        signal_power=options.signal_power,
        opposed=opposed,
        rescale=options.guidance_rescale,
        gradient_clip=batch.gradient_clip,
    )


def distillation_gradient(
    denoise: Denoise | TellCamera,
    schedule: Schedule,
    embeddings: Embeddings,
    options: Distillation,
    conditions: Conditions = Conditions(),  # noqa: B008
) -> ViewGradient:
    """Return score distillation from a denoiser, as training in latents takes it."""

    def view_gradient(latents: Float[np.ndarray, "b 4 h w"], batch: Batch) -> Float[np.ndarray, "b 4 h w"]:
        return distil(latents, batch, denoise, schedule, embeddings, options, conditions).gradient

    return view_gradient


def load_embeddings(path: Path) -> Embeddings:
    """Read embeddings.npz.

    Raises:
        InputError: it is damaged.
    """
    try:
        values = arrays.unpack(path.read_bytes())
        backgrounds, colours = values.get("backgrounds"), values.get("background_rgb")
        if backgrounds is not None and colours is not None:
            nearest = np.abs(colours - _DEFAULT_GREY).sum(axis=1).argmin()
            backgrounds, colours = np.roll(backgrounds, -nearest, axis=0), np.roll(colours, -nearest, axis=0)
        return Embeddings(values["cond"], values["uncond"], str(values["view_prompts"]), backgrounds, colours)
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
