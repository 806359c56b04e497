"""How well a denoiser recognises the prompt in renders: what its loss gains by being told the text.

A denoiser's loss bounds the likelihood of what it is shown, so the difference between its losses with and
without the text says how likely the text is (Li et al. 2023, "Your diffusion model is secretly a zero-shot
classifier", arXiv 2303.16203). It needs nothing but the denoiser itself. Noise and cameras are the same for
all scenes that are compared, and none that training draws.

Letters: b views, h x w latent pixels, k noise levels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pipeline.diffusion.conditions import Conditions, camera_rows, together
from pipeline.diffusion.schedule import Schedule
from pipeline.diffusion.sessions import Denoise, TellCamera
from pipeline.diffusion.view_gradient import Embeddings, backdrops, told_cameras, view_embeddings
from pipeline.options.distillation import Distillation
from pipeline.training.batch import Batch

LEVELS = (0.3, 0.5, 0.7)
"""Of noise, as shares of the schedule: below, any picture is taken for what it is; above, for nothing."""


class Agreement(NamedTuple):
    """What the denoiser makes of a scene."""

    score: float
    """Share of the loss without text that the text takes away: the higher, the more it is as asked."""
    loss_told: float
    """Mean square of the error of the noise [unit variance] with the text."""
    loss_untold: float


def agreement(
    latents: Float[np.ndarray, "b 4 h w"],
    batch: Batch,
    denoise: Denoise | TellCamera,
    schedule: Schedule,
    embeddings: Embeddings,
    options: Distillation,
    conditions: Conditions = Conditions(),  # noqa: B008
    seed: int = 0,
) -> Agreement:
    """Return how well the views of a batch, each before its background, agree with the text."""
    rows = together(len(latents), conditions.views)
    if conditions.camera:
        told = camera_rows(conditions.camera, batch, backdrops(embeddings, batch))[rows]
        denoise = told_cameras(denoise, told)
    shown, text = latents[rows], view_embeddings(embeddings, options, batch)[rows]
    texts = np.concatenate([text, np.broadcast_to(embeddings.uncond, text.shape)])
    rng = np.random.default_rng([seed, 6])
    total, losses = len(schedule.alphas_cumprod), []
    for level in LEVELS:
        noise = rng.standard_normal(latents.shape, np.float32)[rows]
        timesteps = np.full(len(rows), min(int(level * total), total - 1))
        noisy = np.tile(schedule.add_noise(shown, noise, timesteps), (2, 1, 1, 1))
        twice = np.tile(timesteps, 2)
        guessed = schedule.to_epsilon(denoise(noisy, twice, texts), noisy, twice)
        error = np.square(guessed - np.tile(noise, (2, 1, 1, 1)), dtype=np.float64)
        losses.append(error.reshape(2, -1).mean(axis=1))
    told_loss, untold_loss = np.mean(losses, axis=0)
    gains = [1 - with_text / without for with_text, without in losses]
    return Agreement(float(np.mean(gains)), float(told_loss), float(untold_loss))
