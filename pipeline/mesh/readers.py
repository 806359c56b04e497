"""A mesh that a user gives: OBJ, PLY, STL, OFF, GLB or glTF, as plain arrays, or one line about its fault.

Nothing is repaired: positions, faces and part names are those of the file. Letters: v vertices, f triangles,
t texture points.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float, Int

from pipeline.documents import whole_number
from pipeline.errors import InputError
from pipeline.mesh.file_checks import check_file
from pipeline.mesh.gltf_reader import Piece, read_gltf
from pipeline.mesh.limits import check_count
from pipeline.mesh.mesh import Mesh, check_mesh
from pipeline.mesh.obj_reader import parse_obj
from pipeline.options.schema import short

_NO_FACES = np.zeros((0, 3), np.int64)
LEAST_EXTENT, MOST_EXTENT = 1e-30, 1e30
"""Beyond these the asset's float32 positions would run out of range."""


class InputMesh(NamedTuple):
    """All parts in one: `part` tells which part a triangle belongs to."""

    vertices: Float[np.ndarray, "v 3"]
    """float64, in the file's own units and place (glTF: in the scene, node transforms applied)."""
    faces: Int[np.ndarray, "f 3"]
    """int32; degenerate and duplicate triangles included."""
    part: Int[np.ndarray, " f"]
    """int32, row of `names`."""
    names: tuple[str, ...]
    uv: Float[np.ndarray, "t 2"] | None
    """float64, origin at the top left (glTF's), not checked for range; None: some triangle has none."""
    uv_faces: Int[np.ndarray, "f 3"] | None
    untextured: int
    """Triangles for whose lack of texture points those of the others are not used."""
    normals: Float[np.ndarray, "n 3"] | None = None
    """float64, as the file has them; None: some triangle has none, and viewers show it flat."""
    normal_faces: Int[np.ndarray, "f 3"] | None = None


def read_mesh(path: Path) -> InputMesh:
    """Return the triangles of a mesh file.

    Raises:
        InputError: no such file, another format, unreadable, no faces, NaN or infinite vertices, indices out
            of range, no extent.
    """
    check_file(path)
    suffix = path.suffix.lower()
    if suffix in (".glb", ".gltf"):
        return _check(_read_gltf(path), path)
    return _check(_read_obj(path) if suffix == ".obj" else _read_other(path, suffix), path)


def _read_obj(path: Path) -> InputMesh:
    arrays = parse_obj(path)
    has_uv = len(arrays.faces) > 0 and bool((arrays.uv_faces >= 0).all())
    if has_uv and arrays.uv_faces.max() >= len(arrays.uv):
        raise InputError(
            f"{path}: a face uses texture point {arrays.uv_faces.max() + 1} of {len(arrays.uv)}; export the "
            "mesh again, or without texture coordinates"
        )
    normals = arrays.normal_faces
    has_normals = len(normals) > 0 and 0 <= normals.min() <= normals.max() < len(arrays.normals)
    has_normals = has_normals and bool(np.isfinite(arrays.normals[normals]).all())
    return InputMesh(
        arrays.vertices,
        _narrow(arrays.faces, len(arrays.vertices), path),
        arrays.part,
        arrays.names,
        arrays.uv * [1, -1] + [0, 1] if has_uv else None,
        arrays.uv_faces.astype(np.int32) if has_uv else None,
        int((arrays.uv_faces < 0).any(axis=1).sum()) if (arrays.uv_faces >= 0).any() else 0,
        arrays.normals if has_normals else None,
        arrays.normal_faces.astype(np.int32) if has_normals else None,
    )


def _read_gltf(path: Path) -> InputMesh:
    _, pieces = read_gltf(path)
    parts = [_Part(*_outwards(piece), piece.uv, piece.normals) for piece in pieces]
    return _joined(parts, path, [piece.name for piece in pieces])


