"""PNG files: pictures of the pipeline, without dates or other ancillary text, whole or absent."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from pipeline import files


def to_bytes(image: Float[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """Return 8-bit colours of colours in [0, 1], clipped."""
    return np.asarray(np.round(np.clip(image, 0.0, 1.0) * 255), np.uint8)


def write_png(path: Path, picture: Image.Image | Float[np.ndarray, "h w 3"]) -> None:
    """Write a picture, as it is or of colours in [0, 1], in place of what was there."""
    image = picture if isinstance(picture, Image.Image) else Image.fromarray(to_bytes(picture))
    partial = path.with_name(f".{path.name}")
    image.save(partial, format="PNG")
    files.publish([(partial, path)])
