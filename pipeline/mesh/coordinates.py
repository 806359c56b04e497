"""Texture coordinates for a mesh as people have it: its own if they are usable, else new ones.

Letters: f triangles, t texture points.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.mesh.mesh import Mesh, face_areas
from pipeline.mesh.texture import surface_texels
from pipeline.mesh.unwrap import unwrap_mesh, uv_figures

MOST_OVERLAP = 0.02  # share of the covered texels that several faces may claim
MOST_FLAT = 0.02  # share of the surface that may have no area in the texture
LEAST_COVERAGE = 0.1  # share of the texture that faces have to cover: below, it would be too coarse
TOLERANCE = 1e-4  # exporters' rounding beyond 0 and 1


def uv_fault(mesh: Mesh, resolution: int) -> str:
    """Return why the mesh's own texture coordinates cannot be used, judged at `resolution` texels; "" if they
    can."""
    if mesh.uv is None or mesh.uv_faces is None:
        return "there are none, or not for every face"
    used = mesh.uv[mesh.uv_faces]
    if not np.isfinite(used).all():
        return "some are NaN or infinite"
    low, high = float(used.min()), float(used.max())
    if low < -TOLERANCE or high > 1 + TOLERANCE:
        return f"they run from {low:.6g} to {high:.6g}, outside [0, 1]"
    edges = used[:, 1:] - used[:, :1]
    flat = np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]) < 1e-12
    area = face_areas(mesh)
    if (share := float(area[flat].sum() / area.sum())) > MOST_FLAT:
        return f"{share:.1%} of the surface has no area in the texture"
    texels = surface_texels(mesh, resolution)
    if texels.overlap > MOST_OVERLAP:
        return f"{texels.overlap:.1%} of the covered texels belong to several faces"
    if (share := len(texels.place) / resolution**2) < LEAST_COVERAGE:
        return f"they use {share:.1%} of the texture"
    return ""


def make_coordinates(mesh: Mesh, resolution: int, padding: int, rewrap: bool) -> tuple[Mesh, dict[str, Any]]:
    """Return the mesh with usable texture coordinates, and metrics: `uv` says whose they are, and
    `uv_reason` why not the file's."""
    fault = "asked for" if rewrap else uv_fault(mesh, resolution)
    if not fault:
        assert mesh.uv is not None
        kept = mesh._replace(uv=np.clip(mesh.uv, 0.0, 1.0))
        return kept, {"uv": "the file's", **uv_figures(kept, resolution)}
    wrapped, metrics = unwrap_any(mesh, resolution, padding)
    return wrapped, {"uv": "new (xatlas)", "uv_reason": fault, **metrics}


def unwrap_any(mesh: Mesh, resolution: int, padding: int) -> tuple[Mesh, dict[str, Any]]:
    """Unwrap a mesh that may hold faces without area, which xatlas would leave out: they cover no texel and
    get the texture point of some neighbour. A face that stands there several times, which would cost xatlas
    a chart each, is unwrapped once (what faces the other way is another face). Vertices that share a position
    count as one, so that a chart may go on across them."""
    positions, welded = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = welded.reshape(-1)[mesh.faces].astype(np.int32)
    whole = face_areas(Mesh(positions.astype(np.float32), faces)) > 1e-14
    # Each once, as it is first written, turned so that its lowest vertex comes first.
    turn = (faces[whole].argmin(axis=1)[:, None] + np.arange(3)) % 3
    turned = np.take_along_axis(faces[whole], turn, axis=1)
    _, first, of_whole = np.unique(turned, axis=0, return_index=True, return_inverse=True)
    kept = np.sort(first)
    unwrapped, metrics = unwrap_mesh(Mesh(positions, faces[whole][kept]), resolution, padding)
    assert unwrapped.uv_faces is not None
    of_vertex = np.zeros(len(positions), np.int32)
    of_vertex[unwrapped.faces.ravel()] = unwrapped.uv_faces.ravel()
    uv_faces = of_vertex[faces]
    same = np.searchsorted(kept, first)[of_whole.reshape(-1)]
    again = np.take_along_axis(unwrapped.uv_faces[same], turn[kept][same], axis=1)
    uv_faces[whole] = np.take_along_axis(again, np.argsort(turn, axis=1), axis=1)
    return mesh._replace(uv=unwrapped.uv, uv_faces=uv_faces), {
        **metrics,
        "faces_without_area": int((~whole).sum()),
        "faces_twice": int(whole.sum()) - len(kept),
    }
