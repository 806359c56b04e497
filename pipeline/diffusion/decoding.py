"""Pictures of rendered latents, by the decoder.

Letters: b views, h x w latent pixels, p pixels along a side of a decoded view.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from pipeline.diffusion.bundle import STABLE_DIFFUSION_LATENTS, read_json
from pipeline.diffusion.sessions import Decode
from pipeline.mesh.baking import extend_foreground

LARGE_PICTURE = 512
"""Pixels along a side."""


def view_resolution(description: Path | None) -> int:
    """Return the side of the views to decode [latent pixels], from bundle.json; without one, for Stable
    Diffusion.

    Small latents are rendered at twice the size they were trained at, which was worth 0.3 dB against the true
    object; large ones are not, since decoding would take minutes.
    """
    size = read_json(description).get("latent_size") if description else None
    trained = STABLE_DIFFUSION_LATENTS if size is None else int(size)
    return max(trained, min(2 * trained, STABLE_DIFFUSION_LATENTS))


def views_to_decode(views: int, large_views: int, description: Path | None) -> int:
    """Return how many views to decode: at most `large_views` where pictures are large."""
    size = read_json(description).get("image_size") if description else None
    return min(views, large_views) if size is None or int(size) >= LARGE_PICTURE else views


def decode_foreground(
    latents: Float[np.ndarray, "b 4 h w"],
    opacity: Float[np.ndarray, "b h w"],
    masks: Bool[np.ndarray, "b h w"],
    decode: Decode,
    tell: Callable[[int], None] = lambda done: None,
) -> list[Float[np.ndarray, "p p 3"]]:
    """Return pictures of latents that were composited over zeros, without a background; see
    `extend_foreground`. `tell` hears how many are decoded."""
    pictures = []
    for done, (view, own, mask) in enumerate(zip(latents, opacity, masks, strict=True), 1):
        pictures.append(decode(extend_foreground(view, own, mask)[None])[0])
        tell(done)
    return pictures
