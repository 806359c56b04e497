"""Pictures of a scene, without a background: what its texture is baked from.

Letters: p pixels along a side of a picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from pipeline.cameras import Camera
from pipeline.diffusion.decoding import decode_foreground
from pipeline.diffusion.sessions import Decode
from pipeline.mesh.baking import extend_foreground
from pipeline.mesh.silhouettes import opacity_masks
from pipeline.nerf.refining import render_rgb
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import Scene


def decoded_views(
    scene: Scene,
    cameras: Sequence[Camera],
    resolution: int,
    decode: Decode,
    tell: Callable[[int], None] = lambda done: None,
) -> list[Float[np.ndarray, "p p 3"]]:
    """Return pictures of a latent scene: latents at `resolution`, decoded."""
    views = render_views(scene, cameras, resolution, np.zeros(4, np.float32))
    masks = np.stack([opacity_masks(opacity[None])[0][0] for opacity in views.opacity])
    return decode_foreground(views.latents, views.opacity, masks, decode, tell)


def rgb_views(scene: Scene, cameras: Sequence[Camera], resolution: int) -> list[Float[np.ndarray, "p p 3"]]:
    """Return pictures of an RGB scene, `resolution` pixels along a side."""
    pairs = zip(*render_rgb(scene, cameras, resolution), strict=True)
    extended = [
        extend_foreground(colours, opacity, opacity_masks(opacity[None])[0][0]) for colours, opacity in pairs
    ]
    return [np.ascontiguousarray(picture.transpose(1, 2, 0).clip(0, 1)) for picture in extended]
