"""Stage `publish`: the files people open: GLB and its levels of detail, OBJ with MTL and PNG, pictures."""

from __future__ import annotations

import numpy as np
from PIL import Image

from pipeline.diffusion.bundle import training_light
from pipeline.mesh.baking import PADDING
from pipeline.mesh.gltf import Part, glb_bytes
from pipeline.mesh.levels import SHARES, coarser
from pipeline.mesh.materials import material_of, mtl_text, object_name
from pipeline.mesh.mesh import Mesh, bounding_radius, read_obj, split_seams, write_obj
from pipeline.mesh.placing import placed
from pipeline.mesh.shading import without_light
from pipeline.mesh.silhouettes import comparison_cameras, mean_iou, silhouettes
from pipeline.mesh.tangents import vertex_tangents
from pipeline.mesh.topology import topology
from pipeline.report.png import write_png
from pipeline.report.preview import albedo_shade, preview
from pipeline.report.turntable import write_turntable
from pipeline.run.stage import Context, Progress, execute

VIEWS, SILHOUETTE_SIZE = 12, 192


def part_of(mesh: Mesh, name: str, bumpy: bool) -> Part:
    """Return an unwrapped mesh for glTF; `bumpy`: with the tangents that a normal map needs."""
    split = split_seams(mesh)
    tangents = vertex_tangents(split) if bumpy else None
    return Part(name, split.vertices, split.faces, split.normals, split.uv, tangents)


def main(context: Context) -> None:
    """Read the mesh and its texture; write the asset (GLB, OBJ, MTL, PNG), its levels of detail
    and the pictures of it."""
    options = context.job.publish
    outputs = context.outputs
    mesh = read_obj(context.inputs["mesh"])
    with Image.open(context.inputs["albedo"], formats=["PNG"]) as opened:
        albedo = opened.convert("RGB")
    texture = np.asarray(albedo, np.float32) / 255
    shade = albedo_shade(mesh, texture)
    towards = training_light(context.inputs.get("description"))
    if towards is not None and not options.unlit:  # unlit, its light is all that it has
        texture, light = without_light(mesh, texture, np.array(towards), PADDING)
        albedo = Image.fromarray(np.round(255 * texture).astype(np.uint8))
        context.metrics["light_divided_out"] = {k: round(v, 3) for k, v in light._asdict().items()}

    write_png(outputs["albedo"], albedo)
    name = object_name(context.job.prompt)
    material, word = material_of(context.job.prompt, options.unlit)
    stands, origin, scale = placed(mesh, options.pivot, options.size_m)
    normal_png, normal_name = None, ""
    if "normal" in context.inputs:
        normal_png = context.inputs["normal"].read_bytes()
        outputs["normal"].write_bytes(normal_png)
        normal_name = outputs["normal"].name
    if options.unlit:  # a normal map would have nothing to act on
        normal_png, normal_name = None, ""
    part = part_of(stands, name, normal_png is not None)
    png = outputs["albedo"].read_bytes()
    glb = glb_bytes([part], png, material, name=name, normal_png=normal_png)
    outputs["glb"].write_bytes(glb)
    text = mtl_text([name], material, outputs["albedo"].name, normal_name)
    outputs["mtl"].write_text(text, encoding="utf-8")
    write_obj(outputs["obj"], stands, outputs["mtl"].name, name, normals=True)
    cameras = comparison_cameras(VIEWS)
    outline, levels = silhouettes(mesh, cameras, SILHOUETTE_SIZE), []
    for number, share in enumerate(SHARES, 1):
        level = coarser(outputs["obj"], round(share * len(mesh.faces)))
        glb = glb_bytes(
            [part_of(level, name, normal_png is not None)],
            outputs["albedo"].name,  # one texture for all
            material,
            name=name,
            normal_png=normal_name or None,
        )
        outputs[f"lod{number}"].write_bytes(glb)
        seen = level._replace(vertices=level.vertices / scale + origin)
        agreement = mean_iou(outline, silhouettes(seen, cameras, SILHOUETTE_SIZE))
        levels.append({"faces": len(level.faces), "silhouette_iou": round(agreement, 4)})
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
        vertices_with_seams=len(part.vertices),
        faces=len(mesh.faces),
        components=counts.components,
        manifold=counts.manifold,
        watertight=counts.closed,
        bounding_radius=bounding_radius(mesh),
        texture=albedo.width,
        name=name,
        levels=levels,
        material={"word": word, **material._asdict()},
        origin=list(origin),
        metres_a_unit=scale,
        bytes={name: path.stat().st_size for name, path in sorted(outputs.items())},
    )


if __name__ == "__main__":
    execute("publish", main)
