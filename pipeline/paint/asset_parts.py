"""The painted mesh as files: the positions of the file that was given, in its parts, with new colours.

Letters: v vertices, f triangles, n normals, c = (vertex, texture point, normal) triples of a part.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pipeline.mesh.gltf import Part
from pipeline.mesh.mesh import texture_points
from pipeline.paint.given_mesh import PaintMesh

EXACT = 2.0**-22
"""Rounding of positions to float32 that is accepted, as a share of the mesh's extent."""


def float32_place(vertices: Float[np.ndarray, "v 3"]) -> tuple[float, float, float]:
    """Return the translation that leaves positions which float32 can hold: none, unless rounding would show.

    It is a whole multiple of a power of two near the mesh's extent, so that taking it off is exact.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = float((high - low).max())
    if np.abs(vertices.astype(np.float32) - vertices).max() <= EXACT * extent:
        return 0.0, 0.0, 0.0
    unit = 2.0 ** np.floor(np.log2(extent))
    x, y, z = (np.round((low + high) / 2 / unit) * unit).tolist()
    return x, y, z


def linear_light(colours: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Return sRGB colours as linear light (IEC 61966-2-1)."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


class Normals(NamedTuple):
    """Of the file that was given."""

    values: Float[np.ndarray, "n 3"]
    """Of any length."""
    faces: Int[np.ndarray, "f 3"]

    def unit(self) -> Float[np.ndarray, "n 3"]:
        """Return them with length 1; +Y where there is no direction."""
        length = np.linalg.norm(self.values, axis=1, keepdims=True)
        return np.where(length > 1e-12, self.values / np.maximum(length, 1e-12), [0.0, 1.0, 0.0])


def painted_parts(
    mesh: PaintMesh,
    place: tuple[float, float, float],
    colours: Float[np.ndarray, "f 3"] | None,
    normals: Normals | None = None,
) -> list[Part]:
    """Return the parts for a GLB file translated by `place`: with texture points, or with a colour a face.

    A vertex is repeated only where its faces differ in texture point (or colour) or normal. A file without
    normals gets none: made-up ones would round hard edges.
    """
    if colours is None:
        uv, of_corner = texture_points(mesh.scaled(1.0))
    else:
        shades, of_face = np.unique(linear_light(colours), axis=0, return_inverse=True)
        of_corner = np.repeat(of_face.reshape(-1, 1), 3, axis=1)
    positions = (mesh.vertices - place).astype(np.float32)
    directions = None if normals is None else normals.unit().astype(np.float32)
    of_normal = np.zeros_like(of_corner) if normals is None else normals.faces
    parts = []
    for row, name in enumerate(mesh.names):
        mine = mesh.part == row
        if not mine.any():
            continue
        pairs = np.stack([index[mine].ravel() for index in (mesh.faces, of_corner, of_normal)], axis=1)
        unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
        faces = inverse.reshape(-1, 3).astype(np.int32)
        vertices = positions[unique[:, 0]]
        shown = None if directions is None else directions[unique[:, 2]]
        if colours is None:
            parts.append(Part(name, vertices, faces, shown, uv[unique[:, 1]].astype(np.float32)))
        else:
            inks = shades[unique[:, 1]].astype(np.float32)
            parts.append(Part(name, vertices, faces, shown, colours=inks))
    return parts


def painted_obj(
    mesh: PaintMesh,
    library: str | None,
    colours: Float[np.ndarray, "f 3"] | None,
    normals: Normals | None = None,
) -> str:
    """Return OBJ text: every digit of the positions, parts as objects, one material or vertex colours.

    `library` names the MTL file. With `colours`, vertices are repeated for every colour (sRGB) they show, in
    the form `v x y z r g b` that MeshLab and Blender read.
    """
    lines = [f"mtllib {library}"] if library else []
    places = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    if colours is None:
        uv, uv_faces = texture_points(mesh.scaled(1.0))
        lines += places
        flipped = uv.astype(np.float64) * [1, -1] + [0, 1]
        lines += [f"vt {u:.9g} {v:.9g}" for u, v in flipped.tolist()]
        corners = np.stack([mesh.faces, uv_faces], axis=-1) + 1
    else:
        shades, of_face = np.unique(colours, axis=0, return_inverse=True)
        pairs = np.stack([mesh.faces.ravel(), np.repeat(of_face.ravel(), 3)], axis=1)
        unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
        inks = [" ".join(f"{value:.4f}" for value in shade) for shade in shades.tolist()]
        lines += [f"{places[vertex]} {inks[shade]}" for vertex, shade in unique.tolist()]
        corners = inverse.reshape(-1, 3, 1) + 1
    if normals is not None:
        lines += [f"vn {x:.7g} {y:.7g} {z:.7g}" for x, y, z in normals.unit().tolist()]
    separator = "/" if colours is None else "//"  # with colours there are no texture points
    for row, name in enumerate(mesh.names):
        lines += [f"o {' '.join(name.split()) or 'part'}", *(["usemtl albedo"] if library else [])]
        mine = mesh.part == row
        texts = [["/".join(map(str, corner)) for corner in face] for face in corners[mine].tolist()]
        if normals is not None:
            rows = (normals.faces[mine] + 1).tolist()
            texts = [
                [f"{t}{separator}{n}" for t, n in zip(*pair, strict=True)]
                for pair in zip(texts, rows, strict=True)
            ]
        lines += ["f " + " ".join(face) for face in texts]
    return "\n".join(lines) + "\n"
