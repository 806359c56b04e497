"""Stage `prepare`: the user's mesh, checked, with texture coordinates that can be painted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from pipeline.errors import InputError
from pipeline.mesh.coordinates import make_coordinates
from pipeline.mesh.mesh import Mesh, face_areas
from pipeline.mesh.readers import read_mesh
from pipeline.mesh.topology import topology
from pipeline.options.paint import Prepare
from pipeline.paint.given_mesh import PaintMesh, save_paint_mesh, to_unit_ball
from pipeline.progress import say
from pipeline.run.stage import Context, execute

MANY_FACES = 200_000
"""xatlas merges charts in more than linear time: a million faces take ten minutes."""
PADDING = 64
"""Islands lie a 64th of the atlas apart: two texels of a latent texture of 128."""


def coordinates(mesh: Mesh, options: Prepare, warnings: list[str]) -> tuple[Mesh, dict[str, Any]]:
    """Return the mesh with texture coordinates and metrics about them; what the user should hear is added to
    `warnings`."""
    wanted = options.resolution // PADDING
    made, metrics = make_coordinates(mesh, options.resolution, wanted, options.uv == "rewrap")
    if "uv_reason" in metrics and mesh.uv is not None:
        warnings.append(f"the mesh got new texture coordinates; its own are not used: {metrics['uv_reason']}")
    if metrics.get("padding", wanted) < wanted:
        warnings.append(
            f"{metrics['charts']} charts leave room for {metrics['padding']} texels of padding instead of "
            f"{wanted}: colours may bleed between them; raise prepare.resolution and train_paint.texture"
        )
    return made, metrics


def check_seen(unit: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], path: Path) -> None:
    """Raise InputError where every face is lost in the extent of the whole; positions are in the
    unit ball."""
    if not (face_areas(Mesh(unit, faces)) > 0).any():
        raise InputError(
            f"{path}: each of its {len(faces)} faces is lost in its extent (65536 steps a radius): it is too "
            "thin, or its parts lie too far apart; scale or move them"
        )


def main(context: Context) -> None:
    """Read the file that the user gave; write the mesh as it is and as cameras see it, with coordinates."""
    options = context.job.prepare
    given = read_mesh(context.inputs["mesh"])
    if len(given.faces) > MANY_FACES and context.job.param == "texture":
        say(f"warning: {len(given.faces)} faces: new texture coordinates may take minutes to hours")
    unit = to_unit_ball(given, options.up, options.front)
    check_seen(unit, given.faces, context.inputs["mesh"])
    mesh = Mesh(unit, given.faces, given.uv, given.uv_faces)
    warnings: list[str] = context.metrics.setdefault("warnings", [])
    metrics: dict[str, Any] = {}
    if context.job.param == "face":
        mesh = mesh._replace(uv=None, uv_faces=None)
    else:
        if given.untextured:
            warnings.append(
                f"the mesh got new texture coordinates; its own are not used: {given.untextured} of its "
                f"{len(given.faces)} faces have none"
            )
        mesh, metrics = coordinates(mesh, options, warnings)
    save_paint_mesh(
        context.outputs["mesh"],
        PaintMesh(
            given.vertices, mesh.vertices, given.faces, given.part, given.names, mesh.uv, mesh.uv_faces
        ),
    )
    counts = topology(mesh)
    context.metrics.update(
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        parts=len(given.names),
        manifold=counts.manifold,
        watertight=counts.closed,
        **metrics,
    )


if __name__ == "__main__":
    execute("prepare", main)
