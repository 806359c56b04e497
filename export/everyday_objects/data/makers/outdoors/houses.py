"""Houses: a cottage and a gothic church."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.outdoors.openings import arched_opening, door, window
from export.everyday_objects.data.makers.outdoors.palette import DARK_STONE, STONE
from export.everyday_objects.data.makers.outdoors.placing import facing, ring_of
from export.everyday_objects.data.makers.outdoors.roofs import gable_block, gable_roof
from export.everyday_objects.data.shapes import (
    GLASS,
    GOLD,
    LEAF,
    Part,
    both_sides,
    box,
    ellipsoid,
    extrude,
    frustum,
    lathe,
    moved,
    role,
    scaled,
    turned,
)


def house(rng: np.random.Generator) -> list[Part]:
    """A cottage: tiled gable roof with a chimney, a porch over its door, framed windows, often bushes."""
    wall, rise, arched = rng.uniform(0.43, 0.49), rng.uniform(0.34, 0.4), rng.random() < 0.5
    width, depth = rng.uniform(0.8, 0.88), rng.uniform(0.72, 0.82)
    frame, walls = role("windows"), role("walls")
    front, side = depth / 2, width / 2 - 0.145
    chimney = (width * 0.25, wall + rise * 0.78, -depth * 0.2)
    parts = [
        gable_block(width, wall, rise, depth, walls),
        *gable_roof(
            width + 0.13, depth + 0.13, rise * (1 + 0.13 / width), (0, wall - 0.13 * rise / width, 0)
        ),
        box((width + 0.06, 0.07, depth + 0.06), STONE, (0, 0.035, 0)),
        *facing(door(0.22, 0.35, role("door"), frame, arched), 0, (0, 0.03, front)),
        *gable_roof(0.4, 0.17, 0.13, (0, 0.39, front + 0.06), 0.05, 2),
        *both_sides(box((0.045, 0.4, 0.045), frame, (0.155, 0.21, front + 0.1))),
        box((0.15, 0.36, 0.15), STONE, chimney),
        box((0.2, 0.07, 0.2), DARK_STONE, (chimney[0], chimney[1] + 0.18, chimney[2])),
    ]
    for s in (-1, 1):
        parts += facing(window(0.18, 0.22, frame), 0, (s * (side + 0.015), 0.18, front))
        parts += facing(window(0.2, 0.22, frame), np.pi, (s * 0.2, 0.18, -front))
        for z in (-depth / 4, depth / 4):
            parts += facing(window(0.2, 0.22, frame), s * np.pi / 2, (s * width / 2, 0.16, z))
    disc = [(0, 0), (1, 0), (1, 1), (0, 1)]
    for angle in (0, np.pi):
        attic = [
            moved(turned(scaled(lathe(disc, p), (r, h, r)), 0, np.pi / 2), (0, 0, -0.02))
            for r, h, p in ((0.095, 0.045, frame), (0.065, 0.06, GLASS))
        ]
        parts += facing(attic, angle, (0, wall + rise * 0.38, front * np.cos(angle)))
    if rng.random() < 0.5:
        for s in (-1, 1):
            parts += [
                ellipsoid((0.1, 0.1, 0.09), LEAF, (s * (side + 0.02), 0.08, front + 0.08)),
                ellipsoid((0.08, 0.075, 0.075), LEAF, (s * (side + 0.13), 0.065, front + 0.05)),
            ]
    return parts


def gothic_house(rng: np.random.Generator) -> list[Part]:
    """A gothic church: steep nave and transept, buttresses, tall windows, a tower with a spire in front."""
    wall, rise, spire = rng.uniform(0.46, 0.5), rng.uniform(0.35, 0.39), rng.uniform(0.44, 0.5)
    width, tower, across = rng.uniform(0.46, 0.5), rng.uniform(0.35, 0.38), rng.uniform(0.84, 0.92)
    back, front, top = -0.5, 0.42, wall + rise + 0.02
    stone, pale, dark = role("stone"), role("stone", 1.25), role("stone", 0.76)
    glass, roof = role("windows"), role("roof")
    nave = [
        gable_block(width, wall, rise, 0.8, stone),
        *gable_roof(width + 0.1, 0.86, rise * (1 + 0.1 / width), (0, wall - 0.1 * rise / width, 0), 0.06),
        box((width + 0.07, 0.08, 0.84), dark, (0, 0.04, 0)),
    ]
    parts = [moved(p, (0, 0, back + 0.4)) for p in nave]
    arms = [
        gable_block(0.36, wall, rise * 0.8, across, stone),
        *gable_roof(0.46, across + 0.06, rise * 0.8 * 1.28, (0, wall - 0.28 * rise * 0.8, 0), 0.06),
        box((0.42, 0.08, across + 0.06), dark, (0, 0.04, 0)),
    ]
    parts += facing(arms, np.pi / 2, (0, 0, -0.16))
    for s in (-1, 1):
        parts += facing(
            arched_opening(0.22, wall * 0.98, pale, glass, True), s * np.pi / 2, (s * across / 2, 0.12, -0.16)
        )
        for z in (0.1, -0.42):
            parts += facing(
                arched_opening(0.13, wall * 0.68, pale, glass, True, 0.022),
                s * np.pi / 2,
                (s * width / 2, 0.1, z),
            )
        for x, z in ((across / 2, -0.16 + 0.15), (across / 2, -0.16 - 0.15), (width / 2, back + 0.04)):
            parts += facing([_buttress(wall)], s * np.pi / 2, (s * x, 0, z))
        parts += facing([_buttress(wall)], np.pi, (s * (width / 2 - 0.05), 0, back))
    parts += facing(arched_opening(0.2, wall * 0.98, pale, glass, True), np.pi, (0, 0.12, back))

    middle = front - tower / 2
    body = [
        box((tower, top, tower), stone, (0, top / 2, 0)),
        box((tower + 0.09, 0.1, tower + 0.09), dark, (0, 0.05, 0)),
        box((tower + 0.06, 0.05, tower + 0.06), pale, (0, wall + 0.05, 0)),
        box((tower + 0.08, 0.06, tower + 0.08), pale, (0, top, 0)),
        lathe(
            [(0, 0), (tower * 0.5, 0), (tower * 0.36, spire * 0.22), (0, spire)], roof, (0, top + 0.02, 0), 8
        ),
        ellipsoid(0.045, GOLD, (0, top + spire + 0.02, 0)),
        *ring_of(
            facing(arched_opening(0.17, rise - 0.08, pale, glass, True), 0, (0, wall + 0.07, tower / 2)), 4
        ),
    ]
    t = tower / 2
    corner = [
        box((0.09, wall + 0.06, 0.09), dark, (t, wall / 2 + 0.03, t)),
        box((0.1, 0.14, 0.1), stone, (t, top + 0.04, t)),
        frustum((0.13, 0.13), (0, 0), 0.18, roof, (t, top + 0.1, t)),
    ]
    parts += [moved(p, (0, 0, middle)) for p in (*body, *ring_of(corner, 4))]
    return [
        *parts,
        *facing(arched_opening(0.24, 0.34, pale, role("door"), True, 0.04), 0, (0, 0.03, front)),
        box((0.32, 0.07, 0.16), dark, (0, 0.035, front + 0.05)),
    ]


def _buttress(wall: float) -> Part:
    """A stepped pier against a wall at z = 0 that is `wall` high."""
    outline = [(0, 0), (0.11, 0), (0.11, wall * 0.55), (0.065, wall * 0.7), (0.065, wall * 0.85), (0, wall)]
    return extrude([(z - 0.01, y) for z, y in outline], 0.085, role("stone", 0.76), axis=0)


KINDS = (
    Kind(
        ("house", "cottage"),
        house,
        {
            "walls": ("beige", "yellow"),
            "roof": ("red", "brown"),
            "door": ("blue", "green"),
            "windows": ("white",),
        },
        {"roof": "a {} roof", "windows": "{} windows"},
        weight=1.5,
    ),
    Kind(
        ("gothic house", "gothic church", "church"),
        gothic_house,
        {"stone": ("grey",), "roof": ("black", "blue"), "windows": ("yellow", "blue"), "door": ("brown",)},
        {"roof": "a {} roof", "windows": "{} windows"},
    ),
)
