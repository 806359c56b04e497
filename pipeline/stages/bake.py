"""Stage `bake`: decode rendered latent views (RGB ones are as they are) and project them onto the texture;
draw the normal map of the surface with all its faces.
"""

from __future__ import annotations

import numpy as np
from PIL import Image

from pipeline.diffusion.decoding import view_resolution, views_to_decode
from pipeline.diffusion.sessions import vae_decoder
from pipeline.mesh.baking import MARGIN, PADDING, bake_cameras, bake_texture
from pipeline.mesh.mesh import bounding_radius, read_obj, read_ply, split_seams
from pipeline.mesh.normal_map import normal_map
from pipeline.mesh.silhouettes import comparison_cameras, mean_iou, opacity_masks, silhouettes
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import load_scene
from pipeline.nerf.views import decoded_views, rgb_views
from pipeline.report.png import write_png
from pipeline.run.stage import Context, Progress, execute

COMPARED_SIZE = 96
PIXELS_PER_LATENT = 2
"""A refined scene is rendered this much finer than a latent one: there is no decoder to add detail."""


def main(context: Context) -> None:
    """Read the mesh with its coordinates, its fine surface, the scene and, of a latent one, the decoder;
    write the textures."""
    options = context.job.bake
    mesh = read_obj(context.inputs["mesh"])
    scene = load_scene(context.inputs["scene"])
    description = context.inputs.get("description")
    count = options.views
    if scene.rgb is None:
        count = views_to_decode(options.views, options.large_views, description)
    cameras = bake_cameras(count, bounding_radius(mesh))
    with Progress("bake", len(cameras), "views") as progress:
        if scene.rgb is not None:
            pixels = PIXELS_PER_LATENT * view_resolution(description)
            resolution = options.view_resolution or pixels
            pictures = rgb_views(scene, cameras, resolution)
        else:
            resolution = options.view_resolution or view_resolution(description)
            with vae_decoder(context.inputs["vae_decoder"], provider=context.job.provider) as decode:
                pictures = decoded_views(scene, cameras, resolution, decode, progress.update)
    margin = MARGIN * len(pictures[0]) / resolution
    texture, metrics = bake_texture(mesh, cameras, pictures, options.texture, margin)

    compared = comparison_cameras(options.views)
    views = render_views(scene, compared, COMPARED_SIZE, np.zeros(4, np.float32))
    opaque, _ = opacity_masks(views.opacity)
    context.metrics.update(
        **metrics,
        silhouette_iou=mean_iou(silhouettes(mesh, compared, COMPARED_SIZE), opaque),
        views=len(cameras),
        view_resolution=resolution,
        view_pixels=len(pictures[0]),
        texture=options.texture,
    )
    write_png(context.outputs["albedo"], texture)
    if options.normal_map:
        fine = read_ply(context.inputs["fine"])
        image, errors = normal_map(mesh, split_seams(mesh), fine, options.texture, PADDING)
        write_png(context.outputs["normal"], Image.fromarray(image))
        context.metrics.update(
            normal_error_without_map=errors["error_without"], normal_error_with_map=errors["error_with"]
        )


if __name__ == "__main__":
    execute("bake", main)
