"""Tell an object from the plain backdrop it was pictured on, so that no model learns the backdrop."""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

TOLERANCE = 14
"""A backdrop's colours are this close to their median in each channel, of 255."""
PLAIN = 0.9
"""Share of the outermost pixels that must be backdrop; an object may touch the border."""


def coverage(image: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w"] | None:
    """Return where the object is, 1, and where the backdrop, 0, float32; None without a plain backdrop.

    The backdrop is what is connected to the border and has its colour: a hole in the object that shows it
    stays, a part of the object in the same colour stays too unless it touches the border.
    """
    border = np.concatenate([image[0], image[-1], image[1:-1, 0], image[1:-1, -1]]).astype(np.int16)
    colour = np.median(border, axis=0)
    if (np.abs(border - colour).max(1) <= TOLERANCE).mean() < PLAIN:
        return None
    alike = (np.abs(image.astype(np.int16) - colour).max(2) <= TOLERANCE).astype(np.uint8)
    parts, labels = cv2.connectedComponents(alike, connectivity=4)
    outside = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    backdrop = np.isin(np.arange(parts), outside[outside > 0])[labels]
    # A pixel at the edge mixes both.
    backdrop = cv2.dilate(backdrop.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    return (~backdrop).astype(np.float32)
