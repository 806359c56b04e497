"""The solid that a triangle soup stands for: generalised winding numbers (Jacobson et al. 2013, Barill et al.
2018) and distances, by libigl.

Letters: v vertices, f faces, n points, k lattice points a side. Overlapping parts, holes and duplicate
triangles do no harm: a point is inside where the winding number exceeds 1/2.
"""

import igl
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pipeline.errors import InputError
from pipeline.sketch.lattice import Sketch, lattice

_FLAT = 1e-6
"""A part whose volume is a smaller share of the cube of its size has no inside, and no orientation."""


def place(vertices: Float[np.ndarray, "v 3"], radius: float) -> Float[np.ndarray, "v 3"]:
    """Return the vertices (float64) with the bounding box's centre at the origin, in a ball of `radius`."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    # Half of each, lest the sum of great coordinates run out of range; then scale before squaring.
    centred = (vertices - (low / 2 + high / 2)) / (high - low).max()
    return np.asarray(centred * (radius / np.linalg.norm(centred, axis=1).max()), np.float64)


def orient_outwards(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Int[np.ndarray, "f 3"]:
    """Return the faces with those of inside-out parts turned round.

    A part is what shares positions. It is inside out if its volume about its own middle is negative; flat
    parts stay as they are.
    """
    _, point = np.unique(vertices, axis=0, return_inverse=True)
    corners = point.reshape(-1)[faces]
    count = int(corners.max()) + 1
    links = (np.ones(2 * len(faces)), (np.repeat(corners[:, 0], 2), corners[:, 1:].ravel()))
    _, label = connected_components(coo_matrix(links, (count, count)), directed=False)
    part = label[corners[:, 0]]
    parts = int(part.max()) + 1
    triangles = vertices[faces]
    weight = np.bincount(part, minlength=parts)
    middle = np.stack(
        [np.bincount(part, triangles.mean(axis=1)[:, axis], parts) / weight for axis in range(3)], 1
    )
    a, b, c = np.moveaxis(triangles - middle[part][:, None], 1, 0)
    volume = np.bincount(part, np.einsum("fi,fi->f", a, np.cross(b, c)) / 6, parts)
    size = np.zeros(parts)
    np.maximum.at(size, part, np.linalg.norm(triangles - middle[part][:, None], axis=2).max(axis=1))
    turned = volume < -_FLAT * size**3
    return np.where(turned[part][:, None], faces[:, ::-1], faces)


def winding_numbers(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """Return the generalised winding number at `points` (float64; approximate to about 1e-2)."""
    solid = np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int64)
    return np.asarray(igl.fast_winding_number(*solid, np.ascontiguousarray(points, np.float64)))


def distances(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """Return the distance of `points` to the nearest triangle (float64, exact) [scene units]."""
    solid = np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int64)
    squared, _, _ = igl.point_mesh_squared_distance(np.ascontiguousarray(points, np.float64), *solid)
    return np.sqrt(squared)


def tabulate(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], cells: int, source: str
) -> Sketch:
    """Return the solid on a lattice of `cells` cells a side; `source` names it in the error.

    Raises:
        InputError: nothing is inside: the mesh is open and flat, or thinner than a cell.
    """
    points, shape = lattice(cells), (cells + 1,) * 3
    winding = winding_numbers(vertices, faces, points).astype(np.float32)
    if not (winding > 0.5).any():
        raise InputError(
            f"{source}: the mesh encloses no space as wide as a cell ({2 / cells:.3g} of the box's 2); "
            "give a solid (parts may overlap and have small holes), or raise sketch_field.cells"
        )
    return Sketch(
        winding.reshape(shape), distances(vertices, faces, points).astype(np.float32).reshape(shape)
    )
