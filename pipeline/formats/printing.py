"""An asset as a solid for a printer: closed, in millimetres, +Z up; and what about it is hard to print.

Letters: v vertices, f triangles, n samples.
"""

from __future__ import annotations

from typing import NamedTuple

import igl
import numpy as np
import pymeshlab
from jaxtyping import Float

from pipeline.mesh.mesh import Mesh, face_areas, face_normals
from pipeline.mesh.topology import face_components, signed_volumes, topology

MILLIMETRES = 1000.0
"""A metre."""
WRAP, GAP = 1.0, 0.1
"""Of a surface that is not closed: the smallest opening that the wrap enters, and its distance from the
surface [per cent of the diagonal of the bounding box]."""
RAYS = 4000
"""That measure the walls; their standard error of a share is 0.8 per cent at most."""
WALL = 0.8
"""The least wall that the usual nozzle of 0.4 mm prints whole [mm]: two lines."""
STEEPEST = 45.0
"""Faces that lean out further [degrees from the vertical] are printed into the air."""
BED = 0.2
"""A usual layer [mm]: what is lower lies on the bed."""


class Printable(NamedTuple):
    """What a printer is told of a solid."""

    wall_mm: float
    """Thickness that all but a hundredth of the surface has [mm]."""
    median_wall_mm: float
    thin_share: float
    """Share of the surface whose wall is thinner than `WALL`."""
    overhang_share: float
    """Share of the surface that needs support: it leans out by more than `STEEPEST` and is not on the bed."""
    size_mm: tuple[float, float, float]
    """Width, depth and height."""
    volume_ml: float


def solid(vertices: Float[np.ndarray, "v 3"], faces: np.ndarray) -> tuple[Mesh, bool]:
    """Return the closed surface of an asset (metres, +Y up) in millimetres, +Z up, standing on z = 0 with
    its least x and y at 0; and whether it had to be wrapped.

    A surface that is closed already, once corners at one place are one vertex, keeps its faces; any other is
    wrapped (pymeshlab's alpha wrap, after Portaneri et al. 2022), which closes holes and encloses sheets.
    """
    points, rows = np.unique(vertices, axis=0, return_inverse=True)
    corners = rows.reshape(-1)[faces]
    kept = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    mesh = Mesh(points, corners[kept].astype(np.int32))
    wrapped = not _closed(mesh)
    if wrapped:
        mesh = _wrapped(mesh)
    inside_out = signed_volumes(mesh, face_components(mesh)).sum() < 0
    turned = mesh.faces[:, ::-1] if inside_out else mesh.faces
    x, y, z = (MILLIMETRES * mesh.vertices.astype(np.float64)).T
    place = np.stack([x, -z, y], axis=1)
    return Mesh((place - place[np.unique(turned)].min(axis=0)).astype(np.float32), turned), wrapped


def _closed(mesh: Mesh) -> bool:
    counts = topology(mesh)
    return counts.closed and counts.manifold and not counts.flipped_edges


def _wrapped(mesh: Mesh) -> Mesh:
    maker = pymeshlab.MeshSet()
    maker.add_mesh(pymeshlab.Mesh(mesh.vertices.astype(np.float64), mesh.faces))
    maker.generate_alpha_wrap(alpha=pymeshlab.PercentageValue(WRAP), offset=pymeshlab.PercentageValue(GAP))
    made = maker.current_mesh()
    return Mesh(made.vertex_matrix(), made.face_matrix().astype(np.int32))


def printable(mesh: Mesh) -> Printable:
    """Return what is measured of a solid in millimetres, +Z up.

    A wall is measured by a ray from a point of the surface inwards, against the normal, to the other side.
    """
    areas, normals = face_areas(mesh), face_normals(mesh)
    unit = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    middles = mesh.vertices.astype(np.float64)[mesh.faces].mean(axis=1)
    share = areas / areas.sum()
    chosen = np.searchsorted(np.cumsum(share), (np.arange(RAYS) + 0.5) / RAYS).clip(max=len(areas) - 1)
    walls = _walls(mesh, middles[chosen], unit[chosen])
    lowest = mesh.vertices[mesh.faces][..., 2].max(axis=1) < BED
    leans = (unit[:, 2] < -np.sin(np.radians(STEEPEST))) & ~lowest
    low, high = (getattr(mesh.vertices[np.unique(mesh.faces)], end)(axis=0) for end in ("min", "max"))
    width, depth, height = (round(float(side), 2) for side in high - low)
    return Printable(
        round(float(np.percentile(walls, 1)), 3),
        round(float(np.median(walls)), 3),
        round(float((walls < WALL).mean()), 4),
        round(float(share[leans].sum()), 4),
        (width, depth, height),
        round(float(signed_volumes(mesh, face_components(mesh)).sum()) / 1000, 3),
    )


def _walls(
    mesh: Mesh, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """Return how far it is from each point inwards to the other side [mm]; those of rays that slip out
    through an edge are left out."""
    vertices, faces = np.ascontiguousarray(mesh.vertices, np.float64), mesh.faces.astype(np.int64)
    tree = igl.AABB()
    tree.init(vertices, faces)
    step = 1e-5 * float(np.ptp(vertices, axis=0).max())
    hit, distance, _ = tree.intersect_ray_first(vertices, faces, points - step * normals, -normals)
    return np.asarray(distance[hit >= 0] + step)


def advice(found: Printable, wrapped: bool) -> list[str]:
    """Return sentences about what the user may mend."""
    said = []
    if wrapped:
        said.append("the surface was not closed: STL and 3MF hold a closed one wrapped round it")
    if found.thin_share > 0.01:
        larger = max(found.size_mm) * WALL / max(found.wall_mm, 1e-6)
        said.append(
            f"{100 * found.thin_share:.0f} % of the print's walls are thinner than {WALL} mm, at "
            f"{max(found.size_mm):.3g} mm from end to end: from {larger:.2g} mm on they are not"
        )
    return said
