"""Procedural animals and toys: each function returns a random one, y up, front to +z."""

from collections.abc import Callable

import numpy as np

from export.everyday_objects.captions import COLOURS
from export.everyday_objects.catalogue import Model
from export.everyday_objects.shapes import Part, assemble, bar, ellipsoid, lathe, pick, tilt

DARK = np.array([0.04, 0.04, 0.05])


def placed(part: Part, at: tuple[float, float, float]) -> Part:
    """The part moved."""
    return part[0] + at, part[1], part[2]


def eyes(x: float, y: float, z: float, size: float) -> list[Part]:
    """Two dark eyes."""
    return [ellipsoid((size,) * 3, DARK, (s * x, y, z)) for s in (-1, 1)]


def horse(rng: np.random.Generator) -> Model:
    """Barrel, long legs, a neck that rises to the front, a long head, mane and tail."""
    coat = pick(rng, "brown", "brown", "black", "white", "grey", "beige", *COLOURS)
    hair = pick(rng, "black", "brown", "white", "beige")
    leg, body = rng.uniform(0.62, 0.75), rng.uniform(0.5, 0.58)
    y = leg + 0.16
    parts = [ellipsoid((0.21, 0.22, body), coat, (0, y, 0))]
    for s in (-1, 1):
        for z in (-body * 0.72, body * 0.68):
            parts += [
                bar((s * 0.12, 0.05, z), (s * 0.12, y, z), 0.045, coat, 1.8),
                lathe([(0.06, 0), (0.05, 0.08)], DARK, (s * 0.12, 0, z)),
            ]
    head = (0.0, y + rng.uniform(0.5, 0.6), body + 0.22)
    neck = bar((0, y + 0.02, body * 0.7), (0, head[1], head[2] - 0.08), 0.16, coat, 0.6)
    parts += [
        neck,
        placed(tilt(ellipsoid((0.09, 0.1, 0.24), coat), 0, 0.6), (0, head[1] - 0.06, head[2] + 0.05)),
    ]
    parts += [
        bar(
            (s * 0.05, head[1] + 0.06, head[2] - 0.1),
            (s * 0.06, head[1] + 0.18, head[2] - 0.12),
            0.03,
            coat,
            0.3,
        )
        for s in (-1, 1)
    ]
    parts.append(bar((0, y + 0.2, body * 0.62), (0, head[1] + 0.05, head[2] - 0.18), 0.06, hair))
    parts.append(bar((0, y + 0.1, -body * 0.95), (0, y - 0.4, -body - 0.16), 0.05, hair, 1.4))
    return assemble(parts + eyes(0.085, head[1], head[2], 0.02))


def quadruped(
    rng: np.random.Generator, leg: float, body: float, ear: str, tail: float, snout: float
) -> Model:
    """A small animal on four legs; ears pointed or hanging; a tail that rises by `tail`."""
    coat = pick(rng, "brown", "black", "white", "grey", "beige", "orange", *COLOURS)
    paws = coat if rng.random() < 0.6 else pick(rng, "white", "black")
    y, r = leg + 0.1, rng.uniform(0.15, 0.19)
    parts = [ellipsoid((r, r * 1.05, body), coat, (0, y, 0))]
    for s in (-1, 1):
        parts += [
            bar((s * r * 0.62, 0, z), (s * r * 0.62, y, z), 0.05, paws if z > 0 else coat, 1.3)
            for z in (-body * 0.65, body * 0.65)
        ]
    h = rng.uniform(0.17, 0.21)
    head = np.array([0, y + 0.3, body + 0.06])
    parts += [bar((0, y, body * 0.7), head, 0.11, coat), ellipsoid((h, h * 0.92, h), coat, head)]
    parts.append(
        ellipsoid(
            (h * 0.5, h * 0.42, snout),
            coat if rng.random() < 0.5 else pick(rng, "white", "beige"),
            head + (0, -0.05, h * 0.85),
        )
    )
    parts.append(ellipsoid((0.035, 0.03, 0.03), DARK, head + (0, -0.01, h * 0.85 + snout)))
    for s in (-1, 1):
        if ear == "pointed":
            parts.append(
                bar(head + (s * h * 0.6, h * 0.6, 0), head + (s * h * 0.75, h * 1.45, 0), 0.07, coat, 0.1)
            )
        else:
            parts.append(ellipsoid((0.04, 0.14, 0.08), coat, head + (s * h * 0.98, -0.04, 0)))
    parts.append(bar((0, y + 0.08, -body * 0.9), (0, y + 0.08 + tail, -body - 0.24), 0.035, coat, 0.8))
    return assemble(parts + eyes(h * 0.42, head[1] + 0.05, head[2] + h * 0.85, 0.03))


