"""Leaves of trees and plants."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.shapes import Paint, Part, grid_faces


def folded_leaf(
    path: np.ndarray,
    widths: Sequence[float] | np.ndarray,
    paint: Paint,
    thickness: float = 0.035,
    fold: float = 0.3,
) -> Part:
    """A thick leaf along a path in the yz-plane, half its width at every point; its sides rise by `fold`."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    up = np.stack([0 * along[:, 0], along[:, 2], -along[:, 1]], -1)
    angle = np.arange(16) * 2 * np.pi / 16
    across = np.asarray(widths)[:, None] * np.cos(angle)
    high = thickness * np.sin(angle) * np.minimum(1, np.asarray(widths)[:, None] / 0.05) + fold * np.abs(
        across
    )
    rows = path[:, None] + across[..., None] * (1.0, 0, 0) + high[..., None] * up[:, None]
    rows = np.concatenate([np.repeat(path[:1, None], 16, 1), rows, np.repeat(path[-1:, None], 16, 1)])
    return Part(rows.reshape(-1, 3), grid_faces(len(rows), 16), paint)
