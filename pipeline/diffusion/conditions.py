"""What a denoiser is told of the views besides the text: exact cameras, backdrops, and which views go
together.

A bundle declares both in bundle.json: `camera`, the columns of the denoiser's input of that name, and
`views`, how many views of one object stand in consecutive rows and see each other (MVDream, Shi et al. 2023,
arXiv 2308.16512). Letters: b views of a step, k columns, r rows of the denoiser.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pipeline.diffusion.bundle import Bundle
from pipeline.training.batch import Batch


class Conditions(NamedTuple):
    """What a bundle wants to be told."""

    camera: tuple[str, ...] = ()
    """Columns, of `bundle.CAMERA_COLUMNS`; several backdrops in a row are the channels of one."""
    views: int = 1
    """Views that are denoised together, at one noise level."""


def conditions_of(bundle: Bundle) -> Conditions:
    """Return what the bundle's denoiser is to be told."""
    return Conditions(bundle.camera, bundle.views)


def camera_rows(
    columns: Sequence[str], batch: Batch, backdrops: Float[np.ndarray, "b c"] | None
) -> Float[np.ndarray, "b k"]:
    """Return the camera input of each view, float32.

    Angles in radians as in `cameras.orbit_camera`, the distance from the origin in scene units, the backdrop
    in flat latents; `camera_told` and `backdrop_told` are 1, or 0 before a backdrop that is not flat (None).
    """
    count = len(batch.cameras)
    known = {
        "camera_told": np.ones(count),
        "azimuth": batch.azimuths,
        "polar": batch.polars,
        "distance": np.array([np.linalg.norm(camera.pose[:3, 3]) for camera in batch.cameras]),
        "fov": np.array([camera.fov for camera in batch.cameras]),
        "backdrop_told": np.full(count, backdrops is not None),
    }
    channels = iter([] if backdrops is None else backdrops.T)
    rows = [next(channels, np.zeros(count)) if c == "backdrop" else known[c] for c in columns]
    return np.stack(rows, axis=1).astype(np.float32)


def together(count: int, views: int) -> Int[np.ndarray, " r"]:
    """Return which of `count` views stands in each row, so that `views` consecutive ones lie far apart.

    Views come in the order of their azimuths. Some stand twice where `count` is no multiple of `views`.
    """
    filled = np.arange(-(-count // views) * views) % count
    return filled.reshape(views, -1).T.ravel()
