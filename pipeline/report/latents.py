"""A look at latents while they are being trained: no decoder runs."""

import numpy as np
from jaxtyping import Float
from PIL import Image

from pipeline.diffusion.bundle import Bundle

_ZOOM = 4


def latent_preview(
    latents: Float[np.ndarray, "b 4 h w"], opacity: Float[np.ndarray, "b h w"], bundle: Bundle
) -> Image.Image:
    """Return views side by side in the bundle's linear map (else three channels), over their opacity."""
    rgb = bundle.linear_rgb(latents)
    if rgb is None:
        low, high = np.percentile(latents[:, :3], (1, 99))
        rgb = (latents[:, :3].transpose(0, 2, 3, 1) - low) / max(high - low, 1e-6)
    masks = np.repeat(opacity[..., None], 3, axis=-1)
    rows = [np.concatenate(list(pictures), axis=1) for pictures in (rgb, masks)]
    picture = (np.concatenate(rows).clip(0, 1) * 255).round().astype(np.uint8)
    image = Image.fromarray(picture)
    return image.resize((image.width * _ZOOM, image.height * _ZOOM), Image.Resampling.NEAREST)
