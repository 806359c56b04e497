"""A look at latents while they are being trained: no decoder runs."""

import numpy as np
from jaxtyping import Float
from PIL import Image

from pipeline.diffusion.bundle import Bundle
from pipeline.diffusion.rgb_gradients import LATENT_TO_RGB

_ZOOM = 4


def latent_preview(
    latents: Float[np.ndarray, "b 4 h w"], opacity: Float[np.ndarray, "b h w"], bundle: Bundle
) -> Image.Image:
    """Return views side by side in colours, over their opacity: by the bundle's linear map, else by the
    paper's for Stable Diffusion, which foreign folders are likely to be."""
    rgb = bundle.linear_rgb(latents)
    if rgb is None:
        rgb = (np.einsum("rc,bchw->bhwr", np.array(LATENT_TO_RGB), latents) + 1) / 2
    masks = np.repeat(opacity[..., None], 3, axis=-1)
    rows = [np.concatenate(list(pictures), axis=1) for pictures in (rgb, masks)]
    picture = (np.concatenate(rows).clip(0, 1) * 255).round().astype(np.uint8)
    image = Image.fromarray(picture)
    return image.resize((image.width * _ZOOM, image.height * _ZOOM), Image.Resampling.NEAREST)
