"""Stage `publish_paint`: the files people open: what was given, with new colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from pipeline.errors import InputError
from pipeline.mesh.gltf import glb_bytes
from pipeline.mesh.gltf_reader import read_gltf
from pipeline.mesh.materials import Material, material_of, mtl_text
from pipeline.mesh.readers import read_mesh
from pipeline.paint.asset_parts import Normals, float32_place, linear_light, painted_obj, painted_parts
from pipeline.paint.given_mesh import PaintMesh, load_paint_mesh
from pipeline.paint.painted_gltf import Corners, painted_glb
from pipeline.paint.painted_obj import material_names, repainted_obj
from pipeline.report.png import write_png
from pipeline.report.preview import albedo_shade, face_shade, preview
from pipeline.report.turntable import write_turntable
from pipeline.run.stage import Context, Progress, execute


def repainted_gltf(
    path: Path,
    mesh: PaintMesh,
    png: bytes | None,
    colours: Float[np.ndarray, "f 3"] | None,
    material: Material,
) -> bytes:
    """Return a glTF file as it came but for its colours, as GLB; see `painted_glb`."""
    document, pieces = read_gltf(path)
    if sum(len(piece.faces) for piece in pieces) != len(mesh.faces):
        raise InputError(f"{path} changed while it was painted: run again")
    if colours is not None:
        values, rows = linear_light(colours), np.repeat(np.arange(len(colours))[:, None], 3, axis=1)
    else:
        assert mesh.uv is not None
        assert mesh.uv_faces is not None
        values, rows = mesh.uv, mesh.uv_faces
    painted = [
        Corners(mine[:, ::-1] if piece.mirrored else mine, values)
        for piece, mine in ((piece, rows[mesh.part == row]) for row, piece in enumerate(pieces))
    ]
    return painted_glb(document, pieces, painted, png, material, path.parent)


def main(context: Context) -> None:
    """Read the mesh and its colours; write the asset (GLB, OBJ, MTL, PNG) and the pictures of it."""
    options = context.job.publish
    outputs, given = context.outputs, context.inputs["mesh"]
    mesh = load_paint_mesh(context.inputs["painted"])
    shown = mesh.scaled(1.0)
    with Image.open(context.inputs["albedo"], formats=["PNG"]) as opened:
        albedo = opened.convert("RGB")
    values = np.asarray(albedo, np.float32) / 255
    colours = values[0] if context.job.param == "face" else None
    kind = given.suffix.lower()

    material, word = material_of(context.job.prompt, options.unlit)
    original = read_mesh(given)
    normals = None
    if original.normals is not None and original.normal_faces is not None:
        normals = Normals(original.normals, original.normal_faces)
    png, library, names = None, None, ["albedo"]
    if colours is None:
        write_png(outputs["albedo"], albedo)
        png, library = outputs["albedo"].read_bytes(), outputs["mtl"].name
        names = material_names(given) if kind == ".obj" else names
        outputs["mtl"].write_text(mtl_text(names, material, outputs["albedo"].name), encoding="utf-8")
    if kind in (".glb", ".gltf"):
        outputs["glb"].write_bytes(repainted_gltf(given, mesh, png, colours, material))
    else:
        place = float32_place(mesh.vertices[np.unique(mesh.faces)])
        parts = painted_parts(mesh, place, colours, normals)
        # Both sides of a face show its colour: open surfaces are seen from behind, and windings may be mixed.
        glb = glb_bytes(parts, png, material, translation=place, double_sided=True)
        outputs["glb"].write_bytes(glb)
    if kind == ".obj" and library is not None and mesh.uv is not None and mesh.uv_faces is not None:
        text = repainted_obj(given, mesh.uv, mesh.uv_faces, library)
    else:
        text = painted_obj(mesh, library, colours, normals)
    outputs["obj"].write_text(text, encoding="utf-8")
    shade = albedo_shade(shown, values) if colours is None else face_shade(colours)
    write_png(outputs["preview"], preview(shown, shade, options.preview_size))
    with Progress("publish_paint", options.turntable_frames, "frames") as progress:
        write_turntable(
            outputs["turntable"],
            shown,
            shade,
            options.turntable_size,
            options.turntable_frames,
            progress.update,
        )
    context.metrics.update(
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        parts=list(mesh.names),
        materials=names if kind == ".obj" else [],
        material={"word": word, **material._asdict()},
        normals=normals is not None,
        texture=albedo.width if colours is None else 0,
        bytes={name: path.stat().st_size for name, path in sorted(outputs.items())},
    )


if __name__ == "__main__":
    execute("publish_paint", main)
