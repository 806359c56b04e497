"""Solids with known surfaces, as meshes and as densities, for the tests of the mesh stages.

A signed distance is negative inside.
`density` falls exponentially across the surface, as a trained field's does.
"""

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.cameras import Camera, camera_rays
from pipeline.mesh.mesh import Mesh
from pipeline.stages.extract import sample_logarithm, surface

Distance = Callable[[np.ndarray], np.ndarray]

LEVEL = 20.0  # density at the surface
EVERYWHERE = np.ones((8, 8, 8), np.bool_)


def ball(radius: float, centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Distance:
    return lambda points: np.linalg.norm(points - np.asarray(centre), axis=-1) - radius


def torus(large: float, small: float) -> Distance:
    """Return the torus around the y axis."""
    return lambda points: np.hypot(np.hypot(points[..., 0], points[..., 2]) - large, points[..., 1]) - small


def box(half: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Distance:
    def distance(points: np.ndarray) -> np.ndarray:
        out = np.abs(points - np.asarray(centre)) - np.asarray(half)
        return np.linalg.norm(np.maximum(out, 0), axis=-1) + np.minimum(out.max(axis=-1), 0)

    return distance


def union(*parts: Distance) -> Distance:
    return lambda points: np.min([part(points) for part in parts], axis=0)


def hollow(outer: Distance, inner: Distance) -> Distance:
    return lambda points: np.maximum(outer(points), -inner(points))


LEG = 0.03  # half the width of the chair's legs [scene units]


def chair() -> Distance:
    legs = [box((LEG, 0.25, LEG), (0.3 * x, -0.3, 0.3 * z)) for x in (-1, 1) for z in (-1, 1)]
    return union(box((0.35, 0.05, 0.35)), box((0.35, 0.3, 0.05), (0.0, 0.3, -0.3)), *legs)


def density(distance: Distance, scale: float = 0.02) -> Callable[[np.ndarray], np.ndarray]:
    """Return exp(-distance / scale) * LEVEL: a surface whose logarithm is linear across it."""
    return lambda points: (LEVEL * np.exp(np.clip(-distance(points) / scale, -30, 3))).astype(np.float32)


def mesh_of(distance: Distance, resolution: int = 48) -> Mesh:
    """Return the surface, outwards oriented, from a grid of so many cells a side."""
    return surface(sample_logarithm(density(distance), EVERYWHERE, resolution), LEVEL)


def opacity_of(distance: Distance, cameras: Sequence[Camera], size: int, samples: int = 96) -> np.ndarray:
    """Return 1 - exp(-integral of the density) along the rays of every camera, by the midpoint rule."""
    field = density(distance)
    pictures = []
    for camera in cameras:
        origin, directions = camera_rays(camera, size)
        near, far = 0.6, 3.0
        step = (far - near) / samples
        depths = near + step * (np.arange(samples) + 0.5)
        points = origin + depths[None, :, None] * directions[:, None]
        inside = (np.abs(points) < 1).all(axis=-1)
        pictures.append(1 - np.exp(-(field(points) * inside).sum(axis=1) * step).reshape(size, size))
    return np.array(pictures, np.float32)
