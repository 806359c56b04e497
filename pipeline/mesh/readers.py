"""A mesh that a user gives: OBJ, PLY, STL, OFF, GLB or glTF, as plain arrays, or one line about its fault.

Nothing is repaired: positions, faces and part names are those of the file. Letters: v vertices, f triangles,
t texture points.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float, Int

from pipeline.errors import InputError
from pipeline.mesh.file_checks import check_file
from pipeline.mesh.mesh import Mesh, check_mesh
from pipeline.mesh.obj_reader import parse_obj

MOST_FACES = 5_000_000
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


def read_mesh(path: Path) -> InputMesh:
    """Return the triangles of a mesh file.

    Raises:
        InputError: no such file, another format, unreadable, no faces, NaN or infinite vertices, indices out
            of range, no extent.
    """
    check_file(path)
    suffix = path.suffix.lower()
    mesh = _read_obj(path) if suffix == ".obj" else _read_other(path, suffix)
    return _check(mesh, path)


def _read_obj(path: Path) -> InputMesh:
    arrays = parse_obj(path)
    has_uv = len(arrays.faces) > 0 and bool((arrays.uv_faces >= 0).all())
    if has_uv and arrays.uv_faces.max() >= len(arrays.uv):
        raise InputError(
            f"{path}: a face uses texture point {arrays.uv_faces.max() + 1} of {len(arrays.uv)}; export the "
            "mesh again, or without texture coordinates"
        )
    return InputMesh(
        arrays.vertices,
        _narrow(arrays.faces, len(arrays.vertices), path),
        arrays.part,
        arrays.names,
        arrays.uv * [1, -1] + [0, 1] if has_uv else None,
        arrays.uv_faces.astype(np.int32) if has_uv else None,
        int((arrays.uv_faces < 0).any(axis=1).sum()) if (arrays.uv_faces >= 0).any() else 0,
    )


def _read_other(path: Path, suffix: str) -> InputMesh:
    """Read with trimesh what is left after the checks that it lacks."""
    try:
        scene = trimesh.load_scene(path, file_type=suffix[1:], process=False, validate=False)
        order = {name: row for row, name in enumerate(scene.geometry)}
        placed = [(label, *scene.graph[node]) for node, label in _labels(scene.graph, order).items()]
        placed.sort(key=lambda item: (order[item[2]], item[0]))
        parts = [
            (label, scene.geometry[name], np.asarray(transform, np.float64))
            for label, transform, name in placed
            if isinstance(scene.geometry[name], trimesh.Trimesh)
        ]
        return _merge(parts, path, welded=suffix == ".stl", named=suffix in (".glb", ".gltf"))
    except InputError:
        raise
    except (
        Exception
    ) as error:  # trimesh lets IndexError, JSONDecodeError, ModuleNotFoundError and more escape
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{path}: not a readable {suffix[1:]} mesh ({said}); export it again") from None


def _labels(graph: Any, order: dict[str, int]) -> dict[str, str]:
    """Return the name of every node that shows something. trimesh puts the primitives of a mesh that has
    several into nodes below the mesh's, with random letters: here these are counted, in the file's order,
    past names that other nodes have."""
    count: Counter[str] = Counter()
    labels, taken = {}, set(graph.nodes)
    for node in sorted(graph.nodes_geometry, key=lambda node: order[graph[node][1]]):
        parent = graph.transforms.parents.get(node, "")
        if re.fullmatch(re.escape(parent) + "_[0-9a-f]{6}", node):
            while (label := f"{parent}_{count[parent]}") in taken:
                count[parent] += 1
            taken.add(label)
            labels[node] = label
        else:
            labels[node] = node
    return labels


def _merge(parts: list[tuple[str, Any, np.ndarray]], path: Path, *, welded: bool, named: bool) -> InputMesh:
    """Put parts into one scene. `welded`: corners at one position are one vertex; STL has no indices."""
    vertices, faces, part, uvs = [], [], [], []
    start = 0
    for row, (_, geometry, transform) in enumerate(parts):
        points = np.asarray(geometry.vertices, np.float64)
        index = np.asarray(geometry.faces, np.int64).reshape(-1, 3)
        if welded:
            points, inverse = np.unique(points, axis=0, return_inverse=True)
            index = inverse.reshape(-1)[index]
        _narrow(index, len(points), path)
        if not np.array_equal(transform, np.eye(4)):
            points = points @ transform[:3, :3].T + transform[:3, 3]
            if np.linalg.det(transform[:3, :3]) < 0:  # a mirror image turns its faces inside out
                index = index[:, ::-1]
        vertices.append(points)
        faces.append(index + start)
        part.append(np.full(len(index), row, np.int32))
        uv = getattr(geometry.visual, "uv", None)
        uvs.append(None if welded or uv is None or len(uv) != len(points) else np.asarray(uv, np.float64))
        start += len(points)
    index = np.concatenate(faces).astype(np.int32) if faces else np.zeros((0, 3), np.int32)
    known = [uv[:, :2] for uv in uvs if uv is not None]
    has_uv = len(known) == len(parts) > 0
    return InputMesh(
        np.concatenate(vertices) if vertices else np.zeros((0, 3)),
        index,
        np.concatenate(part) if part else np.zeros(0, np.int32),
        tuple(node if named else path.stem for node, _, _ in parts),
        np.concatenate(known) * [1, -1] + [0, 1] if has_uv else None,
        index if has_uv else None,
        sum(len(g.faces) for (_, g, _), uv in zip(parts, uvs, strict=True) if uv is None) if known else 0,
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
    if len(mesh.faces) > MOST_FACES:
        raise InputError(
            f"{path}: {len(mesh.faces)} faces, expected at most {MOST_FACES}; decimate the mesh first"
        )
    used = mesh.vertices[mesh.faces]
    with np.errstate(over="ignore"):
        extent = float(np.ptp(used.reshape(-1, 3), axis=0).max())
    if not LEAST_EXTENT <= extent <= MOST_EXTENT:
        raise InputError(
            f"{path}: the mesh is {extent:g} units wide, expected {LEAST_EXTENT:g} to {MOST_EXTENT:g}; "
            "scale it"
        )
    first, second, third = (used[:, k] / extent for k in range(3))
    if not np.cross(second - first, third - first).any():
        raise InputError(f"{path}: none of its {len(mesh.faces)} faces has an area; repair the mesh")
    return mesh
