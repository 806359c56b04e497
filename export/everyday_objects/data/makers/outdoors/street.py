"""What stands in the street: a lamp, a fire hydrant, a mailbox, a well."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.outdoors.openings import arch, plate
from export.everyday_objects.data.makers.outdoors.placing import facing, ring_of
from export.everyday_objects.data.makers.outdoors.roofs import gable_block, gable_roof
from export.everyday_objects.data.shapes import (
    DARK,
    LEAF,
    STEEL,
    Part,
    bar,
    both_sides,
    box,
    ellipsoid,
    extrude,
    fixed,
    frustum,
    lathe,
    loft,
    moved,
    role,
    torus,
    turned,
)

_ROPE = fixed(0.8, 0.68, 0.46)
_WATER = fixed(0.16, 0.45, 0.72)


def street_lamp(rng: np.random.Generator) -> list[Part]:
    """An old lantern, large, with six panes on a stout turned post."""
    tall, wide, r = rng.uniform(0.56, 0.64), rng.uniform(0.25, 0.28), rng.uniform(0.066, 0.074)
    metal, accent = role("post"), role("post", 1.7)
    post = [
        (0, 0),
        (0.2, 0),
        (0.2, 0.06),
        (0.15, 0.09),
        (0.13, 0.2),
        (r * 1.5, 0.25),
        (r, 0.29),
        (r, tall - 0.12),
    ]
    post += [
        (r * 1.7, tall - 0.1),
        (r * 1.7, tall - 0.05),
        (r, tall - 0.02),
        (0.16, tall + 0.04),
        (0.16, tall + 0.07),
        (0, tall + 0.07),
    ]
    low, glass, top = 0.15, 0.36, tall + 0.42
    pane = bar((0, tall + 0.06, low + 0.015), (0, top, wide + 0.015), 0.026, metal, sides=8)
    roof = [
        (0, 0),
        (wide + 0.06, 0),
        (wide + 0.06, 0.035),
        (wide * 0.62, 0.12),
        (0.08, 0.2),
        (0.06, 0.24),
        (0, 0.24),
    ]
    return [
        lathe(post, metal, sides=24),
        lathe([(0, 0), (low, 0), (wide, glass), (0, glass)], role("light", 1.08), (0, tall + 0.06, 0), 6),
        *ring_of([pane], 6),
        lathe(roof, metal, (0, top - 0.02, 0), 6),
        ellipsoid(0.065, accent, (0, top + 0.25, 0)),
        torus(r * 1.3, 0.035, accent, (0, 0.29, 0)),
        torus(wide + 0.045, 0.025, accent, (0, top, 0)),
    ]


def fire_hydrant(rng: np.random.Generator) -> list[Part]:
    """A plump hydrant: flanged foot, ribbed barrel, dome with a nut, three capped outlets."""
    r, tall = rng.uniform(0.22, 0.25), rng.uniform(0.68, 0.76)
    body, dark, caps = role("body"), role("body", 0.8), role("caps")
    barrel = [(0, 0), (r + 0.11, 0), (r + 0.11, 0.08), (r + 0.02, 0.09), (r, 0.13), (r, tall), (0, tall)]
    dome = [(0, tall), (r + 0.06, tall), (r + 0.06, tall + 0.07)]
    dome += [(r * np.cos(a), tall + 0.07 + 0.22 * np.sin(a)) for a in np.linspace(0, 1.45, 9)] + [
        (0, tall + 0.29)
    ]
    parts = [
        lathe(barrel, body),
        lathe(dome, body),
        torus(r, 0.035, dark, (0, 0.22, 0)),
        *ring_of([ellipsoid((0.04, 0.035, 0.04), caps, (0, 0.085, r + 0.065))], 6, np.pi / 6),
        lathe([(0, 0), (0.075, 0), (0.075, 0.1), (0.05, 0.12), (0, 0.12)], caps, (0, tall + 0.27, 0), 6),
        *ring_of([bar((0, 0.27, r - 0.01), (0, tall - 0.04, r - 0.01), 0.035, body, sides=8)], 4, np.pi / 4),
    ]
    y = tall * 0.66
    for angle, size in ((0.0, 0.155), (np.pi / 2, 0.12), (-np.pi / 2, 0.12)):
        neck = [(0, 0), (size * 0.85, 0), (size * 0.85, r + 0.05), (0, r + 0.05)]
        lid = [(0, 0), (size, 0), (size * 1.04, 0.03), (size * 1.04, 0.06), (size * 0.8, 0.09), (0, 0.09)]
        nut = lathe([(0, 0), (0.05, 0), (0.05, 0.06), (0, 0.06)], caps, (0, r + 0.12, 0), 6)
        outlet = [lathe(neck, dark, sides=20), lathe(lid, caps, (0, r + 0.04, 0), 20), nut]
        parts += facing([turned(p, 0, np.pi / 2) for p in outlet], angle, (0, y, 0))
    return parts


def mailbox(rng: np.random.Generator) -> list[Part]:
    """A loaf-shaped letter box with a door, a flag at its side, on a stout wooden post."""
    width, high, depth = rng.uniform(0.42, 0.48), rng.uniform(0.44, 0.5), rng.uniform(0.72, 0.8)
    foot, front = rng.uniform(0.46, 0.54), depth / 2
    rim = plate(arch(width + 0.05, high + 0.03, floor=foot - 0.02), role("box", 0.8), 0.005, -0.065)
    lid = plate(arch(width - 0.07, high - 0.06, floor=foot + 0.03), role("box", 1.12), 0.025)
    x, y, z = width / 2 + 0.03, foot + high * 0.38, front * 0.25
    return [
        moved(extrude(arch(width, high), depth, role("box")), (0, foot, 0)),
        *ring_of([moved(p, (0, 0, front)) for p in (rim, lid)], 2),
        box((0.12, 0.05, 0.07), STEEL, (0, foot + high * 0.68, front + 0.04)),
        box((0.2, 0.05, 0.03), DARK, (0, foot + high * 0.4, front + 0.02)),
        box((0.15, foot, 0.15), role("post"), (0, foot / 2, 0)),
        box((0.3, 0.06, 0.5), role("post", 0.8), (0, foot - 0.03, 0)),
        lathe([(0, 0), (0.24, 0), (0.22, 0.04), (0.12, 0.09), (0, 0.1)], LEAF),
        bar((x - 0.05, y, z), (x + 0.035, y, z), 0.06, role("flag")),
        box((0.055, 0.42, 0.07), role("flag"), (x, y + 0.2, z)),
        box((0.055, 0.16, 0.22), role("flag"), (x, y + 0.33, z - 0.1)),
    ]


def well(rng: np.random.Generator) -> list[Part]:
    """A round wall of stones around water, two posts with a tiled roof, a windlass with a bucket."""
    r, rows, tall = rng.uniform(0.36, 0.4), 3, rng.uniform(0.82, 0.9)
    high, rise, count = rng.uniform(0.13, 0.14), rng.uniform(0.24, 0.3), 11
    parts = [
        lathe(
            [
                (0, 0),
                (r - 0.02, 0),
                (r - 0.02, rows * high),
                (r - 0.1, rows * high),
                (r - 0.1, 0.2),
                (0, 0.2),
            ],
            role("stones", 0.5),
        ),
        lathe([(0, 0), (r - 0.09, 0)], _WATER, (0, rows * high - 0.06, 0)),
    ]
    arc = 2 * np.pi * r / count
    for k in range(rows):
        for i in range(count):
            sections = [
                (y, 0, w * arc, 0.075 * w, 0)
                for y, w in ((0, 0.4), (0.02, 0.47), (high - 0.025, 0.47), (high - 0.005, 0.4))
            ]
            stone = loft(sections, role("stones", float(rng.choice([0.85, 1.0, 1.15]))), 5, 1, 16)
            parts.append(
                turned(moved(stone, (0, k * high, r - 0.01)), 1, (i + 0.5 * (k % 2)) * 2 * np.pi / count)
            )
    parts.append(
        lathe(
            [(r - 0.11, 0), (r + 0.05, 0), (r + 0.05, 0.06), (r - 0.11, 0.06), (r - 0.11, 0)],
            role("stones", 1.1),
            (0, rows * high - 0.005, 0),
        )
    )
    eaves = tall
    parts += [
        *both_sides(
            frustum(
                (0.11, 0.13),
                (0.1, 0.12),
                eaves + 0.1 - rows * high,
                role("wood"),
                (r - 0.035, rows * high, 0),
            )
        ),
        bar((-r - 0.08, eaves - 0.14, 0), (r + 0.08, eaves - 0.14, 0), 0.05, role("wood", 0.75)),
        bar((-0.1, eaves - 0.14, 0), (0.1, eaves - 0.14, 0), 0.075, _ROPE),
        bar((0, eaves - 0.16, 0.06), (0, eaves - 0.34, 0.06), 0.022, _ROPE, sides=8),
        lathe([(0, 0), (0.075, 0), (0.1, 0.15), (0, 0.15)], role("wood", 0.85), (0, eaves - 0.47, 0.06), 14),
        torus(0.092, 0.02, STEEL, (0, eaves - 0.38, 0.06)),
        *facing([gable_block(0.5, 0.02, rise, 2 * r - 0.06, role("wood"))], np.pi / 2, (0, eaves + 0.01, 0)),
        *facing(
            gable_roof(0.64, 2 * r + 0.16, rise * 1.25, (0, eaves - 0.03, 0), 0.07), np.pi / 2, (0, 0, 0)
        ),
    ]
    return parts


KINDS = (
    Kind(
        ("street lamp", "lamp post"),
        street_lamp,
        {"post": ("black",), "light": ("yellow",)},
        {"light": "a {} light"},
        front=False,
    ),
    Kind(
        ("fire hydrant", "hydrant"),
        fire_hydrant,
        {"body": ("red",), "caps": ("yellow", "white")},
        {"caps": "{} caps"},
    ),
    Kind(
        ("mailbox", "letter box"),
        mailbox,
        {"box": ("blue", "white"), "flag": ("red",), "post": ("brown",)},
        {"flag": "a {} flag", "post": "a {} post"},
    ),
    Kind(
        ("well", "wishing well"),
        well,
        {"stones": ("grey",), "roof": ("red", "brown"), "wood": ("brown",)},
        {"roof": "a {} roof"},
    ),
)
