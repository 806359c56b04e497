"""Stage `clean`: a raw marching-cubes mesh becomes one closed, smooth, small manifold.

Order matters: what nobody can see goes first (floaters, cavities), since it would eat the face budget;
smoothing comes before decimation, since the quadrics measure the staircase of the grid otherwise; repair
comes last again, because collapsing edges can pinch a surface.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pymeshlab
from jaxtyping import Float
from scipy.spatial import cKDTree

from pipeline.errors import InputError
from pipeline.mesh.denoise import denoise
from pipeline.mesh.mesh import Mesh, read_ply, used_vertices, write_ply
from pipeline.mesh.silhouettes import comparison_cameras, mean_iou, silhouettes
from pipeline.mesh.topology import Topology, face_components, signed_volumes, topology
from pipeline.run.stage import Context, execute

REPAIR_ROUNDS = 4
FRAGMENT = 0.05  # smallest part of `min_component` that can be a cut-off part instead of a floater
HOLE_EDGES = 200  # a hole with a longer border is taken for an opening of the shape
WORKING_FACES = 40_000  # that normals are diffused over, unless twice the budget is more
EDGE = 12.0  # degrees between the normals of neighbours among them that make an edge of the object
VIEWS = 24
SILHOUETTE_SIZE = 192


class Cleaned(NamedTuple):
    """A mesh before and after its faces were made fewer, and how that went."""

    mesh: Mesh
    fine: Mesh
    """The same surface with all its faces: what a normal map shows."""
    steps: list[dict[str, Any]]
    """For every step its name and the counts after it."""


def clean_mesh(
    mesh: Mesh, faces: int, smoothing: int, min_component: float, *, reach: float = 0.0
) -> Cleaned:
    """Return the cleaned mesh.

    Args:
        mesh: raw surface, positions in scene units.
        faces: budget; the result has at most so many.
        smoothing: Taubin steps (each one shrinks and grows, so the volume stays); 0 leaves the surface alone.
        min_component: share of all faces, in [0, 1], below which a piece may be a floater; see
            `remove_floaters`.
        reach: of the diffusion of normals [scene units], see `denoise`; 0: none.
    """
    steps: list[dict[str, Any]] = []
    counted: list[tuple[Mesh, Topology]] = []

    def count(result: Mesh) -> Topology:
        """Return the counts, those of the mesh before where no face changed."""
        if not (counted and _same_faces(counted[-1][0], result)):
            counted[:] = [(result, topology(result))]
        return counted[-1][1]

    def note(step: str, result: Mesh) -> Mesh:
        counts = count(result)
        steps.append(
            {
                "step": step,
                "vertices": len(result.vertices),
                "faces": len(result.faces),
                "components": counts.components,
                "boundary_edges": counts.boundary_edges,
                "non_manifold_edges": counts.non_manifold_edges,
                "non_manifold_vertices": counts.non_manifold_vertices,
            }
        )
        return result

    mesh = note("input", mesh)
    mesh = note("duplicates and null faces", remove_duplicates(mesh))
    mesh = note("floaters", remove_floaters(mesh, min_component))
    mesh = note("cavities", remove_cavities(mesh))
    mesh = note("repair", repair(mesh, count))
    if smoothing:
        mesh = note("smoothing", smooth(mesh, smoothing))
    if reach:
        # Marching cubes leave slivers, over which a diffusion creeps: even faces first.
        if len(mesh.faces) > (working := max(WORKING_FACES, 2 * faces)):
            mesh = note("working faces", decimate(mesh, working))
        mesh = note("denoising", denoise(mesh, reach, EDGE))
    fine = orient_outwards(mesh)
    if len(mesh.faces) > faces:
        mesh = note("decimation", decimate(mesh, faces))
        mesh = note("repair", repair(mesh, count))
    return Cleaned(note("orientation", orient_outwards(mesh)), fine, steps)


def _same_faces(first: Mesh, second: Mesh) -> bool:
    return len(first.vertices) == len(second.vertices) and np.array_equal(first.faces, second.faces)


def _filters(mesh: Mesh) -> pymeshlab.MeshSet:
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(mesh.vertices.astype(np.float64), mesh.faces))
    return meshes


def _result(meshes: pymeshlab.MeshSet) -> Mesh:
    current = meshes.current_mesh()
    return Mesh(current.vertex_matrix().astype(np.float32), current.face_matrix().astype(np.int32))


def remove_duplicates(mesh: Mesh) -> Mesh:
    """Return the mesh without repeated vertices and faces, faces without area, and unused vertices."""
    meshes = _filters(mesh)
    meshes.meshing_remove_duplicate_vertices()
    meshes.meshing_remove_duplicate_faces()
    meshes.meshing_remove_null_faces()
    meshes.meshing_remove_unreferenced_vertices()
    return _result(meshes)


def remove_floaters(mesh: Mesh, min_component: float) -> Mesh:
    """Return the mesh without the pieces that float: small ones, away from everything else.

    A piece stays if it holds at least `min_component` of the faces (the largest always does), and also, down
    to a twentieth of that, if its gap to what stays is smaller than itself: the foot of a leg that the
    density threshold cut through is no floater.
    """
    component = face_components(mesh)
    size = np.bincount(component)
    keep = size >= min_component * len(mesh.faces)
    keep[size.argmax()] = True
    pieces = {
        int(piece): mesh.vertices[np.unique(mesh.faces[component == piece])]
        for piece in np.flatnonzero(~keep & (size >= FRAGMENT * min_component * len(mesh.faces)))
    }
    found = True
    while found and pieces:
        kept = cKDTree(mesh.vertices[np.unique(mesh.faces[keep[component]])])
        near = [piece for piece, places in pieces.items() if kept.query(places)[0].min() < _diagonal(places)]
        keep[near] = True
        pieces = {piece: places for piece, places in pieces.items() if piece not in near}
        found = bool(near)
    return used_vertices(Mesh(mesh.vertices, mesh.faces[keep[component]]))


def _diagonal(places: Float[np.ndarray, "v 3"]) -> float:
    """Return the diagonal of the bounding box."""
    return float(np.linalg.norm(np.ptp(places, axis=0)))


def remove_cavities(mesh: Mesh) -> Mesh:
    """Return the mesh without the walls of closed hollows, which no view can see.

    Marching cubes turns every face from dense to empty, so a piece with a negative volume bounds a hollow. If
    all pieces are inside out, the whole mesh is, and nothing is removed.
    """
    component = face_components(mesh)
    outer = signed_volumes(mesh, component) > 0
    if not outer.any():
        return mesh
    return used_vertices(Mesh(mesh.vertices, mesh.faces[outer[component]]))


def repair(mesh: Mesh, count: Callable[[Mesh], Topology] = topology) -> Mesh:
    """Return the mesh with manifold edges and vertices and without small holes.

    Closing a hole can make a new bad edge, and splitting a vertex a new hole, hence a few rounds.
    """
    for _ in range(REPAIR_ROUNDS):
        counts = count(mesh)
        if counts.manifold and counts.closed and not counts.flipped_edges:
            break
        meshes = _filters(mesh)
        meshes.meshing_repair_non_manifold_edges(method="Remove Faces")
        meshes.meshing_repair_non_manifold_vertices(vertdispratio=0.0)
        meshes.meshing_close_holes(maxholesize=HOLE_EDGES, selfintersection=False)
        meshes.meshing_re_orient_faces_coherently()
        meshes.meshing_remove_unreferenced_vertices()
        mesh = _result(meshes)
    return mesh


def smooth(mesh: Mesh, steps: int) -> Mesh:
    """Return the mesh after `steps` of Taubin smoothing (lambda 0.5, mu -0.53: a low-pass that does not
    shrink).
    """
    meshes = _filters(mesh)
    meshes.apply_coord_taubin_smoothing(lambda_=0.5, mu=-0.53, stepsmoothnum=steps)
    return _result(meshes)


def decimate(mesh: Mesh, faces: int) -> Mesh:
    """Return the mesh with at most `faces` faces, by quadric edge collapse (Garland and Heckbert 1997).

    Collapses that would change the topology are refused as long as the budget can be met without them.
    """
    for keep_topology in (True, False):
        meshes = _filters(mesh)
        meshes.meshing_decimation_quadric_edge_collapse(
            targetfacenum=faces,
            qualitythr=0.3,
            preservenormal=True,
            preservetopology=keep_topology,
            optimalplacement=True,
            planarquadric=True,
        )
        result = _result(meshes)
        if len(result.faces) <= faces:
            break
    return result


def orient_outwards(mesh: Mesh) -> Mesh:
    """Return the mesh with the faces of every piece turned so that its volume is positive."""
    component = face_components(mesh)
    inwards = (signed_volumes(mesh, component) < 0)[component]
    faces = mesh.faces.copy()
    faces[inwards] = faces[inwards][:, ::-1]
    return Mesh(mesh.vertices, faces)


def main(context: Context) -> None:
    """Read the raw mesh; write the clean one, and the same before its faces were made fewer."""
    options = context.job.clean
    raw = read_ply(context.inputs["mesh"])
    mesh, fine, steps = clean_mesh(
        raw, options.faces, options.smoothing, options.min_component, reach=options.denoise
    )
    counts = topology(mesh)
    if not counts.manifold:
        raise InputError(
            f"{context.inputs['mesh']}: {counts.non_manifold_edges} edges and "
            f"{counts.non_manifold_vertices} vertices are still not manifold after cleaning; "
            "raise extract.resolution or clean.faces"
        )
    cameras = comparison_cameras(VIEWS)
    kept = mean_iou(silhouettes(mesh, cameras, SILHOUETTE_SIZE), silhouettes(raw, cameras, SILHOUETTE_SIZE))
    context.metrics.update(
        steps=steps,
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        components=counts.components,
        euler=counts.euler,
        watertight=counts.closed,
        manifold=counts.manifold,
        silhouette_iou_with_raw=kept,
    )
    write_ply(context.outputs["mesh"], mesh)
    write_ply(context.outputs["fine"], fine)


if __name__ == "__main__":
    execute("clean", main)
