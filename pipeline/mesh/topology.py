"""What a triangle mesh is as a surface: its pieces, their volumes, and where it is not manifold.

Letters: v vertices, f faces, k components (pieces joined by vertices).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pipeline.mesh.mesh import Mesh, face_normals


class Topology(NamedTuple):
    """Counts that are all zero, apart from `components` and `euler`, for closed oriented manifolds."""

    components: int
    euler: int
    boundary_edges: int
    non_manifold_edges: int
    non_manifold_vertices: int
    flipped_edges: int  # edges whose two faces run along them in the same direction

    @property
    def manifold(self) -> bool:
        """Whether every edge and vertex has one sheet of surface around it."""
        return self.non_manifold_edges == 0 and self.non_manifold_vertices == 0

    @property
    def closed(self) -> bool:
        """Whether no edge is a boundary."""
        return self.boundary_edges == 0


def _labels(count: int, first: np.ndarray, second: np.ndarray) -> tuple[int, np.ndarray]:
    """Return the number of connected components of a graph of `count` nodes and each node's component."""
    graph = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(count, count))
    number, labels = connected_components(graph, directed=False)
    return int(number), labels


def face_components(mesh: Mesh) -> Int[np.ndarray, " f"]:
    """Return the component of every face, numbered from 0 by the first face of each."""
    first = np.concatenate([mesh.faces[:, 0], mesh.faces[:, 1]])
    second = np.concatenate([mesh.faces[:, 1], mesh.faces[:, 2]])
    _, labels = _labels(len(mesh.vertices), first, second)
    of_face = labels[mesh.faces[:, 0]]
    _, start, inverse = np.unique(of_face, return_index=True, return_inverse=True)
    rank = np.empty(len(start), np.int64)
    rank[np.argsort(start)] = np.arange(len(start))
    return rank[inverse]


def signed_volumes(mesh: Mesh, component: Int[np.ndarray, " f"]) -> Float[np.ndarray, " k"]:
    """Return the volume each component encloses [scene units cubed], negative if its faces point inwards.

    The divergence theorem, summed from the component's own first vertex so that open or distant pieces keep
    their sign.
    """
    _, start = np.unique(component, return_index=True)
    vertices = mesh.vertices.astype(np.float64)
    origin = vertices[mesh.faces[start, 0]][component]
    sixth = np.einsum("fi,fi->f", vertices[mesh.faces[:, 0]] - origin, face_normals(mesh)) / 6
    return np.bincount(component, sixth)


def topology(mesh: Mesh) -> Topology:
    """Count what keeps the mesh from being a closed oriented manifold."""
    faces = mesh.faces.astype(np.int64)
    half_edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges, inverse, count = np.unique(
        np.sort(half_edges, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    direction = np.bincount(inverse, np.where(half_edges[:, 0] < half_edges[:, 1], 1.0, -1.0))
    component = face_components(mesh)
    return Topology(
        components=int(component.max()) + 1,
        euler=len(np.unique(faces)) - len(edges) + len(faces),
        boundary_edges=int((count == 1).sum()),
        non_manifold_edges=int((count > 2).sum()),
        non_manifold_vertices=int((fans_per_vertex(mesh) > 1).sum()),
        flipped_edges=int(((count == 2) & (direction != 0)).sum()),
    )


def fans_per_vertex(mesh: Mesh) -> Int[np.ndarray, " v"]:
    """Return how many fans of faces meet at each vertex: 1 on a manifold, 2 where the tips of cones touch."""
    faces = mesh.faces.astype(np.int64)
    count = len(faces)
    # Node i * count + f is corner i of face f. Edge i of a face joins its corners i and i + 1.
    corner = np.arange(3 * count).reshape(3, count).T
    start = np.concatenate([faces[:, 0], faces[:, 1], faces[:, 2]])
    end = np.concatenate([faces[:, 1], faces[:, 2], faces[:, 0]])
    at_start = np.concatenate([corner[:, 0], corner[:, 1], corner[:, 2]])
    at_end = np.concatenate([corner[:, 1], corner[:, 2], corner[:, 0]])
    swap = start > end
    low_corner, high_corner = np.where(swap, at_end, at_start), np.where(swap, at_start, at_end)
    key = np.minimum(start, end) * (len(mesh.vertices) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    left, right = order[same], order[same + 1]
    first = np.concatenate([low_corner[left], high_corner[left]])
    second = np.concatenate([low_corner[right], high_corner[right]])
    _, labels = _labels(3 * count, first, second)
    pairs = np.unique(np.stack([faces.T.ravel(), labels], axis=1), axis=0)
    return np.bincount(pairs[:, 0], minlength=len(mesh.vertices))
