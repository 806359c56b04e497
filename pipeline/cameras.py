"""Pinhole cameras that look at the origin.

World: right-handed, +Y up, the front of an object faces +Z. Camera: x right, y up, looking along -z (OpenGL).
`azimuth` turns about +Y from the front (0 sees the front from +Z, pi/2 stands at +X), `polar` is measured
from +Y (0 is overhead, pi/2 level). Pictures are square, row-major from the top left; all angles are radians.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Camera(NamedTuple):
    """One view: where it stands and how wide it sees."""

    pose: Float[np.ndarray, "4 4"]
    """Camera to world, rigid, float64."""
    fov: float
    """Full angle of view, vertical and horizontal [rad]."""


def orbit_camera(azimuth: float, polar: float, radius: float, fov: float) -> Camera:
    """Return the camera at spherical position (`azimuth`, `polar`, `radius`) looking at the origin.

    The image's up is the direction of falling polar angle, so overhead views (polar 0) are well defined too:
    the top of the picture then shows the back of the object.
    """
    sin_a, cos_a = np.sin(azimuth), np.cos(azimuth)
    sin_p, cos_p = np.sin(polar), np.cos(polar)
    backward = np.array([sin_p * sin_a, cos_p, sin_p * cos_a])
    right = np.array([cos_a, 0.0, -sin_a])
    pose = np.eye(4)
    pose[:3, 0] = right
    pose[:3, 1] = np.cross(backward, right)
    pose[:3, 2] = backward
    pose[:3, 3] = radius * backward
    return Camera(pose, float(fov))


def ring(count: int, polar: float, radius: float, fov: float) -> list[Camera]:
    """Return `count` cameras at evenly spaced azimuths, the first in front."""
    return [orbit_camera(2 * np.pi * i / count, polar, radius, fov) for i in range(count)]


def sphere(
    count: int, radius: float, fov: float, polar_range: tuple[float, float] = (0.0, np.pi)
) -> list[Camera]:
    """Return `count` cameras spread evenly over the part of the sphere within `polar_range`.

    A Fibonacci lattice: heights in equal steps of cos(polar), azimuths in steps of the golden angle.
    """
    top, bottom = np.cos(polar_range[0]), np.cos(polar_range[1])
    heights = top + (bottom - top) * (np.arange(count) + 0.5) / count
    azimuths = np.arange(count) * np.pi * (3 - np.sqrt(5))
    return [orbit_camera(a, np.arccos(h), radius, fov) for a, h in zip(azimuths, heights, strict=True)]


def sample_cameras(
    rng: np.random.Generator,
    count: int,
    radius_range: Sequence[float],
    fov_range: Sequence[float],
    polar_range: Sequence[float],
) -> tuple[list[Camera], Float[np.ndarray, " count"], Float[np.ndarray, " count"]]:
    """Draw training cameras; return them with their azimuths and polar angles.

    Azimuths are stratified (one in each of `count` equal sectors, the whole set turned at random), so that
    the views of one step disagree about as little of the object as possible; the other ranges are uniform.
    """
    azimuths = (2 * np.pi / count) * (np.arange(count) + rng.uniform(0, 1, count)) + rng.uniform(0, 2 * np.pi)
    azimuths = np.mod(azimuths, 2 * np.pi)
    polars = rng.uniform(polar_range[0], polar_range[1], count)
    radii = rng.uniform(radius_range[0], radius_range[1], count)
    fovs = rng.uniform(fov_range[0], fov_range[1], count)
    cameras = [orbit_camera(*v) for v in zip(azimuths, polars, radii, fovs, strict=True)]
    return cameras, azimuths, polars


def camera_rays(camera: Camera, size: int) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "rays 3"]]:
    """Return the ray origin and the unit directions through the pixel centres of a `size` x `size`
    picture.
    """
    half = np.tan(camera.fov / 2)
    steps = ((np.arange(size) + 0.5) / size * 2 - 1) * half
    x, y = np.meshgrid(steps, -steps)
    directions = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3) @ camera.pose[:3, :3].T
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return camera.pose[:3, 3].astype(np.float32), directions.astype(np.float32)


def project(
    camera: Camera, points: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    """Return picture coordinates in [0, 1] x [0, 1] (top-left origin) and depths along the viewing axis,
    float64.

    Points at or behind the camera plane have depth <= 0 and coordinates without meaning (NaN at depth 0).
    """
    local = (np.asarray(points, np.float64) - camera.pose[:3, 3]) @ camera.pose[:3, :3]
    depth = -local[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        plane = local[:, :2] / (depth[:, None] * np.tan(camera.fov / 2))
    return np.stack([0.5 + 0.5 * plane[:, 0], 0.5 - 0.5 * plane[:, 1]], axis=-1), depth
