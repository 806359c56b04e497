"""A scene whose pictures are known in closed form: coloured balls, seen through a pinhole."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from benchmarks._ideal import ideal_guidance
from pipeline.cameras import Camera, camera_rays
from pipeline.training.batch import ViewGradient

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


def oracle_guidance(balls: tuple[Ball, ...], spread: float = 0.1) -> ViewGradient:
    """Return score distillation from the ideal denoiser of these balls."""
    return ideal_guidance(lambda camera, size, flat: picture(balls, camera, size, flat)[0], spread)