def _outwards(piece: Piece) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Return vertices and faces; those of a mirror image, which is inside out, are turned."""
    return piece.vertices, piece.faces[:, ::-1] if piece.mirrored else piece.faces


def _read_other(path: Path, suffix: str) -> InputMesh:
    """Read with trimesh what is left after the checks that it lacks."""
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
            # trimesh has another class for what _check would name
            parts = [
                _Part(np.concatenate([c.vertices for c in scene.geometry.values()]), _NO_FACES, None, None)
            ]
        return _joined(parts, path, [path.stem] * len(parts))
    except InputError:
        raise
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


class _Part(NamedTuple):
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "v 2"] | None
    normals: Float[np.ndarray, "v 3"] | None


def _part(geometry: trimesh.Trimesh, *, welded: bool) -> _Part:
    """Return what trimesh read. `welded`: corners at one position are one vertex; STL has no indices."""
    points = np.asarray(geometry.vertices, np.float64)
    index = np.asarray(geometry.faces, np.int64).reshape(-1, 3)
    if welded:
        points, inverse = np.unique(points, axis=0, return_inverse=True)
        return _Part(points, inverse.reshape(-1)[index], None, None)
    uv = getattr(geometry.visual, "uv", None)
    has_uv = uv is not None and len(uv) == len(points)
    raw = geometry.metadata.get("_ply_raw", {}).get("vertex", {}).get("properties", {})
    has_normals = {"nx", "ny", "nz"} <= set(raw)  # trimesh makes some where a file has none
    return _Part(
        points,
        index,
        np.asarray(uv, np.float64)[:, :2] * [1, -1] + [0, 1] if has_uv else None,
        np.asarray(geometry.vertex_normals, np.float64) if has_normals else None,
    )


def _joined(parts: list[_Part], path: Path, names: list[str]) -> InputMesh:
    """Put parts into one mesh. Texture points and normals are taken where every part has them."""
    start, faces = 0, []
    for part in parts:
        _narrow(part.faces, len(part.vertices), path)
        faces.append(part.faces + start)
        start += len(part.vertices)
    index = np.concatenate(faces).astype(np.int32) if faces else np.zeros((0, 3), np.int32)
    sizes = [len(part.faces) for part in parts]
    uv = [part.uv for part in parts if part.uv is not None]
    normals = [part.normals for part in parts if part.normals is not None]
    has_uv, has_normals = len(uv) == len(parts) > 0, len(normals) == len(parts) > 0
    return InputMesh(
        np.concatenate([part.vertices for part in parts]) if parts else np.zeros((0, 3)),
        index,
        np.repeat(np.arange(len(parts), dtype=np.int32), sizes),
        tuple(names),
        np.concatenate(uv) if has_uv else None,
        index if has_uv else None,
        sum(size for size, part in zip(sizes, parts, strict=True) if part.uv is None) if uv else 0,
        np.concatenate(normals) if has_normals else None,
        index if has_normals else None,
    )


def _narrow(faces: Int[np.ndarray, "f 3"], count: int, path: Path) -> Int[np.ndarray, "f 3"]:
    """Return indices as int32 after checking that there are so many vertices."""
    if len(faces) and (faces.min() < 0 or faces.max() >= count):
        raise InputError(
            f"{path}: face indices run from {faces.min()} to {faces.max()} counted from 0, expected at most "
            f"{count - 1} for {count} vertices; repair or export the mesh again"
        )
    return faces.astype(np.int32)


def _check(mesh: InputMesh, path: Path) -> InputMesh:
    if len(mesh.vertices) and not len(mesh.faces):
        raise InputError(
            f"{path}: {len(mesh.vertices)} points but no faces; a point cloud is no mesh: give triangles"
        )
    check_mesh(Mesh(mesh.vertices, mesh.faces), str(path))
    check_count(len(mesh.faces), path)
    used = mesh.vertices[mesh.faces]
    with np.errstate(over="ignore"):
        extent = float(np.ptp(used.reshape(-1, 3), axis=0).max())
    if not LEAST_EXTENT <= extent <= MOST_EXTENT:
        raise InputError(
            f"{path}: the mesh is {extent:g} units wide, expected {LEAST_EXTENT:g} to {MOST_EXTENT:g}; "
            "scale it"
        )
    if (far := float(np.abs(used).max())) > MOST_EXTENT:
        raise InputError(
            f"{path}: reaches {far:g} units from the origin, expected at most {MOST_EXTENT:g}; move the mesh"
        )
    first, second, third = (used[:, k] / extent for k in range(3))
    if not np.cross(second - first, third - first).any():
        raise InputError(f"{path}: none of its {len(mesh.faces)} faces has an area; repair the mesh")
    return mesh
