"""Noise of a surface taken out by its normals: they are diffused over the faces, but not across edges, and
the vertices follow.

A field that was distilled is wavy at the scale of a few of its samples. Neighbouring faces of a wave differ
by few degrees, those of an edge of the object by many: Perona and Malik's diffusion (1990) of the normals
tells them apart. Vertices then move along the normals until their faces have them (Sun et al. 2007).

Letters: v vertices, f faces.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from pipeline.kernels import normals as kernels
from pipeline.mesh.mesh import Mesh, face_areas, face_normals

STEPS_OF_VERTICES = 20
MOST_STEPS = 2000
SPREAD = 0.29
"""Variance of a step along each axis, in areas of a face: the middles of two faces of an even mesh lie
0.88 square roots of their area apart, and a step is the mean of four."""


def denoise(mesh: Mesh, reach: float, edge: float) -> Mesh:
    """Return the mesh with smoother normals, the same faces.

    Args:
        mesh: closed, of faces of about one size.
        reach: standard deviation of the diffusion where nothing stops it [scene units]; 0: none.
        edge: difference of the normals of two neighbours that counts as an edge [degrees].
    """
    steps = min(round(reach**2 / (SPREAD * float(face_areas(mesh).mean()))), MOST_STEPS)
    if not steps:
        return mesh
    return follow(mesh, diffuse(mesh, steps, edge))


def diffuse(mesh: Mesh, steps: int, edge: float) -> Float[np.ndarray, "f 3"]:
    """Return unit normals of the faces after so many steps of diffusion."""
    weighted = face_normals(mesh)
    area = np.linalg.norm(weighted, axis=1)
    normals = weighted / np.maximum(area, 1e-30)[:, None]
    scale = -0.5 / np.radians(edge) ** 2
    return np.asarray(kernels.diffuse(normals, area, _neighbours(mesh), scale, steps))


def follow(mesh: Mesh, normals: Float[np.ndarray, "f 3"]) -> Mesh:
    """Return the mesh with its vertices moved so that the faces have these normals, as nearly as they can."""
    vertices, faces = mesh.vertices.astype(np.float64), mesh.faces
    corners, repeated = faces.ravel(), np.repeat(normals, 3, axis=0)
    count = np.maximum(np.bincount(corners, minlength=len(vertices)), 1)[:, None]
    for _ in range(STEPS_OF_VERTICES):
        middle = np.repeat(vertices[faces].mean(axis=1), 3, axis=0)
        away = ((middle - vertices[corners]) * repeated).sum(axis=1)
        moves = [np.bincount(corners, away * repeated[:, axis], len(vertices)) for axis in range(3)]
        vertices = vertices + np.stack(moves, axis=1) / count
    return mesh._replace(vertices=vertices.astype(np.float32))


def _neighbours(mesh: Mesh) -> Int[np.ndarray, "f 3"]:
    """Return the face across each edge, -1 where there is none, or more than one."""
    faces = mesh.faces.astype(np.int64)
    start = np.concatenate([faces[:, k] for k in range(3)])
    end = np.concatenate([faces[:, (k + 1) % 3] for k in range(3)])
    key = np.minimum(start, end) * len(mesh.vertices) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    pairs = first[count == 2]
    beside = np.full(3 * len(faces), -1)
    one, other = order[pairs], order[pairs + 1]
    beside[one], beside[other] = other % len(faces), one % len(faces)
    return np.ascontiguousarray(beside.reshape(3, -1).T)
