"""A scene whose pictures are known in closed form, and the ideal denoiser of exactly these pictures.

Coloured balls, seen through a pinhole. The ideal denoiser of latents N(mu, s^2) is
eps* = (x_t - sqrt(abar) mu) sqrt(1 - abar) / (abar s^2 + 1 - abar), so score distillation has to find them.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pipeline.diffusion.distillation import sds_gradient
from pipeline.diffusion.schedule import Schedule
from pipeline.scene.batch import Batch, Guidance
from pipeline.scene.cameras import Camera, camera_rays

SUPERSAMPLING = 3


class Ball(NamedTuple):
    centre: tuple[float, float, float]
    radius: float
    latents: tuple[float, float, float, float]


TWO_BALLS = (
    Ball((0.25, 0.0, 0.1), 0.3, (1.0, -0.8, 0.3, 0.9)),
    Ball((-0.3, 0.15, -0.1), 0.2, (-1.0, 0.6, 0.9, -0.5)),
)


def picture(
    balls: tuple[Ball, ...], camera: Camera, size: int, background: Float[np.ndarray, " 4"]
) -> tuple[Float[np.ndarray, "4 h w"], Float[np.ndarray, "h w"]]:
    """Return anti-aliased latents and opacity."""
    fine = size * SUPERSAMPLING
    origin, directions = camera_rays(camera, fine)
    nearest = np.full(len(directions), np.inf)
    latents = np.repeat(background[None].astype(np.float64), len(directions), axis=0)
    for ball in balls:
        offset = origin.astype(np.float64) - ball.centre
        along = directions.astype(np.float64) @ offset
        discriminant = along**2 - (offset @ offset - ball.radius**2)
        distance = -along - np.sqrt(np.maximum(discriminant, 0))
        hit = (discriminant > 0) & (distance > 0) & (distance < nearest)
        nearest[hit] = distance[hit]
        latents[hit] = ball.latents
    opacity = np.isfinite(nearest).astype(np.float64)
    pool = (size, SUPERSAMPLING, size, SUPERSAMPLING)
    return latents.T.reshape(4, *pool).mean((2, 4)), opacity.reshape(pool).mean((1, 3))


def inside(balls: tuple[Ball, ...], points: Float[np.ndarray, "n 3"]) -> np.ndarray:
    covered: np.ndarray = np.any(
        [np.linalg.norm(points - b.centre, axis=1) < b.radius for b in balls], axis=0
    )
    return covered


def linear_schedule(steps: int = 1000) -> Schedule:
    betas = np.linspace(0.00085**0.5, 0.012**0.5, steps) ** 2
    return Schedule(np.cumprod(1 - betas), "epsilon")


def oracle_guidance(balls: tuple[Ball, ...], spread: float = 0.1) -> Guidance:
    """Return score distillation from the ideal denoiser, through the real `sds_gradient`."""
    schedule = linear_schedule()
    total = len(schedule.alphas_cumprod)

    def guidance(latents: Float[np.ndarray, "b 4 h w"], batch: Batch) -> Float[np.ndarray, "b 4 h w"]:
        assert batch.backgrounds is not None
        views = zip(batch.cameras, batch.backgrounds)
        mu = np.stack([picture(balls, camera, latents.shape[-1], flat)[0] for camera, flat in views])

        def denoise(sample: np.ndarray, timesteps: np.ndarray, text: np.ndarray) -> np.ndarray:
            signal, sigma = schedule.factors(timesteps)
            epsilon = (sample - signal * mu) * sigma / (signal**2 * spread**2 + sigma**2)
            return np.asarray(epsilon, np.float32)

        timesteps = np.minimum((batch.noise_levels * total).astype(np.int64), total - 1)
        text = np.zeros((len(latents), 1, 1), np.float32)
        step = sds_gradient(latents, denoise, schedule, timesteps, batch.noise, text, text[0], 1.0)
        return step.gradient

    return guidance
