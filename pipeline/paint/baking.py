"""From painted latents to colours, in two ways.

`atlas_texture` is the paper's: the latent texture, its islands padded, goes through the decoder once. It asks
a network made for pictures to read an atlas. `painted_views` renders the latents, decodes pictures, and
`bake_texture` or `bake_faces` projects these back. Which is better is measured in benchmarks/paint.py.

Letters: b views, h x w latent pixels, p pixels along a side of a decoded view, s texels along a side, f
faces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

from pipeline.cameras import Camera
from pipeline.diffusion.decoding import decode_foreground
from pipeline.diffusion.sessions import Decode
from pipeline.errors import InputError
from pipeline.mesh.baking import MARGIN, PADDING, POWER, decibels
from pipeline.mesh.bilinear import sample
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.rasterize import rasterize
from pipeline.mesh.texture import paint, project_view, render_texture, resolve, surface_texels, view_trust
from pipeline.paint.surface_latents import Painted, face_texels
from pipeline.paint.view_weights import view_weights

SUPERSAMPLING = 3


def atlas_texture(painted: Painted, mesh: Mesh, size: int, decode: Decode) -> Float[np.ndarray, "s s 3"]:
    """Return the texture that one decoding of the whole (padded) latent texture gives."""
    assert painted.texture is not None
    side = painted.texture
    latents = painted.latents.reshape(1, side, side, 4).transpose(0, 3, 1, 2)
    picture = decode(np.ascontiguousarray(latents))[0]
    texels = surface_texels(mesh, size)
    places = np.stack([texels.place % size, texels.place // size], axis=1)
    if len(picture) > size:  # fewer texels than decoded pixels: average, do not skip
        picture = cv2.resize(picture, (size, size), interpolation=cv2.INTER_AREA)
    colours = sample(picture, (places + 0.5) / size)
    return paint(colours.astype(np.float32), texels, PADDING)


def painted_views(
    painted: Painted,
    mesh: Mesh,
    cameras: Sequence[Camera],
    resolution: int,
    decode: Decode,
    tell: Callable[[int], None] = lambda done: None,
) -> list[Float[np.ndarray, "p p 3"]]:
    """Return pictures of the painted mesh: latents at `resolution`, without a background, decoded."""
    views = [view_weights(mesh, camera, resolution, painted.texture, SUPERSAMPLING) for camera in cameras]
    latents = np.stack([view.render(painted.latents, np.zeros(4, np.float32)) for view in views])
    covered = np.stack([view.covered for view in views])
    return decode_foreground(latents, covered, covered > 0.5, decode, tell)


def bake_faces(
    mesh: Mesh, cameras: Sequence[Camera], views: Sequence[Float[np.ndarray, "p p 3"]], margin: float
) -> tuple[Float[np.ndarray, "f 3"], dict[str, Any]]:
    """Return the colour of every face that `views` show at its centroid, and metrics as `bake_texture`'s.

    Raises InputError if no view sees the mesh.
    """
    places = face_texels(mesh)
    total = np.zeros((len(mesh.faces), 4), np.float64)
    fragments = [rasterize(camera, mesh.vertices, mesh.faces, len(views[0])) for camera in cameras]
    for camera, picture, one in zip(cameras, views, fragments, strict=True):
        project_view(total, places, mesh, camera, picture, view_trust(one, camera, margin), POWER, True)
    try:
        colours, seen = resolve(total, places)
    except ValueError as error:
        raise InputError(f"{error}; give bake_paint.views more views") from error
    colours = np.clip(colours, 0.0, 1.0)
    errors = [
        np.mean((colours[one.triangle[one.mask]] - picture[one.mask]) ** 2)
        for one, picture in zip(fragments, views, strict=True)
        if one.mask.any()
    ]
    return colours, {
        "face_coverage": float(seen.mean()),
        "psnr": decibels(float(np.mean(errors))),
        "psnr_worst": decibels(float(np.max(errors))),
    }


def texture_psnr(
    texture: Float[np.ndarray, "s s 3"],
    mesh: Mesh,
    cameras: Sequence[Camera],
    views: Sequence[Float[np.ndarray, "p p 3"]],
) -> float:
    """Return the PSNR [dB] of the textured mesh against pictures, inside its silhouette."""
    errors = []
    for camera, picture in zip(cameras, views, strict=True):
        one = rasterize(camera, mesh.vertices, mesh.faces, len(picture))
        if one.mask.any():
            errors.append(((render_texture(one, mesh, texture) - picture)[one.mask] ** 2).mean())
    return decibels(float(np.mean(errors)))


def view_margin(pixels: int, resolution: int) -> float:
    """Return the width of the zone along outlines where a decoded view is believed less [pixels]."""
    return MARGIN * pixels / resolution
