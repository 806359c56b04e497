"""The ideal denoiser of exactly one known scene, as the guidance of a training.

For latents drawn from N(mu, s^2), mu being the scene's picture from the camera of a view, the best
estimate of the noise is closed-form, with abar the schedule's cumulative product:

    eps* = (x_t - sqrt(abar) mu) sqrt(1 - abar) / (abar s^2 + 1 - abar)

Score distillation from it has to reconstruct the scene, so its error can be measured end to end. Letters: b
views, h x w latent pixels.
"""

import time
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from pipeline.cameras import Camera
from pipeline.diffusion.distillation import LATENT_NERF_POWER, sds_gradient
from pipeline.diffusion.schedule import Schedule
from pipeline.training.batch import Batch, ViewGradient

Draw = Callable[[Camera, int, Float[np.ndarray, " 4"]], Float[np.ndarray, "4 h w"]]
"""The scene from a camera, so many latent pixels a side, before a flat background."""


class Calls:
    """What was asked of the denoiser."""

    def __init__(self) -> None:
        self.runs = 0
        """Runs of the network, each over all views of a step."""
        self.views = 0
        """Views denoised."""
        self.seconds = 0.0
        """Processor time inside the guidance, which is not the product's [s]."""


def linear_schedule(steps: int = 1000) -> Schedule:
    """Return Stable Diffusion's schedule, which the bundles share."""
    betas = np.linspace(0.00085**0.5, 0.012**0.5, steps) ** 2
    return Schedule(np.cumprod(1 - betas), "epsilon")


def ideal_guidance(
    draw: Draw,
    spread: float = 0.1,
    signal_power: float = LATENT_NERF_POWER,
    clean_clamp: float = 0.0,
    calls: Calls | None = None,
) -> ViewGradient:
    """Return score distillation from the ideal denoiser of what `draw` shows, through `sds_gradient`.

    `spread` is the standard deviation s of the latents that the denoiser believes in. It does not listen to
    any text, so it runs once a step, without classifier-free guidance. `calls` is counted up.
    """
    schedule = linear_schedule()
    total = len(schedule.alphas_cumprod)
    counted = calls or Calls()

    def guidance(latents: Float[np.ndarray, "b 4 h w"], batch: Batch) -> Float[np.ndarray, "b 4 h w"]:
        assert batch.backgrounds is not None
        began = time.process_time()
        views = zip(batch.cameras, batch.backgrounds, strict=True)
        mu = np.stack([draw(camera, latents.shape[-1], flat) for camera, flat in views])

        def denoise(sample: np.ndarray, timesteps: np.ndarray, text: np.ndarray) -> np.ndarray:
            signal, sigma = schedule.factors(timesteps)
            epsilon = (sample - signal * mu) * sigma / (signal**2 * spread**2 + sigma**2)
            counted.runs += 1
            counted.views += len(sample)
            return np.asarray(epsilon, np.float32)

        timesteps = np.minimum((batch.noise_levels * total).astype(np.int64), total - 1)
        text = np.zeros((len(latents), 1, 1), np.float32)
        step = sds_gradient(
            latents,
            denoise,
            schedule,
            timesteps,
            batch.noise,
            text,
            text[0],
            1.0,
            clean_clamp=clean_clamp,
            signal_power=signal_power,
            gradient_clip=batch.gradient_clip,
        )
        counted.seconds += time.process_time() - began
        return step.gradient

    return guidance
