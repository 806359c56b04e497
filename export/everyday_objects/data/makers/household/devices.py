"""Devices: an alarm clock and a camera."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.household.pieces import bead
from export.everyday_objects.data.makers.household.plates import lying
from export.everyday_objects.data.makers.household.turning import disc_profile
from export.everyday_objects.data.shapes import (
    DARK,
    GLASS,
    GOLD,
    LAMP,
    RED,
    STEEL,
    WHITE,
    Part,
    bar,
    both_sides,
    box,
    cushion,
    ellipsoid,
    fixed,
    frustum,
    lathe,
    moved,
    role,
    torus,
    turned,
)


def alarm_clock(rng: np.random.Generator) -> list[Part]:
    """A round alarm clock: white face with hands, two bells with a hammer on top, two feet."""
    deep, lean = rng.uniform(0.34, 0.42), rng.uniform(0.5, 0.6)
    front = deep / 2
    parts = [
        lying(lathe(disc_profile(0.6, -front, front, 0.06), role("clock"), sides=48)),
        moved(lying(torus(0.54, 0.08, role("clock", 0.8))), (0, 0, front)),
        moved(lying(lathe(disc_profile(0.51, 0, 0.03, 0.01), WHITE, sides=40)), (0, 0, front)),
        moved(lying(lathe(disc_profile(0.055, 0, 0.05, 0.02), DARK)), (0, 0, front + 0.05)),
        bar((0, 0, front + 0.055), (-0.14, 0.19, front + 0.055), 0.045, DARK),
        bar((0, 0, front + 0.06), (0.21, 0.3, front + 0.06), 0.042, DARK),
        bar((0, 0.5, 0), (0, 0.78, 0), 0.045, STEEL),
        cushion((0.2, 0.11, 0.13), role("feet"), (0, 0.76, 0), 5),
        moved(lying(torus(0.54, 0.06, role("clock", 0.8))), (0, 0, -front)),
        *both_sides(
            bar((0.2, -0.12, -front), (0.2, -0.12, -front - 0.09), 0.05, STEEL),
            cushion((0.21, 0.12, 0.07), GOLD, (0.2, -0.12, -front - 0.1), 4),
        ),
        cushion((0.12, 0.12, 0.1), GOLD, (0, 0.2, -front), 4),
    ]
    for i in range(12):
        long = 0.1 if i % 3 == 0 else 0.05
        tick = box((0.055 if i % 3 == 0 else 0.04, long, 0.02), DARK, (0, 0.43 - long / 2, front + 0.035))
        parts.append(turned(tick, 2, 2 * np.pi * i / 12))
    bell = [
        *(
            moved(p, (0, 0.65, 0))
            for p in (
                lathe(
                    [(0, 0.2), (0.11, 0.185), (0.21, 0.12), (0.26, 0.0), (0.28, -0.03), (0, -0.03)],
                    role("bells"),
                ),
                ellipsoid(0.055, role("bells", 0.75), (0, 0.21, 0)),
            )
        ),
        bar((0, 0.5, 0), (0, 0.65, 0), 0.06, STEEL),
    ]
    foot = [bar((0, -0.5, 0), (0, -0.7, 0), 0.075, role("feet")), ellipsoid(0.1, role("feet"), (0, -0.7, 0))]
    return [*parts, *both_sides(*(turned(p, 2, -lean) for p in bell), *(turned(p, 2, 0.6) for p in foot))]


def camera(rng: np.random.Generator) -> list[Part]:
    """A photo camera: a body with a broad middle, a finder on top, a big lens, a flash and a button."""
    w, h, d = rng.uniform(1.16, 1.28), rng.uniform(0.7, 0.78), rng.uniform(0.34, 0.4)
    big, front = rng.uniform(0.3, 0.335), d / 2
    return [
        cushion((w, h * 0.86, d), role("camera"), (0, -h * 0.07, 0), 9),
        cushion((w * 0.99, h * 0.26, d * 0.98), role("top"), (0, h * 0.4, 0), 8),
        frustum((0.5, d * 0.9), (0.36, d * 0.75), 0.2, role("top"), (0, h * 0.48, 0)),
        cushion((0.26, 0.13, 0.06), LAMP, (0, h * 0.48 + 0.08, front * 0.86), 6),
        cushion((0.24, 0.15, 0.05), GLASS, (0, h * 0.46, -front * 0.92), 6),
        cushion((0.66, 0.36, 0.05), GLASS, (0, -0.08, -front), 9),
        moved(
            lying(lathe(disc_profile(big + 0.06, 0, 0.1, 0.02), role("top"), sides=40)),
            (0, -0.04, front - 0.03),
        ),
        moved(lying(lathe(disc_profile(big, 0, 0.32, 0.03), role("lens"), sides=40)), (0, -0.04, front)),
        moved(lying(torus(big - 0.05, 0.06, role("lens", 0.7))), (0, -0.04, front + 0.32)),
        moved(
            lying(ellipsoid((big - 0.06, 0.07, big - 0.06), fixed(0.12, 0.2, 0.38))),
            (0, -0.04, front + 0.31),
        ),
        bead((0.07, 0.06, 0.03), fixed(0.75, 0.88, 1.0), (-0.09, 0.06, front + 0.365)),
        lathe(disc_profile(0.09, 0, 0.1, 0.03), RED, (-w * 0.33, h * 0.5, 0)),
        lathe(disc_profile(0.13, 0, 0.1, 0.03), role("lens"), (w * 0.33, h * 0.5, 0)),
        cushion((0.2, h * 0.62, 0.1), role("camera", 0.75), (-w * 0.39, -h * 0.07, front), 6),
        cushion((0.13, 0.13, 0.05), RED, (w * 0.37, h * 0.22, front), 6),
    ]


KINDS = (
    Kind(("alarm clock", "clock"), alarm_clock,
         {"clock": ("red", "blue"), "bells": ("yellow", "grey"), "feet": ("brown",)},
         {"bells": "{} bells", "feet": "{} feet"}),
    Kind(("camera", "photo camera"), camera,
         {"camera": ("black", "brown"), "lens": ("black",), "top": ("grey", "white")},
         {"lens": "a {} lens", "top": "a {} top"}),
)  # fmt: skip
