"""Tangents of a mesh with texture coordinates, by the convention of MikkTSpace (Mikkelsen 2008).

A normal map means nothing without the frame that it was made in. Baker and viewer must have the same, so the
tangents go into the file. Letters: c vertices with one normal and one texture point each, f faces.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from pipeline.mesh.mesh import SplitMesh

TINY = 1e-20


def vertex_tangents(mesh: SplitMesh) -> Float[np.ndarray, "c 4"]:
    """Return unit tangents and signs (float32): the bitangent is sign * normal x tangent, and points to the
    top of the texture.

    A vertex's tangent is the mean of its faces' directions of growing u, each laid into the vertex's tangent
    plane, made unit, and weighted by the face's angle there. Faces without area in the texture have no say; a
    vertex of such faces alone gets any direction in its plane.
    """
    normals = mesh.normals.astype(np.float64)
    vertices, faces = mesh.vertices.astype(np.float64), mesh.faces
    up = mesh.uv.astype(np.float64) * [1, -1]  # the convention's v grows upwards, glTF's downwards
    corners, flat = vertices[faces], up[faces]
    edge_1, edge_2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    flat_1, flat_2 = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = flat_1[:, 0] * flat_2[:, 1] - flat_1[:, 1] * flat_2[:, 0]
    sign = np.where(area < 0, -1.0, 1.0)
    along = (edge_1 * flat_2[:, 1:] - edge_2 * flat_1[:, 1:]) * sign[:, None]
    total = np.zeros((len(vertices), 3))
    signs = np.zeros(len(vertices))
    valid = np.abs(area) > TINY
    for k in range(3):
        vertex = faces[:, k]
        normal = normals[vertex]
        before = _in_plane(corners[:, k - 1] - corners[:, k], normal)
        after = _in_plane(corners[:, (k + 1) % 3] - corners[:, k], normal)
        angle = np.arccos(np.clip((before * after).sum(axis=1), -1, 1))
        share = np.where(valid, angle, 0.0)
        direction = _in_plane(along, normal) * share[:, None]
        for axis in range(3):
            total[:, axis] += np.bincount(vertex, direction[:, axis], len(vertices))
        signs += np.bincount(vertex, share * sign, len(vertices))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    tangents = np.where(length > TINY, total / np.maximum(length, TINY), _some_direction(normals))
    return np.concatenate([tangents, np.where(signs < 0, -1.0, 1.0)[:, None]], axis=1).astype(np.float32)


def _in_plane(
    vectors: Float[np.ndarray, "f 3"], normals: Float[np.ndarray, "f 3"]
) -> Float[np.ndarray, "f 3"]:
    """Return the unit directions of the vectors' parts perpendicular to the normals; zeros where nothing is
    left."""
    flat = vectors - (vectors * normals).sum(axis=1, keepdims=True) * normals
    length = np.linalg.norm(flat, axis=1, keepdims=True)
    return np.where(length > TINY, flat / np.maximum(length, TINY), 0.0)


def _some_direction(normals: Float[np.ndarray, "c 3"]) -> Float[np.ndarray, "c 3"]:
    """Return a unit vector perpendicular to each normal."""
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    return _in_plane(axis, normals)


def frames(
    normals: Float[np.ndarray, "n 3"], tangents: Float[np.ndarray, "n 4"]
) -> Float[np.ndarray, "n 3 3"]:
    """Return tangent, bitangent and normal as columns; interpolated vectors stay as long as they are."""
    bitangents = tangents[:, 3:] * np.cross(normals, tangents[:, :3])
    return np.stack([tangents[:, :3], bitangents, normals], axis=-1)
