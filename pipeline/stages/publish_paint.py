"""Stage `publish_paint`: the files people open, with the geometry that was given."""

from __future__ import annotations

import numpy as np
from PIL import Image

from pipeline.mesh.gltf import glb_bytes
from pipeline.mesh.materials import material_of, mtl_text
from pipeline.paint.asset_parts import float32_place, painted_obj, painted_parts
from pipeline.paint.given_mesh import load_paint_mesh
from pipeline.report.png import write_png
from pipeline.report.preview import albedo_shade, face_shade, preview
from pipeline.report.turntable import write_turntable
from pipeline.run.stage import Context, Progress, execute


def main(context: Context) -> None:
    """Read the mesh and its colours; write the asset (GLB, OBJ, MTL, PNG) and the pictures of it."""
    options = context.job.publish
    outputs = context.outputs
    mesh = load_paint_mesh(context.inputs["mesh"])
    shown = mesh.scaled(1.0)
    with Image.open(context.inputs["albedo"], formats=["PNG"]) as opened:
        albedo = opened.convert("RGB")
    values = np.asarray(albedo, np.float32) / 255
    colours = values[0] if context.job.param == "face" else None

    place = float32_place(mesh.vertices[np.unique(mesh.faces)])
    parts = painted_parts(mesh, place, colours)
    material, word = material_of(context.job.prompt, options.unlit)
    png = None
    if colours is None:
        write_png(outputs["albedo"], albedo)
        png = outputs["albedo"].read_bytes()
        text = mtl_text(["albedo"], material, outputs["albedo"].name)
        outputs["mtl"].write_text(text, encoding="ascii")
    # Both sides of a face show its colour: open surfaces are seen from behind, and windings may be mixed.
    outputs["glb"].write_bytes(glb_bytes(parts, png, material, translation=place, double_sided=True))
    library = outputs["mtl"].name if colours is None else None
    outputs["obj"].write_text(painted_obj(mesh, library, colours), encoding="utf-8")
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
        vertices_with_seams=sum(len(part.vertices) for part in parts),
        faces=len(mesh.faces),
        parts=[part.name for part in parts],
        translation=list(place),
        texture=albedo.width if colours is None else 0,
        bytes={name: path.stat().st_size for name, path in sorted(outputs.items())},
    )


if __name__ == "__main__":
    execute("publish_paint", main)
