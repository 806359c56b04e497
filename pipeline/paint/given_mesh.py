"""A given mesh in the two forms that painting needs: as the file has it, and as the cameras see it.

The asset keeps the file's positions, in float64; rendering works on a copy that is turned (+Y up, front
+Z), centred on its bounding box and scaled so that its farthest vertex lies at distance 1. All of it is
float64, so a mesh at 1e6 with an extent of 1e-3 is painted like the same mesh at the origin.

Letters: v vertices, f triangles, t texture points.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pipeline import arrays
from pipeline.documents import parse_json
from pipeline.errors import InputError
from pipeline.mesh.coloured import ColouredMesh
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.readers import InputMesh

# Positions that differ by less than rounding must not lead to other charts: a hundredth of a texel at 1024.
GRID = 2.0**16


class PaintMesh(NamedTuple):
    """The file's mesh, its texture points, and where its vertices are in the unit ball."""

    vertices: Float[np.ndarray, "v 3"]
    """float64, as in the file."""
    unit: Float[np.ndarray, "v 3"]
    """float64, in the ball of radius 1 around the origin, +Y up, the front facing +Z."""
    faces: Int[np.ndarray, "f 3"]
    part: Int[np.ndarray, " f"]
    names: tuple[str, ...]
    uv: Float[np.ndarray, "t 2"] | None
    """In [0, 1], origin at the top left; None: not wanted (one colour a face)."""
    uv_faces: Int[np.ndarray, "f 3"] | None

    def scaled(self, radius: float) -> Mesh:
        """Return the mesh for the cameras, in the ball of that radius."""
        return Mesh(self.unit * radius, self.faces, self.uv, self.uv_faces)


def to_unit_ball(mesh: InputMesh | ColouredMesh, up: str, front: str) -> Float[np.ndarray, "v 3"]:
    """Return the vertices turned, centred and scaled; `up` and `front` name axes of the file, such as +z.

    Raises:
        InputError: the faces have no extent.
    """
    used = np.unique(mesh.faces)
    low, high = mesh.vertices[used].min(axis=0), mesh.vertices[used].max(axis=0)
    centred = mesh.vertices - (low + (high - low) / 2)
    radius = np.linalg.norm(centred[used], axis=1).max()
    y, z = _axis(up), _axis(front)
    rotation = np.stack([np.cross(y, z), y, z])
    return np.round(centred / radius @ rotation.T * GRID) / GRID


def _axis(name: str) -> Float[np.ndarray, " 3"]:
    direction = np.zeros(3)
    direction["xyz".index(name[1])] = 1.0 if name[0] == "+" else -1.0
    return direction


def save_paint_mesh(path: Path, mesh: PaintMesh) -> None:
    """Write the mesh; equal meshes give equal bytes."""
    values = mesh._asdict()
    values["names"] = np.frombuffer(json.dumps(mesh.names).encode(), np.uint8)
    path.write_bytes(arrays.pack({name: value for name, value in values.items() if value is not None}))


def load_paint_mesh(path: Path) -> PaintMesh:
    """Read what `save_paint_mesh` wrote. Raises InputError if the file is damaged."""
    try:
        values = dict(arrays.unpack(path.read_bytes()))
        names = tuple(parse_json(values.pop("names").tobytes()))
        return PaintMesh(**{"uv": None, "uv_faces": None, **values}, names=names)  # type: ignore[arg-type]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is damaged ({error}): delete it and run again") from None
