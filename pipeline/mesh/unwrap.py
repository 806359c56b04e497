"""Texture coordinates by xatlas, packed to fit the texture exactly.

Letters: f faces, t texture points.
"""

from __future__ import annotations

import ctypes
import os
from collections import deque
from typing import Any

import numpy as np
import xatlas
from jaxtyping import Float, Int

from pipeline.errors import InputError
from pipeline.mesh.mesh import Mesh, face_areas, texture_points
from pipeline.mesh.texture import surface_texels
from pipeline.mesh.topology import face_components

FULL = 0.95  # share of the texture that charts and their padding would fill at the first scale tried
SHRINK = 0.985  # least step by which the scale falls while the charts do not fit
TRIES = 60
MANY = 2000  # so many charts take a second a try: fewer tries count for more than the last percent of space
SMALL = 50_000  # faces up to which an atlas is kept for a while
RIM = 4000  # edges around a chart up to which its texels are filtered exactly: time grows with their square
ROOM = 8  # charts are at least so many paddings wide, on average: narrower ones would be all padding

_recent: deque[xatlas.Atlas] = deque(maxlen=16)


def _atlas(faces: int) -> xatlas.Atlas:
    """Return an empty atlas that outlives the next ones.

    To destroy one ends its threads, and waits for ever for one that is just about to wait for work: xatlas'
    TaskScheduler tells it outside the lock. Some atlases later they all wait: of 30,000 made and destroyed
    none hung with 16 in between, one in some thousands with none or 4. With many faces the last part of the
    packing, which is one thread's, gives them that time.
    """
    atlas = xatlas.Atlas()
    if faces <= SMALL:
        _recent.append(atlas)
    return atlas


def _keep_for_ever() -> None:
    """Never destroy the atlases of the process that this one is a fork of: their threads are not here."""
    for atlas in _recent:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(atlas))
    _recent.clear()


os.register_at_fork(after_in_child=_keep_for_ever)


def unwrap_mesh(mesh: Mesh, resolution: int, padding: int) -> tuple[Mesh, dict[str, Any]]:
    """Return the mesh with texture coordinates in [0, 1], the same vertices and faces, and metrics about
    them.

    Args:
        mesh: at most some ten thousands of faces: xatlas merges charts in more than linear time.
        resolution: texture size that the charts are packed for [texels].
        padding: texels kept free around every chart at that size; less where many charts would leave little
            but padding, and halved until the charts fit, at the least 1. `metrics["padding"]` tells.
    """
    atlas = _cut(mesh, resolution, 1.0)
    if not atlas.chart_count:
        largest = float(face_areas(mesh).max())
        if largest <= 0:
            raise InputError(f"none of {len(mesh.faces)} faces has an area; repair the mesh")
        atlas = _cut(mesh, resolution, largest**-0.5)
    source, index, uv = atlas[0]
    if not np.array_equal(source[index], mesh.faces):
        raise InputError("xatlas left out or reordered faces: the mesh is degenerate; repair it")
    # xatlas divides by the width and the height of its own atlas; undo that to get lengths of the surface.
    flat = uv.astype(np.float64) * [atlas.width, atlas.height] / atlas.texels_per_unit
    texels, charts = None, int(atlas.chart_count)
    widest = min(padding, max(1, int(resolution / (ROOM * np.sqrt(charts)))))
    for room in (widest >> halvings for halvings in range(widest.bit_length() or 1)):
        texels, charts = _pack(flat, index.astype(np.int32), resolution, room, charts)
        if texels is not None:
            break
    if texels is None:
        raise InputError(
            f"{charts} charts do not fit a texture of {resolution}; raise unwrap.resolution (of a MESH: "
            "prepare.resolution), or give fewer faces (clean.faces): a smoother mesh has fewer charts"
        )
    unwrapped = mesh._replace(uv=(texels / resolution).astype(np.float32), uv_faces=index.astype(np.int32))
    return unwrapped, {"charts": charts, "padding": room, **uv_figures(unwrapped, resolution)}


def _cut(mesh: Mesh, resolution: int, scale: float) -> xatlas.Atlas:
    """Return xatlas' charts of the mesh enlarged by a factor: faces smaller than 1e-7 are none to it, so
    small things far apart have no chart at their own size."""
    atlas = _atlas(len(mesh.faces))
    atlas.add_mesh((mesh.vertices * scale).astype(np.float32), mesh.faces.astype(np.uint32))
    hint = xatlas.PackOptions()
    hint.resolution = resolution
    atlas.generate(xatlas.ChartOptions(), hint)
    return atlas


