"""Where charts of a texture meet on the surface, and how far its colours differ there.

Letters: e seam edges, n samples along one, f triangles.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pipeline.mesh.bilinear import sample
from pipeline.mesh.mesh import Mesh, texture_points

SAMPLES = 8


class Seams(NamedTuple):
    """Edges whose two faces reach for different places of the texture."""

    first: Float[np.ndarray, "e 2 2"]
    """Texture coordinates of the edge's ends on one side; `second` has the same ends in the same order."""
    second: Float[np.ndarray, "e 2 2"]
    length: Float[np.ndarray, " e"]
    share: float
    """Of the length of all edges that two faces share."""


def find_seams(mesh: Mesh) -> Seams:
    """Return the seams of an unwrapped mesh. Vertices at one position count as one: files split them."""
    uv, uv_faces = texture_points(mesh)
    positions, welded = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = welded.reshape(-1)[mesh.faces]
    start = np.concatenate([faces[:, k] for k in range(3)])
    end = np.concatenate([faces[:, (k + 1) % 3] for k in range(3)])
    corners = np.concatenate([uv_faces[:, [k, (k + 1) % 3]] for k in range(3)])
    swap = start > end
    corners[swap] = corners[swap][:, ::-1]
    key = np.minimum(start, end) * np.int64(len(positions)) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    pair = np.flatnonzero((key[order][1:] == key[order][:-1]) & (start != end)[order][1:])
    one, other = order[pair], order[pair + 1]
    length = np.linalg.norm(positions[start[one]] - positions[end[one]], axis=1)
    ends = uv.astype(np.float64)[corners]
    apart = np.abs(ends[one] - ends[other]).max(axis=(1, 2)) > 1e-6
    share = float(length[apart].sum() / max(length.sum(), 1e-300))
    return Seams(ends[one][apart], ends[other][apart], length[apart], share)


def seam_jump(seams: Seams, texture: Float[np.ndarray, "s s c"]) -> float:
    """Return how far the colours on both sides of a seam differ: the root mean square over the seams' length
    and the channels, 0 without seams. Lookups are bilinear, as in a viewer."""
    if not len(seams.length):
        return 0.0
    along = ((np.arange(SAMPLES) + 0.5) / SAMPLES)[None, :, None]
    sides = [
        sample(texture, ends[:, :1] * (1 - along) + ends[:, 1:] * along)
        for ends in (seams.first, seams.second)
    ]
    square = ((sides[0] - sides[1]) ** 2).mean(axis=(1, 2))
    return float(np.sqrt((square * seams.length).sum() / seams.length.sum()))
