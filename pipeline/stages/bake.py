"""Stage `bake`: decode rendered latent views (RGB ones are as they are) and project them onto the texture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.diffusion.bundle import STABLE_DIFFUSION_LATENTS, read_json
from pipeline.diffusion.sessions import vae_decoder
from pipeline.scene.baking import MARGIN, bake_cameras, bake_texture, decoded_views, rgb_views
from pipeline.scene.mesh import bounding_radius, read_obj
from pipeline.scene.rendering import render_views
from pipeline.scene.scene import load_scene
from pipeline.scene.silhouettes import comparison_cameras, mean_iou, opacity_masks, silhouettes
from pipeline.stage import Context, Progress, execute

COMPARED_SIZE = 96
PIXELS_PER_LATENT = 2
"""A refined scene is rendered this much finer than a latent one: there is no decoder to add detail."""


def view_resolution(description: Path | None) -> int:
    """Return the side of the views to decode [latent pixels], from bundle.json; without one, for Stable
    Diffusion.

    Small latents are rendered at twice the size they were trained at, which was worth 0.3 dB against the true
    object; large ones are not, since decoding would take minutes.
    """
    size = read_json(description).get("latent_size") if description else None
    trained = STABLE_DIFFUSION_LATENTS if size is None else int(size)
    return max(trained, min(2 * trained, STABLE_DIFFUSION_LATENTS))


def main(context: Context) -> None:
    options = context.job.bake
    mesh = read_obj(context.inputs["mesh"])
    scene = load_scene(context.inputs["scene"])
    cameras = bake_cameras(options.views, bounding_radius(mesh))
    with Progress("bake", len(cameras), "views") as progress:
        if scene.rgb is not None:
            pixels = PIXELS_PER_LATENT * view_resolution(context.inputs.get("description"))
            resolution = options.view_resolution or pixels
            pictures = rgb_views(scene, cameras, resolution)
        else:
            resolution = options.view_resolution or view_resolution(context.inputs.get("description"))
            with vae_decoder(context.inputs["vae_decoder"], provider=context.job.provider) as decode:
                pictures = decoded_views(scene, cameras, resolution, decode, progress.update)
    margin = MARGIN * len(pictures[0]) / resolution
    texture, figures = bake_texture(mesh, cameras, pictures, options.texture, margin)

    compared = comparison_cameras(options.views)
    seen = render_views(scene, compared, COMPARED_SIZE, np.zeros(4, np.float32))
    opaque, _ = opacity_masks(seen.opacity)
    context.metrics.update(
        **figures,
        silhouette_iou=mean_iou(silhouettes(mesh, compared, COMPARED_SIZE), opaque),
        view_resolution=resolution,
        view_pixels=len(pictures[0]),
        texture=options.texture,
    )
    picture = Image.fromarray(np.round(texture * 255).astype(np.uint8))
    picture.save(context.outputs["albedo"], format="PNG")


if __name__ == "__main__":
    execute("bake", main)