def cat(rng: np.random.Generator) -> Model:
    """Pointed ears, a flat face, a raised tail."""
    return quadruped(
        rng, rng.uniform(0.2, 0.28), rng.uniform(0.32, 0.4), "pointed", rng.uniform(0.15, 0.4), 0.07
    )


def dog(rng: np.random.Generator) -> Model:
    """Hanging or pointed ears, a snout."""
    ear = "hanging" if rng.random() < 0.7 else "pointed"
    return quadruped(rng, rng.uniform(0.24, 0.36), rng.uniform(0.34, 0.44), ear, rng.uniform(0.1, 0.25), 0.15)


def rabbit(rng: np.random.Generator) -> Model:
    """A sitting rabbit with long upright ears."""
    coat = pick(rng, "white", "brown", "grey", "beige", *COLOURS)
    inner = np.array([0.95, 0.7, 0.72])
    parts = [
        ellipsoid((0.26, 0.32, 0.3), coat, (0, 0.3, -0.05)),
        ellipsoid((0.2, 0.19, 0.2), coat, (0, 0.72, 0.12)),
    ]
    tall = rng.uniform(0.28, 0.42)
    for s in (-1, 1):
        parts += [
            ellipsoid((0.06, tall / 2, 0.035), coat, (s * 0.09, 0.86 + tall / 2, 0.05)),
            ellipsoid((0.035, tall / 2.6, 0.02), inner, (s * 0.09, 0.86 + tall / 2, 0.075)),
        ]
        parts += [
            ellipsoid((0.08, 0.06, 0.16), coat, (s * 0.14, 0.06, 0.2)),
            ellipsoid((0.06, 0.16, 0.06), coat, (s * 0.1, 0.22, 0.22)),
        ]
    parts += [
        ellipsoid((0.08, 0.08, 0.08), np.array([0.96, 0.96, 0.96]), (0, 0.2, -0.36)),
        ellipsoid((0.025,) * 3, inner, (0, 0.7, 0.32)),
    ]
    return assemble(parts + eyes(0.1, 0.77, 0.28, 0.03))


def teddy_bear(rng: np.random.Generator) -> Model:
    """A sitting toy bear: round belly, head with round ears and a muzzle, arms, legs."""
    fur = pick(rng, "brown", "brown", "beige", *COLOURS)
    pale = np.clip(fur * 1.25 + 0.08, 0, 1)
    s = rng.uniform(0.9, 1.1)
    parts = [
        ellipsoid((0.3, 0.34, 0.26), fur, (0, 0.34, 0)),
        ellipsoid((0.25 * s, 0.23 * s, 0.23 * s), fur, (0, 0.84, 0.02)),
        ellipsoid((0.11, 0.09, 0.1), pale, (0, 0.78, 0.22 * s)),
        ellipsoid((0.035, 0.028, 0.03), DARK, (0, 0.82, 0.31 * s)),
        ellipsoid((0.18, 0.2, 0.1), pale, (0, 0.34, 0.2)),
    ]
    for side in (-1, 1):
        parts.append(ellipsoid((0.085, 0.085, 0.05), fur, (side * 0.19 * s, 1.03, 0)))
        parts.append(
            placed(tilt(ellipsoid((0.09, 0.22, 0.1), fur), 2, side * 0.6), (side * 0.33, 0.45, 0.08))
        )
        parts.append(
            placed(tilt(ellipsoid((0.11, 0.11, 0.26), fur), 1, -side * 0.3), (side * 0.2, 0.12, 0.24))
        )
        parts.append(ellipsoid((0.09, 0.1, 0.04), pale, (side * 0.27, 0.13, 0.47)))
    return assemble(parts + eyes(0.09 * s, 0.9, 0.21 * s, 0.028))


MAKERS: dict[str, Callable[[np.random.Generator], Model]] = {
    "horse": horse, "cat": cat, "dog": dog, "rabbit": rabbit, "teddy bear": teddy_bear,
}  # fmt: skip