def longest_rim(index: Int[np.ndarray, "f 3"], points: int) -> int:
    """Return how many edges of a single face the chart with most of them has; `points`: texture points."""
    chart = face_components(Mesh(np.zeros((points, 3), np.float32), index))
    ends = np.sort(index[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).astype(np.int64)
    _, first, faces = np.unique(ends @ [points, 1], return_index=True, return_counts=True)
    return int(np.bincount(chart[first[faces == 1] // 3], minlength=1).max())


def _pack(
    flat: Float[np.ndarray, "t 2"], index: Int[np.ndarray, "f 3"], resolution: int, padding: int, charts: int
) -> tuple[Float[np.ndarray, "t 2"] | None, int]:
    """Return texture coordinates [texels] at the largest scale tried that fits (None: no scale did), and the
    number of charts.

    Asked for a resolution, xatlas takes it as a hint and overshoots by a fifth; asked for a scale, it obeys.
    Only the packing is repeated (a tenth of a second each), not the charts.
    """
    if charts * (1 + padding) ** 2 > resolution**2:  # not even with a texel each
        return None, charts
    edge_1, edge_2 = flat[index[:, 1]] - flat[index[:, 0]], flat[index[:, 2]] - flat[index[:, 0]]
    area = 0.5 * np.abs(edge_1[:, 0] * edge_2[:, 1] - edge_1[:, 1] * edge_2[:, 0]).sum()
    # Squares of equal size, each with its padding on two sides.
    scale = (resolution * np.sqrt(FULL) - padding * np.sqrt(charts)) / np.sqrt(area)
    exact = longest_rim(index, len(flat)) <= RIM
    for _ in range(TRIES):
        atlas = _atlas(len(index))
        atlas.add_uv_mesh(flat.astype(np.float32), index.astype(np.uint32))
        pack = xatlas.PackOptions()
        pack.padding = padding
        pack.bilinear = exact
        pack.texels_per_unit = float(scale)
        atlas.generate(xatlas.ChartOptions(), pack)
        source, packed_index, uv = atlas[0]
        longest = max(atlas.width, atlas.height)
        scale *= min(SHRINK, (resolution / longest) ** (0.25 if charts < MANY else 0.9))
        if longest <= resolution and atlas.atlas_count == 1:
            texels = np.empty((len(flat), 2), np.float64)
            texels[source] = uv.astype(np.float64) * [atlas.width, atlas.height]
            if not np.array_equal(source[packed_index], index):
                raise InputError("xatlas reordered faces while packing: the mesh is degenerate; repair it")
            return texels, int(atlas.chart_count)
    return None, int(atlas.chart_count)


def uv_figures(mesh: Mesh, resolution: int) -> dict[str, float]:
    """Return coverage and overlap (shares of texels) and stretch of the texture coordinates.

    Stretch is the L2 measure of Sander et al. 2001: the root mean square, over the surface, of how many times
    longer a texel is on the surface than on average; 1 is a map that keeps all lengths.
    """
    uv, uv_faces = texture_points(mesh)
    texels = surface_texels(mesh, resolution)
    corners, flat = mesh.vertices.astype(np.float64)[mesh.faces], uv.astype(np.float64)[uv_faces]
    edge_1, edge_2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    flat_1, flat_2 = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    twice_area = flat_1[:, 0] * flat_2[:, 1] - flat_1[:, 1] * flat_2[:, 0]
    area, chart_area = face_areas(mesh), 0.5 * np.abs(twice_area)
    valid = (chart_area > 1e-12) & (area > 1e-12)
    inverse = 1.0 / np.where(valid, twice_area, 1.0)[:, None]
    along_u = (edge_1 * flat_2[:, 1:] - edge_2 * flat_1[:, 1:]) * inverse
    along_v = (edge_2 * flat_1[:, :1] - edge_1 * flat_2[:, :1]) * inverse
    square = 0.5 * ((along_u**2).sum(axis=1) + (along_v**2).sum(axis=1))
    mean_square = (square * area)[valid].sum() / area[valid].sum()
    return {
        "coverage": len(texels.place) / resolution**2,
        "overlap": texels.overlap,
        "stretch": float(np.sqrt(mean_square * chart_area[valid].sum() / area[valid].sum())),
        "degenerate_faces": int((~valid).sum()),
        "texels_per_unit": float(resolution * np.sqrt(chart_area.sum() / area.sum())),
    }
