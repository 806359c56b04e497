"""Stage `publish`: the files people open: GLB, OBJ with MTL and PNG, preview sheet and turntable."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.report.preview import albedo_shade, preview, to_bytes
from pipeline.report.turntable import write_turntable
from pipeline.scene.gltf import Part, glb_bytes
from pipeline.scene.mesh import bounding_radius, read_obj, split_seams, write_obj
from pipeline.scene.topology import topology
from pipeline.stage import Context, Progress, execute

OBJECT_NAME = "asset"


def material_text(texture: str) -> str:
    """Return the MTL file: an unlit material (illum 0) whose colour is the texture of that name."""
    return f"newmtl albedo\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 0\nmap_Kd {texture}\n"


def write_png(path: Path, image: Image.Image) -> None:
    """Write a PNG file without dates or other ancillary text."""
    image.save(path, format="PNG")


def main(context: Context) -> None:
    options = context.job.publish
    outputs = context.outputs
    mesh = read_obj(context.inputs["mesh"])
    with Image.open(context.inputs["albedo"], formats=["PNG"]) as opened:
        albedo = opened.convert("RGB")
    shade = albedo_shade(mesh, np.asarray(albedo, np.float32) / 255)

    write_png(outputs["albedo"], albedo)
    split = split_seams(mesh)
    part = Part(OBJECT_NAME, split.vertices, split.faces, split.normals, split.uv)
    outputs["glb"].write_bytes(glb_bytes([part], outputs["albedo"].read_bytes()))
    outputs["mtl"].write_text(material_text(outputs["albedo"].name), encoding="ascii")
    write_obj(outputs["obj"], mesh, outputs["mtl"].name, normals=True)
    write_png(outputs["preview"], Image.fromarray(to_bytes(preview(mesh, shade, options.preview_size))))
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
        bytes={name: path.stat().st_size for name, path in sorted(outputs.items())},
    )


if __name__ == "__main__":
    execute("publish", main)
