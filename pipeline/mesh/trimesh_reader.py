"""PLY, STL and OFF, read by trimesh. A module of its own, since trimesh takes most of a second to import.

Letters: v vertices, f triangles.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from pipeline.documents import whole_number
from pipeline.errors import InputError
from pipeline.mesh.part import Part
from pipeline.options.schema import short

_NO_FACES = np.zeros((0, 3), np.int64)


def read_parts(path: Path) -> list[Part]:
    """Return the parts of a PLY, STL or OFF file that has passed `file_checks`, after the checks that trimesh
    lacks. Points without faces are a part without any.

    Raises:
        InputError: trimesh cannot read it, or would read another mesh than the file claims.
    """
    suffix = path.suffix.lower()
    if suffix == ".off":
        _check_off(path)
    try:
        scene = trimesh.load_scene(path, file_type=suffix[1:], process=False, validate=False)
        parts = [
            _part(geometry, welded=suffix == ".stl")
            for geometry in scene.geometry.values()
            if isinstance(geometry, trimesh.Trimesh)
        ]
        if not parts and any(len(cloud.vertices) for cloud in scene.geometry.values()):
            # trimesh has another class for what `readers` would name
            parts = [
                Part(np.concatenate([c.vertices for c in scene.geometry.values()]), _NO_FACES, None, None)
            ]
        return parts
    except (
        Exception
    ) as error:  # trimesh lets IndexError, JSONDecodeError, ModuleNotFoundError and more escape
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{path}: not a readable {suffix[1:]} mesh ({said}); export it again") from None


def _check_off(path: Path) -> None:
    """Raise InputError for a face with fewer corners than it claims: trimesh reads three of them."""
    lines = (line.partition(b"#")[0].split() for line in path.read_bytes().split(b"\n"))
    words = [line for line in lines if line]
    if words and words[0][0].endswith(b"OFF"):
        words[0] = words[0][1:]
        words = words[not words[0] :]
    counts = [whole_number(word) for word in words[0]] if words else []
    if len(counts) < 2 or counts[0] is None or counts[1] is None:
        return  # trimesh says what is wrong
    for row in words[1 + counts[0] : 1 + counts[0] + counts[1]]:
        claimed = whole_number(row[0])
        if claimed is None or claimed > len(row) - 1:
            raise InputError(
                f"{path}: a face claims {short(row[0].decode('ascii', 'replace'))} corners and has "
                f"{len(row) - 1}; export the mesh again"
            )


def _part(geometry: trimesh.Trimesh, *, welded: bool) -> Part:
    """Return what trimesh read. `welded`: corners at one position are one vertex; STL has no indices."""
    points = np.asarray(geometry.vertices, np.float64)
    index = np.asarray(geometry.faces, np.int64).reshape(-1, 3)
    if welded:
        points, inverse = np.unique(points, axis=0, return_inverse=True)
        return Part(points, inverse.reshape(-1)[index], None, None)
    uv = getattr(geometry.visual, "uv", None)
    has_uv = uv is not None and len(uv) == len(points)
    raw = geometry.metadata.get("_ply_raw", {}).get("vertex", {}).get("properties", {})
    has_normals = {"nx", "ny", "nz"} <= set(raw)  # trimesh makes some where a file has none
    return Part(
        points,
        index,
        np.asarray(uv, np.float64)[:, :2] * [1, -1] + [0, 1] if has_uv else None,
        np.asarray(geometry.vertex_normals, np.float64) if has_normals else None,
    )
