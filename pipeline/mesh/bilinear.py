"""Bilinear lookups in a texture, clamped at its border."""

import numpy as np
from jaxtyping import Float, Int


def neighbours(
    uv: Float[np.ndarray, "*points 2"], width: int, height: int
) -> tuple[Int[np.ndarray, "*points 4"], Float[np.ndarray, "*points 4"]]:
    """Return the four texels around points in [0, 1]^2, row-major, and their shares, which sum to 1."""
    size = np.array([width, height])
    place = np.clip(uv * size - 0.5, 0, size - 1)
    low = np.minimum(place.astype(np.int64), size - 1)
    high = np.minimum(low + 1, size - 1)
    x, y = np.moveaxis(place - low, -1, 0)
    rows, columns = (low[..., 1] * width, high[..., 1] * width), (low[..., 0], high[..., 0])
    texels = np.stack([row + column for row in rows for column in columns], axis=-1)
    return texels, np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], axis=-1)


def sample(
    texture: Float[np.ndarray, "h w c"], uv: Float[np.ndarray, "*points 2"]
) -> Float[np.ndarray, "*points c"]:
    """Return the texture's colours at points."""
    texels, shares = neighbours(uv, texture.shape[1], texture.shape[0])
    colours = texture.reshape(-1, texture.shape[2])[texels]
    return np.asarray(np.einsum("...k,...kc->...c", shares, colours))
