"""Triangle meshes: the type, its normals, and the files that hold it.

Letters: v vertices, f faces, t texture points, c = (texture point, vertex) pairs. Positions are in scene
units (right-handed, +Y up, the front faces +Z), faces counter-clockwise seen from outside. Texture
coordinates have their origin at the top left, as glTF wants; OBJ files count from the bottom, so `read_obj`
and `write_obj` flip them.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pipeline.errors import InputError


class Mesh(NamedTuple):
    """Positions and texture points are indexed apart, as in OBJ: a chart border splits no vertex."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "t 2"] | None = None
    uv_faces: Int[np.ndarray, "f 3"] | None = None


class SplitMesh(NamedTuple):
    """One index for everything, as glTF and renderers want: vertices on chart borders are repeated."""

    vertices: Float[np.ndarray, "c 3"]
    normals: Float[np.ndarray, "c 3"]
    uv: Float[np.ndarray, "c 2"]
    faces: Int[np.ndarray, "f 3"]


def texture_points(mesh: Mesh) -> tuple[Float[np.ndarray, "t 2"], Int[np.ndarray, "f 3"]]:
    """Return the texture points and the faces' indices into them. Raises ValueError if there are none."""
    if mesh.uv is None or mesh.uv_faces is None:
        raise ValueError("the mesh has no texture coordinates: unwrap it first")
    return mesh.uv, mesh.uv_faces


def face_normals(mesh: Mesh) -> Float[np.ndarray, "f 3"]:
    """Return the cross product of two edges of every face: its length is twice the area (float64)."""
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def face_areas(mesh: Mesh) -> Float[np.ndarray, " f"]:
    """Return the area of every face [square scene units]."""
    return np.asarray(0.5 * np.linalg.norm(face_normals(mesh), axis=1), np.float64)


def vertex_normals(mesh: Mesh) -> Float[np.ndarray, "v 3"]:
    """Return unit normals (float64), the mean of the adjacent faces' weighted by their area.

    A vertex whose faces cancel out has no direction of its own and gets +Y.
    """
    weighted = face_normals(mesh)
    count = len(mesh.vertices)
    columns = [
        np.bincount(mesh.faces.ravel(), np.repeat(weighted[:, axis], 3), minlength=count) for axis in range(3)
    ]
    normals = np.stack(columns, axis=1)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 0, normals / np.maximum(length, np.finfo(np.float64).tiny), [0.0, 1.0, 0.0])


def split_seams(mesh: Mesh) -> SplitMesh:
    """Return the mesh with one index for position, normal and texture point; normals stay smooth across
    seams.
    """
    uv, uv_faces = texture_points(mesh)
    pairs = np.stack([mesh.faces.ravel(), uv_faces.ravel()], axis=1)
    unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
    vertex, texture_point = unique[:, 0], unique[:, 1]
    return SplitMesh(
        mesh.vertices[vertex].astype(np.float32),
        vertex_normals(mesh)[vertex].astype(np.float32),
        uv[texture_point].astype(np.float32),
        inverse.reshape(-1, 3).astype(np.int32),
    )


def used_vertices(mesh: Mesh) -> Mesh:
    """Return the mesh without the vertices that no face uses (texture coordinates are dropped)."""
    used, inverse = np.unique(mesh.faces, return_inverse=True)
    return Mesh(mesh.vertices[used], inverse.reshape(-1, 3).astype(np.int32))


def bounding_radius(mesh: Mesh) -> float:
    """Return the greatest distance of a face's vertex from the origin, which every camera looks at [scene
    units]; a vertex that no face uses is not seen."""
    used = mesh.vertices[np.unique(mesh.faces)]
    return float(np.linalg.norm(used.astype(np.float64), axis=1).max())


