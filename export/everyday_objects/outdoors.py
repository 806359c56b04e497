"""Procedural things that stand outside: each function returns a random one, y up, front to +z."""

from collections.abc import Callable

import numpy as np

from export.everyday_objects.captions import COLOURS
from export.everyday_objects.catalogue import Model
from export.everyday_objects.shapes import Part, assemble, bar, ellipsoid, frustum, lathe, pick

DARK = np.array([0.04, 0.04, 0.05])


def hydrant(rng: np.random.Generator) -> Model:
    """A fire hydrant: a post with a dome, a flange and three outlets."""
    colour = pick(rng, "red", "red", "red", "yellow", *COLOURS)
    cap = colour if rng.random() < 0.7 else pick(rng, "white", "yellow", "grey")
    r = rng.uniform(0.16, 0.2)
    parts = [
        lathe(
            [
                (0, 0),
                (r * 1.5, 0),
                (r * 1.5, 0.06),
                (r, 0.08),
                (r, 0.62),
                (r * 1.25, 0.63),
                (r * 1.25, 0.69),
                (r, 0.7),
            ],
            colour,
        )
    ]
    parts += [
        ellipsoid((r, r * 0.9, r), cap, (0, 0.69, 0), 0, np.pi / 2),
        lathe([(0.05, 0.8), (0.05, 0.95), (0, 0.95)], cap),
    ]
    for axis in ((1, 0, 0), (-1, 0, 0), (0, 0, 1)):
        d = np.array(axis, np.float64)
        size = 0.1 if axis[2] else 0.07
        parts.append(bar(d * r * 0.8 + (0, 0.48, 0), d * (r + 0.13) + (0, 0.48, 0), size, cap))
    return assemble(parts)


def cactus(rng: np.random.Generator) -> Model:
    """A ribbed column with bent arms, in a pot."""
    green, pot = pick(rng, "green") * rng.uniform(0.7, 1.0), pick(rng, "orange", "brown", *COLOURS)
    r, h = rng.uniform(0.1, 0.15), rng.uniform(0.6, 0.85)
    parts = [
        lathe([(0, 0), (0.16, 0), (0.22, 0.26), (0.0, 0.24)], pot),
        bar((0, 0.2, 0), (0, h, 0), r, green),
        ellipsoid((r,) * 3, green, (0, h, 0)),
    ]
    for s in (-1, 1) if rng.random() < 0.8 else (1,):
        y, out, up = rng.uniform(0.4, 0.55), rng.uniform(0.2, 0.28), rng.uniform(0.12, 0.3)
        parts += [
            bar((0, y, 0), (s * out, y, 0), r * 0.6, green),
            ellipsoid((r * 0.6,) * 3, green, (s * out, y, 0)),
        ]
        parts += [
            bar((s * out, y, 0), (s * out, y + up, 0), r * 0.6, green),
            ellipsoid((r * 0.6,) * 3, green, (s * out, y + up, 0)),
        ]
    return assemble(parts)


def pine_tree(rng: np.random.Generator) -> Model:
    """A trunk and stacked cones, sometimes with baubles."""
    green = pick(rng, "green") * rng.uniform(0.6, 1.0)
    tiers, parts = int(rng.integers(3, 6)), [bar((0, 0, 0), (0, 0.3, 0), 0.08, pick(rng, "brown"))]
    decorated = rng.random() < 0.35
    for i in range(tiers):
        r, y = 0.46 * (1 - i / (tiers + 0.6)), 0.2 + i * 0.26
        parts.append(lathe([(0.02, y), (r, y), (0.02, y + 0.48)], green * rng.uniform(0.92, 1.08)))
        if decorated:
            parts += [
                ellipsoid(
                    (0.045,) * 3, pick(rng, "red", "yellow", "blue"), (r * np.sin(a), y + 0.02, r * np.cos(a))
                )
                for a in np.arange(6) + i
            ]
    if decorated:
        parts.append(
            ellipsoid((0.07, 0.07, 0.07), np.array([0.98, 0.85, 0.2]), (0, 0.7 + (tiers - 1) * 0.26, 0))
        )
    return assemble(parts)


def tree(rng: np.random.Generator) -> Model:
    """A trunk that forks under a round crown of leaves."""
    green, bark = pick(rng, "green") * rng.uniform(0.65, 1.0), pick(rng, "brown")
    tall, r = rng.uniform(0.45, 0.65), rng.uniform(0.38, 0.5)
    fork = (0.0, tall * 0.7, 0.0)
    crown = ellipsoid((r, r * rng.uniform(0.8, 1.1), r), green, (0, tall + r, 0))
    parts = [bar((0, 0, 0), fork, 0.09, bark, 0.8), crown]
    for a in rng.uniform(0, 0.8) + np.arange(5) * 2 * np.pi / 5:
        out, y, size = 0.6 * r, tall + r * rng.uniform(0.5, 1.3), r * rng.uniform(0.5, 0.65)
        at = (out * np.sin(a), y, out * np.cos(a))
        parts += [bar(fork, at, 0.045, bark, 0.5), ellipsoid((size,) * 3, green * rng.uniform(0.88, 1.1), at)]
    return assemble(parts)


def dog_house(rng: np.random.Generator) -> Model:
    """A small hut with a gable roof and a dark arch at the front."""
    wall, roof = pick(rng, "brown", "beige", *COLOURS), pick(rng, "red", "brown", "black", "blue", "green")
    w, h, d, r = rng.uniform(0.6, 0.8), rng.uniform(0.4, 0.5), rng.uniform(0.7, 1.0), rng.uniform(0.28, 0.4)
    parts: list[Part] = [
        frustum((w, d), (w, d), h, wall, (0, 0, 0)),
        frustum((w, d), (0.01, d), r, wall, (0, h, 0)),
    ]
    slope = np.array([[-1, 0, -1], [-1, 0, 1], [0, 1, 1], [0, 1, -1], [1, 0, -1], [1, 0, 1]]) * (
        w / 2 + 0.08,
        r + 0.05,
        d / 2 + 0.06,
    )
    parts.append((slope + (0, h - 0.02, 0), np.array([[0, 1, 2], [0, 2, 3], [3, 2, 5], [3, 5, 4]]), roof))
    parts.append(frustum((w * 0.42, 0.03), (w * 0.42, 0.03), h * 0.6, DARK, (0, 0.02, d / 2)))
    parts.append(ellipsoid((w * 0.21, w * 0.21, 0.02), DARK, (0, 0.02 + h * 0.6, d / 2)))
    return assemble(parts)


MAKERS: dict[str, Callable[[np.random.Generator], Model]] = {
    "fire hydrant": hydrant, "cactus": cactus, "pine tree": pine_tree, "dog house": dog_house,
    "tree": tree,
}  # fmt: skip
