"""Silhouettes of a mesh and of a rendered scene, and how well they agree.

Letters: n views, s pixels along a side. Masks are boolean, True on the object.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from pipeline.cameras import Camera, sphere
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.rasterize import rasterize

# The views all comparisons share: the paper's evaluation distance and angle, and the polar angles of its
# training.
RADIUS = 1.8
FOV = np.radians(55.0)
POLAR_RANGE = (0.0, np.radians(150.0))


def comparison_cameras(count: int) -> list[Camera]:
    """Return `count` cameras evenly spread over the directions that training has seen."""
    return sphere(count, RADIUS, FOV, POLAR_RANGE)


def silhouettes(mesh: Mesh, cameras: Sequence[Camera], size: int) -> Bool[np.ndarray, "n s s"]:
    """Return where each camera sees the mesh."""
    return np.stack([rasterize(camera, mesh.vertices, mesh.faces, size).mask for camera in cameras])


def mean_iou(first: Bool[np.ndarray, "n s s"], second: Bool[np.ndarray, "n s s"]) -> float:
    """Return the mean over views of intersection over union, in [0, 1]; two empty masks agree (1)."""
    union = (first | second).sum(axis=(1, 2))
    both = (first & second).sum(axis=(1, 2))
    return float(np.where(union > 0, both / np.maximum(union, 1), 1.0).mean())


def opacity_masks(opacity: Float[np.ndarray, "n s s"]) -> tuple[Bool[np.ndarray, "n s s"], float]:
    """Return where the scene is opaque, and the opacity that counts as such.

    That is 0.5; a scene that nowhere reaches it is judged by half of its own greatest opacity, so that a pale
    object still has a silhouette.
    """
    highest = float(opacity.max(initial=0.0))
    level = 0.5 if highest > 0.5 else 0.5 * highest
    return opacity > level, level
