"""The Sketch-Shape loss (Metzer et al. 2022, Latent-NeRF, section 3.3): keep to the sketch, but less near its
surface.

    loss = mean over samples of  CE(alpha, inside) * (1 - exp(-d^2 / (2 sigma^2)))

over the n points that the renderer evaluated; alpha = 1 - exp(-LENGTH * density), and d is the distance of a
point from the sketch's surface. CE(alpha, inside) is -log(alpha) inside and outside it is
-log(1 - alpha) = LENGTH * density, so that no clamp is needed where alpha is near 0 or 1.

The paper prints 2 sigma where its code, which made its figures, has 2 sigma^2. We follow the code: sigma is
a length, and the paper's values from 0.05 to 1.5 span strict to free.
"""

import math

import numpy as np
from jaxtyping import Float

from pipeline.nerf.field import LEAST_DENSITY
from pipeline.sketch.lattice import Sketch, look_up

LENGTH = 0.2
"""The length over which a density is judged [scene units] (the paper's code): not that of a sample, so that
the loss does not depend on how finely rays are sampled."""
LEAST_WEIGHT = 1e-3
"""Points whose weight is smaller are left out."""
_MOST_THICKNESS = 80.0
"""exp of it is finite in float32; an alpha of 1 - exp(-80) is 1."""


def shape_loss(
    sketch: Sketch,
    sigma: float,
    points: Float[np.ndarray, "n 3"],
    density: Float[np.ndarray, " n"],
    least_weight: float = LEAST_WEIGHT,
) -> tuple[float, Float[np.ndarray, " n"]]:
    """Return the loss [nats] and its gradient by `density` [1 / scene unit].

    `sigma` [scene units]: at 1.18 times this distance from the surface the weight is one half. Points whose
    weight is below `least_weight` are left out.
    """
    least = nearest_judged(sigma, least_weight)
    inside, distance = look_up(sketch, points, least)
    gradient = np.zeros_like(density)
    judged = np.flatnonzero(distance >= least)
    if not len(judged):
        return 0.0, gradient
    weight = -np.expm1(np.square(distance[judged]) * np.float32(-0.5 / sigma**2)) / np.float32(len(density))
    thickness = np.maximum(density[judged], np.float32(LEAST_DENSITY)) * np.float32(LENGTH)
    solid = inside[judged]
    held = np.minimum(thickness, np.float32(_MOST_THICKNESS))
    entropy = np.where(solid, -np.log(-np.expm1(-held)), thickness)
    slope = np.where(solid, -1 / np.expm1(held), np.float32(1)) * np.float32(LENGTH)
    gradient[judged] = weight * slope
    return float(np.dot(weight.astype(np.float64), entropy)), gradient


def nearest_judged(sigma: float, least_weight: float = LEAST_WEIGHT) -> float:
    """Return the distance [scene units] below which a point's weight is less than `least_weight`."""
    return sigma * math.sqrt(-2 * math.log1p(-least_weight))


def unjudged_share(sketch: Sketch, sigma: float) -> float:
    """Return the share of the box that is so near the sketch's surface that the loss leaves it out."""
    return float((sketch.distance < nearest_judged(sigma)).mean())
