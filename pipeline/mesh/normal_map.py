"""A normal map in tangent space: how a fine surface turns where a mesh of fewer faces has its texels.

Red is the share along the tangent, green along the bitangent (upwards in the texture), blue along the normal,
each from -1 to 1 in 8 bits (glTF 2.0, section 3.9.3). Letters: n texels on the mesh, s texels along a side.
"""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Float, UInt8

from pipeline.mesh.mesh import Mesh, SplitMesh, vertex_normals
from pipeline.mesh.tangents import frames, vertex_tangents
from pipeline.mesh.texture import covered_texels, paint, surface_texels

LEAST_COSINE = 0.2
"""A fine normal further off (78 degrees) belongs to another side of a thin wall."""
FLAT = (0.5, 0.5, 1.0)


def normal_map(
    mesh: Mesh, split: SplitMesh, fine: Mesh, size: int, padding: int
) -> tuple[UInt8[np.ndarray, "s s 3"], dict[str, float]]:
    """Return the map that turns the normals of `mesh` into those of `fine`, and metrics.

    Args:
        mesh: unwrapped; `split` is the same with one index for everything, as it is published.
        fine: another mesh of the same surface, with smooth normals.

    Metrics: the mean angle over the texels between the normals shown and those of `fine` [degrees],
    `error_without` the map and `error_with` it, 8 bits and all.
    """
    texels = surface_texels(mesh, size)
    drawn = covered_texels(mesh, size)
    corners = split.faces[drawn.face]
    normal = _interpolated(split.normals, corners, drawn.barycentric)
    tangent = _interpolated(vertex_tangents(split), corners, drawn.barycentric)
    axes = frames(normal, tangent)
    wanted = _nearest_normals(fine, texels.position)
    shown = _unit(normal)
    wanted = np.where((wanted * shown).sum(axis=1, keepdims=True) < LEAST_COSINE, shown, wanted)
    local = _unit(np.linalg.solve(axes, wanted[..., None])[..., 0])
    image = np.round(255 * paint((0.5 + 0.5 * local).astype(np.float32), texels, padding, FLAT))
    stored = image.reshape(-1, 3)[texels.place] / 255 * 2 - 1
    decoded = _unit(np.einsum("nij,nj->ni", axes, stored))
    return image.astype(np.uint8), {
        "error_without": _angle(shown, wanted),
        "error_with": _angle(decoded, wanted),
    }


def _interpolated(
    values: Float[np.ndarray, "c k"], corners: np.ndarray, barycentric: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n k"]:
    return np.asarray(
        np.einsum("nc,nck->nk", barycentric.astype(np.float64), values.astype(np.float64)[corners])
    )


def _nearest_normals(fine: Mesh, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Return the smooth unit normals of the fine mesh at the points on it that are nearest."""
    vertices, faces = fine.vertices.astype(np.float64), fine.faces.astype(np.int64)
    _, face, nearest = igl.point_mesh_squared_distance(points.astype(np.float64), vertices, faces)
    a, b, c = (np.ascontiguousarray(vertices[faces[face, k]]) for k in range(3))
    shares = np.clip(igl.barycentric_coordinates(np.ascontiguousarray(nearest), a, b, c), 0, 1)
    return _unit(np.einsum("nc,nck->nk", shares, vertex_normals(fine)[faces[face]]))


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-20)


def _angle(one: Float[np.ndarray, "n 3"], other: Float[np.ndarray, "n 3"]) -> float:
    """Return the mean angle between unit vectors [degrees]."""
    return float(np.degrees(np.arccos(np.clip((one * other).sum(axis=1), -1, 1))).mean())