def check_mesh(mesh: Mesh, source: str) -> Mesh:
    """Return the mesh, or raise InputError if it is empty, not finite, or its indices are out of range."""
    if not len(mesh.faces):
        raise InputError(f"{source}: the mesh has no faces; give a mesh made of triangles")
    if not np.isfinite(mesh.vertices).all():
        bad = int((~np.isfinite(mesh.vertices).all(axis=1)).sum())
        raise InputError(
            f"{source}: {bad} vertices are NaN or infinite; expected finite numbers; repair the mesh"
        )
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise InputError(
            f"{source}: face indices run from {mesh.faces.min()} to {mesh.faces.max()}, "
            f"expected 0 to {len(mesh.vertices) - 1}; repair the mesh"
        )
    return mesh


def read_ply(path: Path) -> Mesh:
    """Return the mesh of a PLY file, its vertices in the file's order. Raises InputError if it is not one."""
    import trimesh  # takes a second, and many need no PLY

    try:
        loaded = trimesh.load_mesh(path, file_type="ply", process=False)
        mesh = Mesh(np.asarray(loaded.vertices, np.float32), np.asarray(loaded.faces, np.int32))
    except (ValueError, IndexError, KeyError, AttributeError, TypeError, OverflowError) as error:
        raise InputError(f"{path}: not a readable PLY mesh ({error}); make it again") from error
    return check_mesh(mesh, str(path))


def write_ply(path: Path, mesh: Mesh) -> None:
    """Write positions (float32) and faces as binary PLY; texture coordinates are not kept."""
    import trimesh

    data = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    path.write_bytes(trimesh.exchange.ply.export_ply(data, vertex_normal=False))


def read_obj(path: Path) -> Mesh:
    """Return the mesh of an OBJ file that `write_obj` wrote: triangles, every corner `v/vt` or `v/vt/vn`.

    trimesh would split vertices at chart borders, which loses the connectivity that this keeps.
    Raises InputError for anything else.
    """
    vertices, uv, corners = [], [], []
    try:
        for line in path.read_text(encoding="ascii").splitlines():
            key, _, rest = line.partition(" ")
            if key == "v":
                vertices.append([float(word) for word in rest.split()])
            elif key == "vt":
                uv.append([float(word) for word in rest.split()])
            elif key == "f":
                corners.append([[int(index) for index in word.split("/")[:2]] for word in rest.split()])
        index = np.array(corners, np.int64).reshape(-1, 3, 2) - 1
        flipped = np.array(uv, np.float64).reshape(-1, 2) * [1, -1] + [0, 1]
        mesh = Mesh(
            np.array(vertices, np.float32).reshape(-1, 3),
            index[..., 0].astype(np.int32),
            flipped.astype(np.float32),
            index[..., 1].astype(np.int32),
        )
    except ValueError as error:
        raise InputError(f"{path}: not an OBJ file of textured triangles ({error}); make it again") from error
    check_mesh(mesh, str(path))
    check_mesh(
        Mesh(np.zeros((len(flipped), 3), np.float32), index[..., 1].astype(np.int32)), f"{path} (texture)"
    )
    return mesh


def write_obj(
    path: Path, mesh: Mesh, material_library: str | None = None, name: str = "", normals: bool = False
) -> None:
    """Write an unwrapped mesh as OBJ; `material_library` names an MTL file whose material, like the object,
    is called `name`.

    Nine digits hold a float32 exactly, so that reading gives the same positions back.
    """
    uv, uv_faces = texture_points(mesh)
    lines = [f"mtllib {material_library}", f"o {name}"] if material_library else []
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.tolist()]
    flipped = uv.astype(np.float64) * [1, -1] + [0, 1]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in flipped.tolist()]
    if normals:
        lines += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertex_normals(mesh).tolist()]
    lines += [f"usemtl {name}"] if material_library else []
    corners = [mesh.faces, uv_faces, mesh.faces] if normals else [mesh.faces, uv_faces]
    for face in (np.stack(corners, axis=-1) + 1).tolist():
        lines.append("f " + " ".join("/".join(map(str, corner)) for corner in face))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
