"""Temples: a Greek one and a pagoda."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.outdoors.openings import arch, plate, rectangle
from export.everyday_objects.data.makers.outdoors.palette import DARK_STONE, STONE
from export.everyday_objects.data.makers.outdoors.placing import facing, ring_of
from export.everyday_objects.data.makers.outdoors.roofs import gable_block
from export.everyday_objects.data.shapes import (
    DARK,
    GOLD,
    Paint,
    Part,
    bar,
    both_sides,
    box,
    ellipsoid,
    extrude,
    grid_faces,
    lathe,
    moved,
    role,
    tube,
    turned,
)


def temple(rng: np.random.Generator) -> list[Part]:
    """A Greek temple: steps, stout columns all around, an entablature, pediments and a low roof."""
    width, depth, tall = rng.uniform(0.8, 0.9), rng.uniform(0.92, 1.02), rng.uniform(0.36, 0.42)
    rise, thick = rng.uniform(0.19, 0.23), rng.uniform(0.055, 0.062)
    stone, dark = role("stone"), role("stone", 0.72)
    parts = [
        box(
            (width + 0.08 * i, 0.065, depth + 0.08 * i),
            role("stone", 1 - 0.05 * i),
            (0, 0.165 - 0.065 * i, 0),
        )
        for i in range(3)
    ]
    foot, w, d = 0.19, width / 2 - 0.08, depth / 2 - 0.08
    shaft = [
        (0, 0),
        (thick * 1.35, 0),
        (thick * 1.35, 0.035),
        (thick * 1.02, 0.05),
        (thick * 0.85, tall - 0.06),
        (thick * 1.4, tall - 0.03),
        (thick * 1.4, tall),
        (0, tall),
    ]
    places = {(x, z) for x in np.linspace(-w, w, 4) for z in (-d, d)} | {
        (x, z) for x in (-w, w) for z in np.linspace(-d, d, 5)
    }
    parts += [lathe(shaft, stone, (x, foot, z), 16) for x, z in sorted(places)]
    top = foot + tall
    parts += [
        box((width - 0.3, tall, depth - 0.34), dark, (0, foot + tall / 2, 0)),
        *facing([plate(rectangle(0.17, 0.28), DARK, 0.02)], 0, (0, foot, depth / 2 - 0.17)),
        *facing([plate(rectangle(0.17, 0.28), DARK, 0.02)], np.pi, (0, foot, 0.17 - depth / 2)),
        box((width - 0.02, 0.07, depth - 0.02), stone, (0, top + 0.035, 0)),
        box((width - 0.05, 0.05, depth - 0.05), dark, (0, top + 0.09, 0)),
        box((width + 0.06, 0.05, depth + 0.06), stone, (0, top + 0.135, 0)),
        moved(gable_block(width - 0.02, 0, rise - 0.01, depth - 0.02, dark), (0, top + 0.15, 0)),
    ]
    slope = [(width / 2 + 0.03, 0.0), (0, rise), (0, rise + 0.06), (width / 2 + 0.03, 0.055)]
    rake = moved(extrude(slope, depth + 0.06, stone), (0, top + 0.15, 0))
    tiles = [(x, y + 0.05) for x, y in slope[:2]] + [(0, rise + 0.09), (width / 2 + 0.05, 0.085)]
    parts += both_sides(rake, moved(extrude(tiles, depth - 0.06, role("roof")), (0, top + 0.15, 0)))
    for s in (-1, 1):
        z = s * (depth / 2 - 0.01)
        emblem = turned(lathe([(0, -0.02), (0.07, -0.02), (0.07, 0.02), (0, 0.02)], stone), 0, np.pi / 2)
        parts += [
            moved(emblem, (0, top + 0.15 + 0.4 * rise, z)),
            ellipsoid((0.06, 0.075, 0.05), stone, (0, top + rise + 0.25, z * 0.95)),
        ]
    return parts


def _swept_roof(
    inner: float, outer: float, height: float, lift: float, paint: Paint, rim: Paint
) -> list[Part]:
    """A square roof that sags and turns its corners up, its eaves at y = 0; a thick rim along the eaves."""
    angle = np.arange(64) * 2 * np.pi / 64
    c, s = np.abs(np.cos(angle)), np.abs(np.sin(angle))
    square, corner = 1 / np.maximum(c, s), (np.minimum(c, s) / np.maximum(c, s)) ** 4
    t = np.linspace(0, 1, 9)[:, None]
    radius = (inner + (outer - inner) * t) * square
    y = height * (1 - t) ** 1.7 + lift * t**2 * corner
    rows = np.stack([radius * np.sin(angle), y, radius * np.cos(angle)], -1)
    below = rows[::-1] - (0, 0.05, 0)
    grid = np.concatenate([rows, below, rows[:1]])
    edge = np.concatenate([rows[-1], rows[-1, :2]]) - (0, 0.02, 0)
    ridges = [tube(list(rows[:, k] + (0, 0.01, 0)), 0.03, rim, 8) for k in (8, 24, 40, 56)]
    return [
        Part(grid.reshape(-1, 3), grid_faces(len(grid), 64), paint),
        tube(list(edge), 0.038, rim, 8),
        *ridges,
    ]


def pagoda(rng: np.random.Generator) -> list[Part]:
    """Three storeys that shrink upwards, each with a sagging roof with upturned corners, a golden finial."""
    shrink, wide, storey = rng.uniform(0.77, 0.82), rng.uniform(0.27, 0.3), rng.uniform(0.28, 0.31)
    walls, rim, y = role("walls"), role("walls", 0.85), 0.12
    parts = [
        box((wide * 3.1, 0.07, wide * 3.1), STONE, (0, 0.035, 0)),
        box((wide * 2.7, 0.06, wide * 2.7), DARK_STONE, (0, 0.09, 0)),
    ]
    for k in range(3):
        w, h = wide * shrink**k, storey * (0.93**k)
        opening = [
            plate(arch(0.7 * w, 0.68 * h), GOLD, 0.02),
            plate(arch(0.48 * w, 0.56 * h), DARK, 0.035),
        ]
        side = [*facing(opening, 0, (0, 0, w)), bar((w, 0, w), (w, h, w), 0.035, rim, sides=8)]
        parts += [
            moved(p, (0, y, 0)) for p in [box((2 * w, h, 2 * w), walls, (0, h / 2, 0)), *ring_of(side, 4)]
        ]
        last = k == 2
        y += h
        parts += [
            moved(p, (0, y, 0))
            for p in _swept_roof(
                0.02 if last else 0.7 * w,
                1.62 * w,
                (0.85 if last else 0.42) * w,
                0.28 * w,
                role("roofs"),
                rim,
            )
        ]
        y += (0.82 if last else 0.36) * w
    finial = [(0, 0), (0.06, 0), (0.07, 0.04), (0.03, 0.07), (0.06, 0.11), (0.03, 0.15), (0, 0.19)]
    return [*parts, lathe(finial, GOLD, (0, y - 0.02, 0), 16)]


KINDS = (
    Kind(
        ("temple", "greek temple"),
        temple,
        {"stone": ("white", "beige"), "roof": ("orange", "red")},
        {"roof": "a {} roof"},
        weight=1.1,
    ),
    Kind(
        ("pagoda",),
        pagoda,
        {"walls": ("red",), "roofs": ("green", "grey")},
        {"roofs": "{} roofs"},
        front=False,
    ),
)
