"""What one step of score distillation renders, and how it is to be judged.

Letters: b cameras a step, h x w latent pixels (square).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pipeline.cameras import Camera
from pipeline.options.distillation import Distillation

LATENT_CHANNELS = 4
_LARGEST_GRADIENT = 1e18


class Batch(NamedTuple):
    """What one step renders, and how it is to be judged."""

    cameras: list[Camera]
    azimuths: Float[np.ndarray, " b"]
    """[rad], as in `cameras.orbit_camera`."""
    polars: Float[np.ndarray, " b"]
    """[rad]"""
    backgrounds: Float[np.ndarray, "b c"] | None
    """Flat latents (or RGB) behind each view; None: the scene's own learned background."""
    noise_levels: Float[np.ndarray, " b"]
    """Timesteps as a share of the schedule, in [0, 1]."""
    noise: Float[np.ndarray, "b 4 h w"]
    guidance_scale: float
    gradient_clip: float
    """Bound on the absolute gradient of every latent; 0: none."""


ViewGradient = Callable[[Float[np.ndarray, "b c h w"], Batch], Float[np.ndarray, "b c h w"]]
"""Rendered latents (c = 4) or RGB and their batch -> the gradient by each view, summed over its pixels."""


def make_batch(
    views: tuple[list[Camera], Float[np.ndarray, " b"], Float[np.ndarray, " b"]],
    backgrounds: Float[np.ndarray, "b c"] | None,
    options: Distillation,
    progress: float,
    resolution: int,
    rng: np.random.Generator,
) -> Batch:
    """Return views (cameras, azimuths and polar angles) with the noise of the step at `progress` in [0, 1].

    Noise levels are stratified over the views (one in each of b equal parts of the range, in random order).
    """
    cameras, azimuths, polars = views
    count = len(cameras)
    falling = math.sqrt(progress) if options.timestep_annealing == "sqrt" else progress
    top = _ramp(options.timestep_max, options.timestep_max_end, falling)
    strata = (rng.permutation(count) + rng.random(count)) / count
    levels = options.timestep_min + (top - options.timestep_min) * strata
    noise = rng.standard_normal((count, 4, resolution, resolution), np.float32)
    scale = _ramp(options.guidance_scale, options.guidance_scale_end, progress)
    clip = _ramp(options.gradient_clip, options.gradient_clip_end, progress)
    return Batch(cameras, azimuths, polars, backgrounds, levels, noise, scale, clip)


def root_mean_square_norm(gradient: Float[np.ndarray, "b c h w"]) -> float:
    """Return the Euclidean norm of a view's gradient, root mean square over views."""
    return math.sqrt(float(np.square(gradient, dtype=np.float64).sum()) / len(gradient))


def require_finite(name: str, values: Tensor | np.ndarray | None, step: int) -> None:
    """Raise FloatingPointError with the tensor's name and the step if it holds a NaN or an infinity."""
    if values is None:
        return
    tensor = values.detach() if isinstance(values, Tensor) else torch.from_numpy(values)
    # A sum with a NaN or an infinity in it is not finite; one without can still overflow, so look again.
    if math.isfinite(float(tensor.sum())):
        return
    bad = int((~torch.isfinite(tensor)).sum())
    if bad:
        raise FloatingPointError(
            f"{name} holds {bad} NaN or infinite values of {tensor.numel()} at step {step}"
        )


def require_steppable(name: str, gradient: Tensor | None, step: int) -> None:
    """Raise FloatingPointError unless Adam can take a step along a parameter's gradient.

    It squares the gradient in float32. Where the square overflows, the second moment stays infinite for ever
    and the parameter never moves again, without any NaN to tell of it.
    """
    if gradient is None or not gradient.numel():
        return
    # No number is larger than the norm, and the norm takes a fifth of the time of looking at every number.
    flat = gradient.detach().reshape(-1)
    if float(torch.dot(flat, flat)) <= _LARGEST_GRADIENT**2:
        return
    largest = float(torch.linalg.vector_norm(gradient, torch.inf))
    if largest <= _LARGEST_GRADIENT:
        return
    require_finite(f"gradient of {name}", gradient, step)
    raise FloatingPointError(
        f"gradient of {name} reaches {largest:.1e} at step {step}, more than Adam can square"
    )


def _ramp(start: float, end: float, progress: float) -> float:
    return start + (end - start) * progress
