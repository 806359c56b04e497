"""A painted OBJ given back as it came: every line but texture points, corners and material libraries.

Positions, normals, objects, groups, smoothing groups, material names, polygons and comments stay.

Letters: t texture points, f triangles.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from pipeline.mesh.obj_reader import obj_lines, parse_obj


def material_names(path: Path) -> list[str]:
    """Return the names of the materials that an OBJ file uses, in its order; "albedo" where it uses none."""
    words = (line.split(maxsplit=1) for line in obj_lines(path))
    names = dict.fromkeys(" ".join(w[1].split()) for w in words if len(w) == 2 and w[0] == "usemtl")
    return [*names] or ["albedo"]


def repainted_obj(
    path: Path, uv: Float[np.ndarray, "t 2"], uv_faces: Int[np.ndarray, "f 3"], library: str
) -> str:
    """Return the text of an OBJ file with other texture points for its triangles, as `parse_obj` has them.

    Args:
        uv: origin at the top left.
        library: name of the MTL file, with `material_names`.

    A polygon stays one, unless a corner of it lies in several charts: then its triangles are written.
    """
    arrays = parse_obj(path)
    triangles = list(zip(arrays.corners.tolist(), uv_faces.tolist(), strict=True))[::-1]
    flipped = uv.astype(np.float64) * [1, -1] + [0, 1]
    points = [f"vt {u:.9g} {v:.9g}" for u, v in flipped.tolist()]
    lines, corner, faces, named = [f"mtllib {library}"], 0, False, False
    for line in obj_lines(path):
        key, rest = (line.split(maxsplit=1) + ["", ""])[:2]
        words = rest.partition("#")[0].split()
        if key in ("vt", "mtllib"):
            continue
        if key == "l":  # its texture points are gone
            lines.append(" ".join(["l", *(word.partition("/")[0] for word in words)]))
        elif key == "f":
            if not faces:  # indices count from the start of the file, so all may stand before the first face
                lines += [*points, *([] if named else [f"usemtl {material_names(path)[0]}"])]
                faces = True
            mine = []
            while triangles and triangles[-1][0][0] < corner + len(words):
                mine.append(triangles.pop())
            lines += _faces(words, corner, mine)
            corner += len(words)
        else:
            named |= key == "usemtl"
            lines.append(line.rstrip("\r"))
    return "\n".join(lines).rstrip("\n") + "\n"


def _faces(words: list[str], first: int, triangles: list[tuple[list[int], list[int]]]) -> list[str]:
    """Return the polygon of the corners `first` and after with the texture points of its triangles, or those
    triangles."""
    pairs = {pair for rows, texture in triangles for pair in zip(rows, texture, strict=True)}
    points = dict(pairs)
    if len(points) < len(pairs):
        return [
            "f " + " ".join(_corner(words[row - first], point) for row, point in zip(*triangle, strict=True))
            for triangle in triangles
        ]
    # A face of two corners has no triangle, and no texture points.
    return ["f " + " ".join(_corner(word, points.get(row)) for row, word in enumerate(words, first))]


def _corner(word: str, point: int | None) -> str:
    """Return a corner with another texture point."""
    vertex, _, rest = word.partition("/")
    normal = rest.partition("/")[2]
    texture = "" if point is None else str(point + 1)
    return f"{vertex}/{texture}/{normal}".rstrip("/")
