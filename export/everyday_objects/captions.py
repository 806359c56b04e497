"""Colour words and captions.

Colours are named by what is seen (unlit), with boundaries in hue, saturation and value; the same boundaries
bound the colours that recolouring draws, so a caption and its picture agree by construction.
"""

import numpy as np

from export.everyday_objects.nouns import NOUNS, Noun
from pipeline.diffusion.prompts import view_words

COLOURS = (
    "red",
    "orange",
    "yellow",
    "green",
    "blue",
    "purple",
    "pink",
    "brown",
    "black",
    "white",
    "grey",
    "beige",
)
# Hue [deg], saturation and value ranges that recolouring draws from: the clear middle of each name.
PALETTE = {
    "red": ((-8, 8), (0.75, 1.0), (0.55, 0.95)),
    "orange": ((22, 33), (0.8, 1.0), (0.85, 1.0)),
    "yellow": ((48, 58), (0.7, 1.0), (0.85, 1.0)),
    "green": ((95, 145), (0.5, 1.0), (0.35, 0.85)),
    "blue": ((205, 235), (0.6, 1.0), (0.45, 1.0)),
    "purple": ((265, 285), (0.5, 0.9), (0.45, 0.8)),
    "pink": ((315, 345), (0.3, 0.6), (0.9, 1.0)),
    "brown": ((18, 32), (0.5, 0.8), (0.25, 0.5)),
    "black": ((0, 360), (0.0, 0.2), (0.03, 0.14)),
    "white": ((0, 360), (0.0, 0.04), (0.92, 1.0)),
    "grey": ((0, 360), (0.0, 0.06), (0.4, 0.65)),
    "beige": ((30, 45), (0.15, 0.3), (0.8, 0.93)),
}


def draw_colour(rng: np.random.Generator, name: str) -> np.ndarray:
    """Return a random (3,) RGB colour of that name."""
    hue, saturation, value = (rng.uniform(*r) for r in PALETTE[name])
    return hsv_to_rgb(np.array([hue % 360, saturation, value], np.float32))


def hsv_to_rgb(hsv: np.ndarray) -> np.ndarray:
    """Convert one (3,) colour (hue in degrees, saturation, value) to RGB."""
    k = (np.array([5, 3, 1]) + hsv[0] / 60) % 6
    return (hsv[2] * (1 - hsv[1] * np.clip(np.minimum(k, 4 - k), 0, 1))).astype(np.float32)


def rgb_to_hsv(rgb: np.ndarray) -> np.ndarray:
    """Convert (n, 3) RGB in [0, 1] to hue [deg], saturation, value."""
    value, low = rgb.max(-1), rgb.min(-1)
    chroma = value - low
    safe = np.where(chroma > 0, chroma, 1)
    r, g, b = rgb[:, 0], rgb[:, 1], rgb[:, 2]
    hue = np.where(
        value == r, (g - b) / safe % 6, np.where(value == g, (b - r) / safe + 2, (r - g) / safe + 4)
    )
    return np.stack([hue * 60, np.where(value > 0, chroma / np.where(value > 0, value, 1), 0), value], -1)


def name_colours(rgb: np.ndarray) -> np.ndarray:
    """Return the index into COLOURS of each of (n, 3) RGB colours."""
    hue, saturation, value = rgb_to_hsv(rgb).T
    by_hue = np.select(
        [hue < 14, hue < 42, hue < 70, hue < 170, hue < 255, hue < 292, hue < 347],
        [COLOURS.index(c) for c in ("red", "orange", "yellow", "green", "blue", "purple", "pink")],
        COLOURS.index("red"),
    )
    brownish = (hue >= 10) & (hue < 50) & (value < 0.7)
    by_hue = np.where(brownish, COLOURS.index("brown"), by_hue)
    by_hue = np.where((by_hue == COLOURS.index("pink")) & (value < 0.55), COLOURS.index("purple"), by_hue)
    by_hue = np.where(
        (by_hue == COLOURS.index("red")) & (saturation < 0.5) & (value > 0.75), COLOURS.index("pink"), by_hue
    )
    pale = (saturation < 0.38) & (hue >= 18) & (hue < 65) & (value > 0.6)
    by_hue = np.where(pale, COLOURS.index("beige"), by_hue)
    neutral = (saturation < 0.13) | (value < 0.13)
    shade = np.select(
        [value < 0.2, value > 0.8], [COLOURS.index("black"), COLOURS.index("white")], COLOURS.index("grey")
    )
    return np.where(neutral | (value < 0.16), shade, by_hue)


def dominant_colours(albedo: np.ndarray) -> str:
    """Return the colour words for an object's (n, 3) samples: one, two joined by "and", or none ("")."""
    if len(albedo) == 0:
        return ""
    shares = np.bincount(name_colours(albedo[:: max(1, len(albedo) // 2000)]), minlength=len(COLOURS))
    shares = shares / shares.sum()
    first, second = np.argsort(-shares, kind="stable")[:2]
    if shares[first] > 0.55:
        return COLOURS[first]
    if shares[first] + shares[second] > 0.75 and shares[second] > 0.25:
        return f"{COLOURS[first]} and {COLOURS[second]}"
    return ""


def caption(rng: np.random.Generator, noun: Noun, look: str, azimuth: float, polar: float) -> str:
    """Return a caption; parts are left out at random so that every part also works alone.

    look: colour or material words, may be empty. azimuth, polar: of the camera [rad].
    """
    word = noun.words[0] if rng.random() < 0.75 else noun.words[rng.integers(len(noun.words))]
    if rng.random() < 0.15:
        look = ""
    if look and rng.random() < 0.04:
        word = "object"
    text = f"{look} {word}".strip()
    if rng.random() < 0.85:
        text = f"{'an' if text[0] in 'aeiou' else 'a'} {text}"
    if rng.random() < 0.9:
        text = f"{text}, {view_words('eight', azimuth, polar)}"
    return text


def known_words() -> list[str]:
    """Return every word that captions are made of, sorted."""
    nouns = " ".join(w for n in NOUNS for w in n.words)
    views = "front back left right side overhead view"
    return sorted(set(f"{nouns} {' '.join(COLOURS)} {views} a an and object wooden".split()))
