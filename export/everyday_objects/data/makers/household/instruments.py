"""Instruments: a guitar and a violin."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.household.palette import CREAM
from export.everyday_objects.data.makers.household.pieces import bead, sweep
from export.everyday_objects.data.makers.household.plates import lying, mirrored, pillow, smooth_loop
from export.everyday_objects.data.makers.household.turning import disc_profile, smooth_profile
from export.everyday_objects.data.shapes import (
    DARK,
    STEEL,
    WHITE,
    Part,
    bar,
    both_sides,
    box,
    curve,
    cushion,
    extrude,
    lathe,
    moved,
    role,
)


def guitar(rng: np.random.Generator) -> list[Part]:
    """An upright acoustic guitar: a stout body with a sound hole, a short broad neck, a head with pegs."""
    lower, waist, upper = rng.uniform(0.48, 0.53), rng.uniform(0.31, 0.35), rng.uniform(0.38, 0.42)
    half = [
        (0, 0),
        (lower * 0.6, 0.03),
        (lower, 0.25),
        (lower * 0.86, 0.43),
        (waist, 0.55),
        (upper * 0.94, 0.68),
        (upper * 0.9, 0.82),
        (upper * 0.5, 0.9),
        (0, 0.91),
    ]
    outline = smooth_loop(mirrored(half))
    centre = np.array([0, 0.44])
    front = (outline - centre) * 0.92 + centre
    hole = lying(lathe(disc_profile(0.145, 0, 0.05, 0.02), DARK))
    rosette = lying(lathe(disc_profile(0.195, 0, 0.03, 0.01), CREAM))
    top = 1.28
    pegbox = [(-0.1, top - 0.02), (0.1, top - 0.02), (0.18, top + 0.28), (0, top + 0.33), (-0.18, top + 0.28)]
    parts = [
        pillow(outline, 0.32, 0.05, role("body", 0.7)),
        moved(pillow(front, 0.06, 0.02, role("body")), (0, 0, 0.15)),
        moved(pillow(front, 0.06, 0.02, role("body", 0.9)), (0, 0, -0.15)),
        moved(rosette, (0, 0.57, 0.17)),
        moved(hole, (0, 0.57, 0.175)),
        cushion((0.36, 0.085, 0.07), role("neck", 0.8), (0, 0.24, 0.2), 8),
        cushion((0.24, 0.035, 0.05), CREAM, (0, 0.25, 0.23), 8),
        box((0.2, top - 0.68, 0.1), role("neck"), (0, (top + 0.68) / 2, 0.16)),
        cushion((0.18, top - 0.76, 0.18), role("body", 0.7), (0, (top + 0.84) / 2, 0.06), 8),
        moved(pillow(pegbox, 0.14, 0.02, role("body", 0.85)), (0, 0, 0.09)),
        box((0.22, 0.05, 0.13), CREAM, (0, top - 0.01, 0.165)),
    ]
    parts += [box((0.205, 0.03, 0.02), STEEL, (0, y, 0.212)) for y in np.linspace(0.8, top - 0.1, 4)]
    parts += [
        box((0.018, top - 0.25, 0.014), WHITE, (x, (top + 0.25) / 2, 0.235)) for x in (-0.06, 0.0, 0.06)
    ]
    for y in (0.06, 0.16, 0.26):
        parts += both_sides(bead((0.065, 0.048, 0.05), CREAM, (0.16 + 0.22 * y, top + y, 0.09)))
    return parts


def violin(rng: np.random.Generator) -> list[Part]:
    """An upright violin: a waisted body with f-holes, bridge, black fingerboard, scroll and pegs."""
    lower, waist, upper = rng.uniform(0.45, 0.49), rng.uniform(0.25, 0.28), rng.uniform(0.37, 0.41)
    half = [(0, 0), (lower * 0.55, 0.02), (lower * 0.96, 0.15), (lower, 0.28), (lower * 0.97, 0.38)]
    inner = [(waist + 0.06, 0.42), (waist, 0.5), (waist + 0.04, 0.59)]
    above = [(upper * 0.98, 0.63), (upper, 0.72), (upper * 0.85, 0.86), (upper * 0.4, 0.94), (0, 0.95)]
    outline = np.array(
        mirrored(smooth_profile(half, 16) + smooth_profile(inner, 8) + smooth_profile(above, 16))
    )
    centre = np.array([0, 0.46])
    belly = (outline - centre) * 0.86 + centre
    hole = curve(
        [
            (0.13, 0.32, 0),
            (0.17, 0.31, 0),
            (0.17, 0.38, 0),
            (0.15, 0.46, 0),
            (0.14, 0.54, 0),
            (0.18, 0.55, 0),
        ],
        16,
    )
    top = 1.28
    scroll = curve(
        [
            (0, top, 0.06),
            (0, top + 0.14, 0.07),
            (0, top + 0.22, 0.14),
            (0, top + 0.15, 0.21),
            (0, top + 0.1, 0.15),
        ],
        14,
    )
    return [
        pillow(outline, 0.24, 0.04, role("body", 0.62)),
        moved(pillow(belly, 0.1, 0.045, role("body", 0.9)), (0, 0, 0.11)),
        moved(pillow(belly, 0.1, 0.045, role("body", 0.8)), (0, 0, -0.11)),
        *both_sides(sweep(hole + (0.035, 0.02, 0.155), 0.032, DARK, 8)),
        moved(extrude([(-0.12, 0.36), (0.12, 0.36), (0.1, 0.45), (-0.1, 0.45)], 0.23, CREAM), (0, 0, 0.11)),
        moved(
            pillow([(-0.06, -0.02), (0.06, -0.02), (0.11, 0.3), (-0.11, 0.3)], 0.08, 0.02, role("board")),
            (0, 0, 0.2),
        ),
        moved(
            pillow([(-0.12, 0.54), (0.12, 0.54), (0.085, top), (-0.085, top)], 0.08, 0.02, role("board")),
            (0, 0, 0.19),
        ),
        cushion((0.16, 0.5, 0.16), role("body", 0.75), (0, 1.08, 0.07), 8),
        cushion((0.14, 0.26, 0.13), role("body", 0.85), (0, top + 0.06, 0.07), 8),
        sweep(scroll, 0.085, role("body", 0.85)),
        *both_sides(
            bar((0, top, 0.07), (0.2, top + 0.02, 0.07), 0.042, role("board")),
            bar((0, top + 0.12, 0.07), (0.2, top + 0.14, 0.07), 0.042, role("board")),
        ),
        *(box((0.018, top - 0.3, 0.014), WHITE, (x, (top + 0.3) / 2, 0.238)) for x in (-0.045, 0.045)),
        cushion((0.2, 0.13, 0.09), role("board"), (-0.2, 0.1, 0.18), 4),
    ]


KINDS = (
    Kind(("guitar",), guitar, {"body": ("orange",), "neck": ("brown", "black")},
         {"neck": "a {} neck"}, weight=1.3),
    Kind(("violin",), violin, {"body": ("orange",), "board": ("black",)}, {"board": "a {} fingerboard"}),
)  # fmt: skip
