"""Wavefront OBJ as people write it, line by line.

trimesh would drop faces at NaN vertices without a word, split vertices at chart borders and take parts
for materials; this keeps what the file says. Read are `v`, `vt`, `f` (any polygon, indices from 1 or
backwards from -1), `vn`, and the names after `o`, `g` and `usemtl`; the rest, materials included, is passed
over.

Letters: v vertices, t texture points, n normals, p polygons, c corners of these, f triangles.
"""

from __future__ import annotations

import codecs
from pathlib import Path
from typing import NamedTuple

import mapbox_earcut
import numpy as np
from jaxtyping import Float, Int

from pipeline.errors import InputError

MOST_CUTTING = 4e9
"""Of squares of polygons' corners together: cutting one of 60,000 corners that cross takes ten seconds."""


class ObjArrays(NamedTuple):
    """The file's arrays; indices are not checked for their upper bound yet."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    part: Int[np.ndarray, " f"]
    """Row of `names`."""
    names: tuple[str, ...]
    uv: Float[np.ndarray, "t 2"]
    """Origin at the bottom left, as in the file."""
    uv_faces: Int[np.ndarray, "f 3"]
    """-1 where a corner has no texture point."""
    normals: Float[np.ndarray, "n 3"]
    normal_faces: Int[np.ndarray, "f 3"]
    """-1 where a corner has no normal."""
    corners: Int[np.ndarray, "f 3"]
    """Which of all corners of `f` lines, in their order, a triangle has."""


def parse_obj(path: Path) -> ObjArrays:
    """Return what an OBJ file holds. Parts are its objects; without any its groups, else its materials.

    Polygons become fans of triangles around their first corner where that covers them, as it does convex
    ones; others are cut into ears. Raises InputError naming the line.
    """
    vertices: list[list[float]] = []
    uv: list[list[float]] = []
    normals: list[list[float]] = []
    corners: list[tuple[int, int, int]] = []
    sides: list[int] = []
    named: list[tuple[str, str, str]] = []
    current = {"o": "", "g": "", "usemtl": ""}
    number = 0
    try:
        for line in obj_lines(path):
            number += 1
            key, rest = (line.split(maxsplit=1) + ["", ""])[:2]
            if key == "v":
                x, y, z = rest.split()[:3]
                vertices.append([float(x), float(y), float(z)])
            elif key == "vt":
                uv.append([float(word) for word in (rest.split() + ["0"])[:2]])
            elif key == "vn":
                normals.append(_normal(rest))
            elif key == "f":
                words = rest.partition("#")[0].split()
                corners += [_corner(word, len(vertices), len(uv), len(normals)) for word in words]
                sides.append(len(words))
                named.append((current["o"], current["g"], current["usemtl"]))
            elif key in current:
                current[key] = rest.strip()
        points = np.array(vertices, np.float64).reshape(-1, 3)
        texture_points = np.array(uv, np.float64).reshape(-1, 2)
    except ValueError as error:
        raise InputError(
            f"{path}: line {number} is no OBJ statement ({error}); expected lines such as v 0 0 1 and "
            "f 1 2 3; export the mesh again"
        ) from None
    if sum(count * count for count in sides if count > 1000) > MOST_CUTTING:
        raise InputError(
            f"{path}: has polygons of up to {max(sides)} corners, expected 60000 at most, or fewer of them; "
            "triangulate the mesh first"
        )
    indices = np.array(corners, np.int64).reshape(-1, 3)
    triangles, polygon = _triangulate(points, indices[:, 0], np.array(sides, np.int64))
    level = next((i for i in range(3) if any(name[i] for name in named)), 0)
    parts = [name[level] or path.stem for name in named]
    # a face of two corners has no triangle, and a part of such faces is none
    names = tuple(dict.fromkeys(part for part, count in zip(parts, sides, strict=True) if count > 2))
    rows = {name: row for row, name in enumerate(names)}
    return ObjArrays(
        points,
        indices[triangles, 0],
        np.array([rows.get(part, -1) for part in parts], np.int32)[polygon],
        names,
        texture_points,
        indices[triangles, 1],
        np.array(normals, np.float64).reshape(-1, 3),
        indices[triangles, 2],
        triangles,
    )


def obj_lines(path: Path) -> list[str]:
    """Return the lines of an OBJ file, those that a backslash continues as one.

    Raises InputError for UTF-16, which would be read as a file without any statement."""
    data = path.read_bytes()
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise InputError(f"{path}: its text is UTF-16, expected UTF-8 or ASCII; save it as UTF-8")
    text = data.decode("utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    return text.replace("\\\n", " ").split("\n")


def _triangulate(
    points: Float[np.ndarray, "v 3"], corners: Int[np.ndarray, " c"], sides: Int[np.ndarray, " p"]
) -> tuple[Int[np.ndarray, "f 3"], Int[np.ndarray, " f"]]:
    """Return the triangles of polygons, as rows of `corners`, and the polygon of each.

    Polygons lie in `corners` one after the other, `sides` corners each.
    """
    first, count = np.cumsum(sides) - sides, np.maximum(sides - 2, 0)
    place = np.cumsum(count) - count
    polygon = np.repeat(np.arange(len(sides)), count)
    start, step = first[polygon], np.arange(len(polygon)) - place[polygon]
    triangles = np.stack([start, start + step + 1, start + step + 2], axis=1)
    if not len(triangles) or corners.max() >= len(points):  # an index out of range: the caller says so
        return triangles, polygon
    with np.errstate(all="ignore"):
        a, b, c = (points[corners[triangles[:, k]]] for k in range(3))
        normals = np.cross(b - a, c - a)
        whole = np.stack([np.bincount(polygon, normals[:, k], len(sides)) for k in range(3)], axis=1)
        backwards = np.einsum("fk,fk->f", normals, whole[polygon]) < 0
    for row in np.unique(polygon[backwards]):
        ring = points[corners[first[row] : first[row] + sides[row]]]
        triangles[place[row] : place[row] + count[row]] = first[row] + _cut_ears(ring, whole[row])
    return triangles, polygon


def _cut_ears(ring: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, " 3"]) -> Int[np.ndarray, "f 3"]:
    """Return the triangles of a polygon that need not be convex, turning as it does; where it crosses itself,
    its fan. n = f + 2."""
    away = int(np.abs(normal).argmax())
    axes = [(away + 1) % 3, (away + 2) % 3][:: 1 if normal[away] > 0 else -1]
    flat = np.ascontiguousarray(ring[:, axes])
    ears = mapbox_earcut.triangulate_float64(flat, np.array([len(ring)], np.uint32)).reshape(-1, 3)
    if len(ears) != len(ring) - 2:
        rest = np.arange(1, len(ring) - 1)
        return np.stack([np.zeros_like(rest), rest, rest + 1], axis=1)
    side, other = flat[ears[:, 1]] - flat[ears[:, 0]], flat[ears[:, 2]] - flat[ears[:, 0]]
    turned = side[:, 0] * other[:, 1] - side[:, 1] * other[:, 0] < 0
    return np.where(turned[:, None], ears[:, ::-1], ears).astype(np.int64)


def _corner(word: str, vertices: int, points: int, normals: int) -> tuple[int, int, int]:
    """Return the indices of a corner `v`, `v/vt`, `v//vn` or `v/vt/vn`, from 0; what is not there is -1."""
    first, second, third = (word.split("/", 2) + ["", ""])[:3]
    return (
        _from_zero(first, vertices),
        _from_zero(second, points) if second else -1,
        _row(third, normals),
    )


def _row(word: str, count: int) -> int:
    """Return the index of a normal from 0, -1 if there is none or it cannot be: a mesh does without."""
    try:
        return _from_zero(word, count)
    except ValueError:
        return -1


def _normal(rest: str) -> list[float]:
    """Return three numbers, NaN where the line has none."""
    try:
        x, y, z = (float(word) for word in rest.split()[:3])
    except ValueError:
        x = y = z = np.nan
    return [x, y, z]


def _from_zero(word: str, count: int) -> int:
    index = int(word)
    if index == 0 or index < -count:
        raise ValueError(f"index {index}, indices count from 1, or backwards from -1")
    if abs(index) > 2**31:
        raise ValueError(f"index {index} of {count}")
    return index - 1 if index > 0 else count + index
