"""From pictures of a mesh to its texture.

Each texel takes its colour mostly from the views that see it best: averaging many views evenly would blur
what they disagree about.

Letters: h x w pixels, p pixels along a side of a decoded view, s texels along a side.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from pipeline.cameras import Camera, ring, sphere
from pipeline.errors import InputError
from pipeline.mesh.fill import continue_nearest
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.rasterize import rasterize
from pipeline.mesh.silhouettes import POLAR_RANGE
from pipeline.mesh.texture import paint, project_view, render_texture, resolve, surface_texels, view_trust

FOV = np.radians(45.0)
RING_POLAR = np.radians(75.0)
POWER = 4.0  # of the cosine: a view 30 degrees off counts 0.56 of one straight on, 60 degrees 0.06
MARGIN = 1.5  # trust rises over this many latent pixels from an outline
PADDING = 16  # texels around islands


def bake_cameras(count: int, bound: float) -> list[Camera]:
    """Return `count` cameras that see all of a ball of radius `bound`: a third on a ring, the rest around."""
    radius = 1.05 * bound / np.sin(FOV / 2)
    on_ring = count // 3
    return ring(on_ring, RING_POLAR, radius, FOV) + sphere(count - on_ring, radius, FOV, POLAR_RANGE)


def extend_foreground(
    latents: Float[np.ndarray, "c h w"], opacity: Float[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, "c h w"]:
    """Return latents (or RGB) without background: outside `mask` pixels continue the nearest one inside.

    `latents` are composited over nothing (zeros), so a half-opaque pixel holds half of its colour: it is
    divided by its opacity. What is decoded then has no outline that could bleed into the texture: against a
    known object that was 0.4 dB better than a grey background, and 6 to 8 dB better than black or white.
    """
    if not mask.any():
        return latents
    solid = latents / np.maximum(opacity, 0.05)
    extended = continue_nearest(solid.transpose(1, 2, 0), mask).transpose(2, 0, 1)
    return np.ascontiguousarray(extended, np.float32)


def bake_texture(
    mesh: Mesh,
    cameras: Sequence[Camera],
    views: Sequence[Float[np.ndarray, "p p 3"]],
    size: int,
    margin: float,
    *,
    power: float = POWER,
    two_sided: bool = False,
) -> tuple[Float[np.ndarray, "s s 3"], dict[str, Any]]:
    """Return the texture that `views` of an unwrapped mesh show, and its metrics.

    Args:
        views: pictures by `cameras`, colours in [0, 1].
        size: texels along a side.
        margin: width of the zone along outlines where a view is believed less [pixels of a view].
        power, two_sided: see `project_view`.

    Metrics: `texel_coverage`, the share of the mesh's texels some view saw, and `psnr` [dB] of the textured
    mesh against the views inside its silhouette, `psnr_worst` of the worst view. Raises InputError if no view
    sees the mesh.
    """
    texels = surface_texels(mesh, size)
    total = np.zeros((len(texels.place), 4), np.float64)
    fragments = []
    for camera, picture in zip(cameras, views, strict=True):
        fragments.append(rasterize(camera, mesh.vertices, mesh.faces, len(picture)))
        trust = view_trust(fragments[-1], camera, margin)
        project_view(total, texels, mesh, camera, picture, trust, power, two_sided)
    try:
        colours, seen = resolve(total, texels)
    except ValueError as error:
        raise InputError(
            f"{error}; raise bake.views (of a MESH: bake_paint.views), or unwrap the mesh again"
        ) from error
    texture = paint(np.clip(colours, 0.0, 1.0), texels, PADDING)
    errors = [
        ((render_texture(one, mesh, texture) - picture)[one.mask] ** 2).mean()
        for one, picture in zip(fragments, views, strict=True)
        if one.mask.any()
    ]
    return texture, {
        "texel_coverage": float(seen.mean()),
        "psnr": decibels(float(np.mean(errors))),
        "psnr_worst": decibels(float(np.max(errors))),
    }


def decibels(mean_square_error: float) -> float:
    """Return the peak signal-to-noise ratio of colours in [0, 1], at most 100."""
    return float(-10 * np.log10(max(mean_square_error, 1e-10)))
