"""Wavefront OBJ as people write it, line by line.

trimesh would drop faces at NaN vertices without a word, split vertices at chart borders and take parts
for materials; this keeps what the file says. Read are `v`, `vt`, `f` (any polygon, indices from 1 or
backwards from -1), and the names after `o`, `g` and `usemtl`; the rest, materials included, is passed over.

Letters: v vertices, t texture points, f triangles.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pipeline.errors import InputError


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


def parse_obj(path: Path) -> ObjArrays:
    """Return what an OBJ file holds. Parts are its objects; without any its groups, else its materials.

    Polygons become fans of triangles around their first corner. Raises InputError naming the line.
    """
    vertices: list[list[float]] = []
    uv: list[list[float]] = []
    triangles: list[tuple[int, ...]] = []
    named: list[tuple[str, str, str]] = []
    current = {"o": "", "g": "", "usemtl": ""}
    number = 0
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
        for line in text.replace("\\\n", " ").split("\n"):
            number += 1
            key, rest = (line.split(maxsplit=1) + ["", ""])[:2]
            if key == "v":
                x, y, z = rest.split()[:3]
                vertices.append([float(x), float(y), float(z)])
            elif key == "vt":
                uv.append([float(word) for word in (rest.split() + ["0"])[:2]])
            elif key == "f":
                corners = [_corner(word, len(vertices), len(uv)) for word in rest.partition("#")[0].split()]
                for second, third in itertools.pairwise(corners[1:]):
                    triangles.append((*corners[0], *second, *third))
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
    indices = np.array(triangles, np.int64).reshape(-1, 3, 2)
    level = next((i for i in range(3) if any(name[i] for name in named)), 0)
    words = [name[level] or path.stem for name in named]
    names = tuple(dict.fromkeys(words))
    rows = {name: row for row, name in enumerate(names)}
    return ObjArrays(
        points,
        indices[..., 0],
        np.array([rows[word] for word in words], np.int32),
        names,
        texture_points,
        indices[..., 1],
    )


def _corner(word: str, vertices: int, points: int) -> tuple[int, int]:
    """Return the indices of a corner `v`, `v/vt`, `v//vn` or `v/vt/vn`, from 0; no texture point is -1."""
    first, _, rest = word.partition("/")
    second = rest.partition("/")[0]
    return _from_zero(first, vertices), _from_zero(second, points) if second else -1


def _from_zero(word: str, count: int) -> int:
    index = int(word)
    if index == 0 or index < -count:
        raise ValueError(f"index {index}, indices count from 1, or backwards from -1")
    if abs(index) > 2**31:
        raise ValueError(f"index {index} of {count}")
    return index - 1 if index > 0 else count + index
