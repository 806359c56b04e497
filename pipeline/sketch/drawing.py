"""A silhouette drawn in two dimensions, as a solid: traced, and extruded along z.

Letters: h x w pixels, rows downwards; p points of an outline, v vertices, f faces. The drawing faces +z, its
top is up (+y), and a pixel is one unit.
"""

import io
from pathlib import Path

import cv2
import mapbox_earcut
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from PIL import Image, UnidentifiedImageError

from pipeline.errors import InputError
from pipeline.mesh.mesh import Mesh
from pipeline.sketch.svg import svg_to_png

_SIDE = 512
"""Drawings are traced at this size: the longer side [pixels]."""
_MOST_BYTES, _MOST_PIXELS = 50_000_000, 36_000_000
_LEAST_CONTRAST = 16
"""A drawing whose colours differ less from its border's shows nothing [of 255]."""
_LEAST_AREA = 2e-4
"""Parts and holes smaller than this share of the picture are specks."""


def read_silhouette(path: Path) -> Bool[np.ndarray, "h w"]:
    """Return where a PNG or SVG drawing shows its object: what is opaque or, where everything is opaque, what
    differs from the border.

    Raises:
        InputError: unreadable, too large, of another format, or nothing to see.
    """
    if path.stat().st_size > _MOST_BYTES:
        raise InputError(
            f"{path} has {path.stat().st_size} bytes, expected at most {_MOST_BYTES}: make it smaller"
        )
    data = svg_to_png(path, _SIDE) if path.suffix.lower() == ".svg" else path.read_bytes()
    try:
        with Image.open(io.BytesIO(data), formats=["PNG"]) as image:
            if image.width * image.height > _MOST_PIXELS:
                raise InputError(
                    f"{path} has {image.width} x {image.height} pixels, expected at most {_MOST_PIXELS}: "
                    "make it smaller"
                )
            pixels = np.asarray(_shrink(image.convert("RGBA")))
    except UnidentifiedImageError:
        raise InputError(f"{path} is not a readable PNG picture (no PNG header): export it as PNG") from None
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(f"{path} is not a readable PNG picture ({error}): export it again") from None
    mask = _foreground(pixels)
    if not mask.any() or mask.all():
        raise InputError(
            f"{path} shows no silhouette ({'one colour' if mask.all() else 'nothing'} everywhere): "
            "draw the object dark on a light background, or on a transparent one"
        )
    return mask


def extrude(mask: Bool[np.ndarray, "h w"], thickness: float) -> Mesh:
    """Return the solid whose front is the mask; `thickness` is a share of the mask's longer extent.

    Raises:
        ValueError: the mask has specks only.
    """
    rings = _outlines(mask)
    if not rings:
        raise ValueError("no part of it is large enough")
    rows, columns = np.nonzero(mask)
    depth = thickness * (max(np.ptp(rows), np.ptp(columns)) + 1)
    vertices: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    start = 0
    for shape in rings:
        flat = np.concatenate(shape) * [1.0, -1.0]
        count = len(flat)
        cap = mapbox_earcut.triangulate_float64(flat, np.cumsum([len(r) for r in shape]).astype(np.uint32))
        front = _counter_clockwise(flat, cap.reshape(-1, 3).astype(np.int64))
        walls = []
        first = 0
        for row, ring in enumerate(shape):
            here = first + np.arange(len(ring))
            if (_area(flat[here]) > 0) != (row == 0):  # solid on the left of every outline's direction
                here = here[::-1]
            there = np.roll(here, -1)
            walls += [
                np.stack([here, here + count, there + count], 1),
                np.stack([here, there + count, there], 1),
            ]
            first += len(ring)
        back = front[:, ::-1] + count
        vertices += [np.pad(flat, ((0, 0), (0, 1)), constant_values=z) for z in (depth / 2, -depth / 2)]
        faces += [index + start for index in (front, back, *walls)]
        start += 2 * count
    return Mesh(np.concatenate(vertices).astype(np.float32), np.concatenate(faces).astype(np.int32))


def _shrink(image: Image.Image) -> Image.Image:
    scale = _SIDE / max(image.size)
    return image.resize([max(1, round(side * scale)) for side in image.size], Image.Resampling.BOX)


def _foreground(pixels: UInt8[np.ndarray, "h w 4"]) -> Bool[np.ndarray, "h w"]:
    alpha = pixels[..., 3]
    if alpha.min() < 128:
        return np.asarray(alpha >= 128)
    rgb = pixels[..., :3].astype(np.int16)
    border = np.concatenate([rgb[0], rgb[-1], rgb[:, 0], rgb[:, -1]])
    difference = np.abs(rgb - np.median(border, axis=0)).max(axis=-1).astype(np.uint8)
    if difference.max() < _LEAST_CONTRAST:
        return np.zeros(alpha.shape, np.bool_)
    level, _ = cv2.threshold(difference, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return np.asarray(difference > max(level, _LEAST_CONTRAST / 2))


def _outlines(mask: Bool[np.ndarray, "h w"]) -> list[list[Float[np.ndarray, "p 2"]]]:
    """Return for every part of the mask its outline and those of its holes, in pixels (x, y downwards)."""
    # Doubled and padded, so that outlines run along the borders of pixels to half a pixel, also at the edge.
    grown = np.pad(mask.repeat(2, 0).repeat(2, 1).astype(np.uint8), 1)
    found, tree = cv2.findContours(grown, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    least = _LEAST_AREA * grown.size
    rings = {
        row: cv2.approxPolyDP(contour, 1.5, True)[:, 0].astype(np.float64) / 2
        for row, contour in enumerate(found)
        if cv2.contourArea(contour) >= least
    }
    whole = {row: ring for row, ring in rings.items() if len(ring) >= 3}
    return [
        [ring, *(whole[hole] for hole in whole if tree[0][hole][3] == row)]
        for row, ring in whole.items()
        if tree[0][row][3] < 0
    ]


def _area(ring: Float[np.ndarray, "p 2"]) -> float:
    """Return twice the area, positive if counter-clockwise with y up."""
    x, y = ring.T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def _counter_clockwise(
    points: Float[np.ndarray, "p 2"], faces: Int[np.ndarray, "f 3"]
) -> Int[np.ndarray, "f 3"]:
    a, b, c = np.moveaxis(points[faces], 1, 0)
    u, v = b - a, c - a
    turned = u[:, 0] * v[:, 1] < u[:, 1] * v[:, 0]
    return np.where(turned[:, None], faces[:, ::-1], faces)
