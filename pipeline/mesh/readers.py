"""A mesh that a user gives: OBJ, PLY, STL, OFF, GLB or glTF, as plain arrays, or one line about its fault.

Nothing is repaired: positions, faces and part names are those of the file. Letters: v vertices, f triangles,
t texture points.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pipeline.errors import InputError
from pipeline.mesh.file_checks import check_file
from pipeline.mesh.gltf_reader import Piece, read_gltf
from pipeline.mesh.limits import check_count
from pipeline.mesh.mesh import Mesh, check_mesh
from pipeline.mesh.obj_reader import parse_obj
from pipeline.mesh.part import Part

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
        mesh = _read_gltf(path)
    elif suffix == ".obj":
        mesh = _read_obj(path)
    else:
        from pipeline.mesh.trimesh_reader import read_parts  # with trimesh, which takes most of a second

        parts = read_parts(path)
        mesh = _joined(parts, path, [path.stem] * len(parts))
    return _check(mesh, path)


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
    parts = [Part(*_outwards(piece), piece.uv, piece.normals) for piece in pieces]
    return _joined(parts, path, [piece.name for piece in pieces])


def _outwards(piece: Piece) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Return vertices and faces; those of a mirror image, which is inside out, are turned."""
    return piece.vertices, piece.faces[:, ::-1] if piece.mirrored else piece.faces


def _joined(parts: list[Part], path: Path, names: list[str]) -> InputMesh:
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
