"""Colour words and what they look like."""

import numpy as np

# Hue [deg], saturation and value ranges: the clear middle of each name.
PALETTE = {
    "red": ((-4, 4), (0.85, 0.95), (0.72, 0.88)),
    "orange": ((24, 30), (0.88, 1.0), (0.92, 1.0)),
    "yellow": ((49, 54), (0.78, 0.95), (0.92, 1.0)),
    "green": ((110, 135), (0.6, 0.8), (0.45, 0.65)),
    "blue": ((212, 226), (0.75, 0.9), (0.65, 0.85)),
    "purple": ((268, 280), (0.58, 0.75), (0.5, 0.68)),
    "pink": ((325, 340), (0.4, 0.52), (0.94, 1.0)),
    "brown": ((20, 28), (0.6, 0.72), (0.34, 0.46)),
    "black": ((0, 360), (0.0, 0.08), (0.08, 0.13)),
    "white": ((0, 360), (0.0, 0.02), (0.93, 0.98)),
    "grey": ((0, 360), (0.0, 0.03), (0.45, 0.58)),
    "beige": ((34, 40), (0.2, 0.28), (0.83, 0.9)),
}
COLOURS = tuple(PALETTE)


def draw_colour(rng: np.random.Generator, name: str) -> np.ndarray:
    """Return a random (3,) float32 RGB colour of that name."""
    hue, saturation, value = (rng.uniform(*r) for r in PALETTE[name])
    return hsv_to_rgb(np.array([hue % 360, saturation, value], np.float32))


def hsv_to_rgb(hsv: np.ndarray) -> np.ndarray:
    """Convert one (3,) colour (hue in degrees, saturation, value) to RGB."""
    k = (np.array([5, 3, 1]) + hsv[0] / 60) % 6
    return (hsv[2] * (1 - hsv[1] * np.clip(np.minimum(k, 4 - k), 0, 1))).astype(np.float32)
