"""Stage `bake_paint`: from painted latents to the colours of the texture, or of the faces."""

from __future__ import annotations

from pipeline.diffusion.decoding import view_resolution, views_to_decode
from pipeline.diffusion.sessions import vae_decoder
from pipeline.errors import InputError
from pipeline.mesh.baking import bake_cameras, bake_texture
from pipeline.mesh.mesh import bounding_radius
from pipeline.mesh.seams import find_seams, seam_jump
from pipeline.mesh.texture import surface_texels
from pipeline.paint.baking import atlas_texture, bake_faces, painted_views, view_margin
from pipeline.paint.given_mesh import load_paint_mesh
from pipeline.paint.surface_latents import load_painted
from pipeline.report.png import write_png
from pipeline.run.stage import Context, Progress, execute


def main(context: Context) -> None:
    """Read the mesh, its painted latents and the decoder; write the texture, or the faces' colours."""
    options = context.job.bake_paint
    painted = load_painted(context.inputs["painted"])
    mesh = load_paint_mesh(context.inputs["mesh"]).scaled(painted.mesh_radius)
    description = context.inputs.get("description")
    count = views_to_decode(options.views, options.large_views, description)
    cameras = bake_cameras(count, bounding_radius(mesh))
    resolution = options.view_resolution or view_resolution(description)
    metrics = context.metrics
    if painted.texture is None and options.method == "atlas":
        raise InputError("bake_paint.method is atlas, but PARAM=face has no atlas: expected views")

    with vae_decoder(context.inputs["vae_decoder"], provider=context.job.provider) as decode:
        if options.method == "atlas":
            texture = atlas_texture(painted, mesh, options.texture, decode)
        else:
            with Progress("bake_paint", len(cameras), "views") as progress:
                views = painted_views(painted, mesh, cameras, resolution, decode, progress.update)
            margin = view_margin(len(views[0]), resolution)
            metrics.update(view_resolution=resolution, view_pixels=len(views[0]))
            if painted.texture is None:
                texture, quality = bake_faces(mesh, cameras, views, margin)
            else:
                texture, quality = bake_texture(mesh, cameras, views, options.texture, margin, two_sided=True)
            metrics.update(quality)
    metrics["method"] = options.method
    if painted.texture is None:
        texture = texture[None]  # a strip, a pixel a face
    else:
        seams = find_seams(mesh)
        metrics.update(
            texture=options.texture,
            texture_used=len(surface_texels(mesh, options.texture).place) / options.texture**2,
            seam_edges=len(seams.length),
            seam_share=seams.share,
            seam_error=seam_jump(seams, texture),
        )
    write_png(context.outputs["albedo"], texture)


if __name__ == "__main__":
    execute("bake_paint", main)
