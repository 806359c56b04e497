"""Towers: a windmill and a lighthouse."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.outdoors.openings import arch, door, plate, window
from export.everyday_objects.data.makers.outdoors.palette import DARK_WOOD, STONE
from export.everyday_objects.data.makers.outdoors.placing import facing, ring_of
from export.everyday_objects.data.shapes import (
    DARK,
    GOLD,
    WHITE,
    WOOD,
    Part,
    bar,
    box,
    ellipsoid,
    fixed,
    lathe,
    moved,
    role,
    torus,
    turned,
)


def windmill(rng: np.random.Generator) -> list[Part]:
    """A tapering tower with a gallery and a round cap, four stout sails crossed in front of it."""
    low, high, tall = rng.uniform(0.32, 0.36), rng.uniform(0.2, 0.23), rng.uniform(0.82, 0.9)
    length, wide = rng.uniform(0.52, 0.57), rng.uniform(0.2, 0.23)

    def radius(y: float) -> float:
        """Of the tower at a height."""
        return low + (high - low) * y / tall

    body, frame = role("body"), role("body", 0.78)
    front = np.cos(np.pi / 8)
    parts = [
        turned(lathe([(0, 0), (low, 0), (high, tall), (0, tall)], body, sides=8), 1, np.pi / 8),
        turned(lathe([(0, 0), (low + 0.05, 0), (low + 0.05, 0.07), (0, 0.07)], STONE, sides=8), 1, np.pi / 8),
        turned(
            lathe(
                [(0, 0), (radius(0.4) + 0.1, 0), (radius(0.4) + 0.1, 0.05), (0, 0.05)], WOOD, (0, 0.36, 0), 8
            ),
            1,
            np.pi / 8,
        ),
        lathe(
            [
                (0, tall - 0.02),
                (high + 0.05, tall - 0.02),
                (high + 0.04, tall + 0.07),
                (0.75 * high, tall + 0.2),
                (0.35 * high, tall + 0.28),
                (0, tall + 0.3),
            ],
            role("cap"),
        ),
        *facing(door(0.19, 0.27, role("cap"), frame, True), 0, (0, 0.03, front * radius(0.15) - 0.01)),
    ]
    for angle in (np.pi / 2, np.pi, -np.pi / 2):
        for y in (0.15, 0.5):
            r = front * radius(y + 0.08) - 0.01
            parts += facing(
                window(0.13, 0.16, WHITE, edge=0.025, sill=False),
                angle,
                (r * np.sin(angle), y, r * np.cos(angle)),
            )
    hub = np.array([0, tall + 0.06, high + 0.15])
    sail = [
        box((0.06, length, 0.06), DARK_WOOD, (0, length / 2, 0)),
        box((wide, length - 0.14, 0.04), role("sails"), (-wide / 2, length / 2 + 0.07, -0.005)),
        *(box((wide, 0.025, 0.055), role("sails", 0.62), (-wide / 2, y, -0.005)) for y in (0.27, 0.4)),
    ]
    parts += [moved(p, hub) for p in ring_of(sail, 4, np.pi / 4, axis=2)]
    parts += [
        bar((0, hub[1], 0), hub + (0, 0, 0.03), 0.06, DARK_WOOD),
        ellipsoid((0.075, 0.075, 0.06), GOLD, hub + (0, 0, 0.03)),
    ]
    return parts


def lighthouse(rng: np.random.Generator) -> list[Part]:
    """A tapering tower in broad bands on a rock, a gallery, a shining lantern room and a dome."""
    low, high, tall = rng.uniform(0.27, 0.3), rng.uniform(0.175, 0.195), rng.uniform(0.74, 0.82)
    y = np.linspace(0.1, 0.1 + tall, 6)
    radius, top = np.linspace(low, high, 6), 0.1 + tall
    tower, stripes = role("tower"), role("stripes")
    rock = [(0, 0), (low + 0.16, 0), (low + 0.15, 0.06), (low + 0.07, 0.1), (low + 0.06, 0.15), (0, 0.15)]
    dome = [(0, 0), (0.2, 0), (0.195, 0.04), (0.14, 0.12), (0.06, 0.17), (0, 0.18)]
    parts = [lathe(rock, STONE, sides=9)]
    for k in range(5):
        a, b = radius[k] + 0.012 * (k % 2), radius[k + 1] + 0.012 * (k % 2)
        band = [(0, y[k]), (a, y[k]), (b, y[k + 1]), (0, y[k + 1])]
        parts.append(lathe(band, stripes if k % 2 else tower))
    for k in (2, 4):
        pane = plate(arch(0.1, 0.8 * (y[1] - y[0])), DARK, 0.015, -0.06)
        parts += ring_of([moved(pane, (0, y[k] + 0.1 * (y[1] - y[0]), (radius[k] + radius[k + 1]) / 2))], 4)
    gallery = [
        (0, top - 0.05),
        (high, top - 0.05),
        (high + 0.09, top),
        (high + 0.09, top + 0.05),
        (0, top + 0.05),
    ]
    return [
        *parts,
        lathe(gallery, role("tower", 0.85)),
        torus(high + 0.07, 0.025, stripes, (0, top + 0.1, 0)),
        *ring_of([box((0.035, 0.07, 0.035), stripes, (0, top + 0.07, high + 0.07))], 8),
        lathe([(0, 0), (0.14, 0), (0.14, 0.26), (0, 0.26)], fixed(1.0, 0.86, 0.38), (0, top, 0), 16),
        *ring_of([box((0.03, 0.26, 0.03), DARK, (0, top + 0.13, 0.137))], 6),
        lathe(dome, stripes, (0, top + 0.25, 0)),
        ellipsoid(0.05, role("stripes", 0.8), (0, top + 0.44, 0)),
    ]


KINDS = (
    Kind(
        ("windmill",),
        windmill,
        {"body": ("white", "beige"), "cap": ("red", "blue"), "sails": ("red", "brown")},
        {"cap": "a {} roof", "sails": "{} sails"},
    ),
    Kind(
        ("lighthouse",),
        lighthouse,
        {"tower": ("white",), "stripes": ("red",)},
        {"stripes": "{} stripes"},
        front=False,
    ),
)
