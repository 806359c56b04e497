"""Stage `publish`: the files people open: GLB, OBJ with MTL and PNG, preview sheet and turntable."""

from __future__ import annotations

import numpy as np
from PIL import Image

from pipeline.mesh.gltf import Part, glb_bytes
from pipeline.mesh.materials import material_of, mtl_text, object_name
from pipeline.mesh.mesh import bounding_radius, read_obj, split_seams, write_obj
from pipeline.mesh.placing import placed
from pipeline.mesh.tangents import vertex_tangents
from pipeline.mesh.topology import topology
from pipeline.report.png import write_png
from pipeline.report.preview import albedo_shade, preview
from pipeline.report.turntable import write_turntable
from pipeline.run.stage import Context, Progress, execute


def main(context: Context) -> None:
    """Read the mesh and its texture; write the asset (GLB, OBJ, MTL, PNG) and the pictures of it."""
    options = context.job.publish
    outputs = context.outputs
    mesh = read_obj(context.inputs["mesh"])
    with Image.open(context.inputs["albedo"], formats=["PNG"]) as opened:
        albedo = opened.convert("RGB")
    shade = albedo_shade(mesh, np.asarray(albedo, np.float32) / 255)

    write_png(outputs["albedo"], albedo)
    name = object_name(context.job.prompt)
    material, word = material_of(context.job.prompt, options.unlit)
    stands, origin, scale = placed(mesh, options.pivot, options.size_m)
    split = split_seams(stands)
    normal_png, tangents, normal_name = None, None, ""
    if "normal" in context.inputs:
        normal_png = context.inputs["normal"].read_bytes()
        outputs["normal"].write_bytes(normal_png)
        tangents, normal_name = vertex_tangents(split), outputs["normal"].name
    if options.unlit:  # a normal map would have nothing to act on
        normal_png, tangents, normal_name = None, None, ""
    part = Part(name, split.vertices, split.faces, split.normals, split.uv, tangents)
    png = outputs["albedo"].read_bytes()
    glb = glb_bytes([part], png, material, name=name, normal_png=normal_png)
    outputs["glb"].write_bytes(glb)
    text = mtl_text([name], material, outputs["albedo"].name, normal_name)
    outputs["mtl"].write_text(text, encoding="utf-8")
    write_obj(outputs["obj"], stands, outputs["mtl"].name, name, normals=True)
    write_png(outputs["preview"], preview(mesh, shade, options.preview_size))
    with Progress("publish", options.turntable_frames, "frames") as progress:
        write_turntable(
            outputs["turntable"],
            mesh,
            shade,
            options.turntable_size,
            options.turntable_frames,
            progress.update,
        )
    counts = topology(mesh)
    context.metrics.update(
        vertices=len(mesh.vertices),
        vertices_with_seams=len(split.vertices),
        faces=len(mesh.faces),
        components=counts.components,
        manifold=counts.manifold,
        watertight=counts.closed,
        bounding_radius=bounding_radius(mesh),
        texture=albedo.width,
        name=name,
        material={"word": word, **material._asdict()},
        origin=list(origin),
        metres_a_unit=scale,
        bytes={name: path.stat().st_size for name, path in sorted(outputs.items())},
    )


if __name__ == "__main__":
    execute("publish", main)
