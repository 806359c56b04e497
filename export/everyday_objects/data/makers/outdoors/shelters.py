"""Shelters: a dog house and a tent."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.outdoors.openings import arched_opening, plate
from export.everyday_objects.data.makers.outdoors.palette import DARK_WOOD
from export.everyday_objects.data.makers.outdoors.placing import facing
from export.everyday_objects.data.makers.outdoors.roofs import gable_block, gable_roof
from export.everyday_objects.data.shapes import (
    DARK,
    WHITE,
    WOOD,
    Part,
    bar,
    both_sides,
    box,
    ellipsoid,
    extrude,
    frustum,
    moved,
    role,
)


def dog_house(rng: np.random.Generator) -> list[Part]:
    """A kennel of boards: gable roof, a round dark entrance with a pale arch, a bone above it."""
    width, depth, wall = rng.uniform(0.72, 0.8), rng.uniform(0.72, 0.82), rng.uniform(0.43, 0.48)
    rise = rng.uniform(0.31, 0.36)
    body, boards = gable_block(width, wall, rise, depth, role("walls")), []
    for k in range(3):
        y = 0.06 + k * wall / 3
        boards.append(box((width + 0.03, 0.03, depth + 0.03), role("walls", 0.75), (0, y + wall / 6, 0)))
    front = depth / 2
    parts = [
        body,
        *boards,
        box((width + 0.1, 0.07, depth + 0.12), WOOD, (0, 0.035, 0)),
        *gable_roof(
            width + 0.17, depth + 0.14, rise * (1 + 0.17 / width), (0, wall - 0.17 * rise / width, 0), 0.08
        ),
        *facing(arched_opening(0.44, 0.44, WHITE, DARK, edge=0.05), 0, (0, 0.06, front + 0.01)),
        *both_sides(
            box((0.06, wall, 0.06), WHITE, (width / 2 - 0.01, wall / 2, front - 0.01)),
            box((0.06, wall, 0.06), WHITE, (width / 2 - 0.01, wall / 2, 0.01 - front)),
        ),
    ]
    y, z = wall + 0.36 * rise, front + 0.03
    parts += [
        bar((-0.08, y, z), (0.08, y, z), 0.035, WHITE),
        *both_sides(*(ellipsoid((0.045, 0.045, 0.04), WHITE, (0.09, y + s * 0.035, z)) for s in (-1, 1))),
    ]
    return parts


def tent(rng: np.random.Generator) -> list[Part]:
    """A ridge tent: sagging canvas over a pole, open flaps in front of a dark inside, bands across, pegs."""
    width, depth, tall = rng.uniform(0.98, 1.08), rng.uniform(0.9, 1.0), rng.uniform(0.74, 0.82)
    half, sag = width / 2, rng.uniform(0.02, 0.035)
    slope = [(half * (1 - t) - sag * np.sin(np.pi * t), tall * t) for t in np.linspace(0, 1, 9)]
    solid = [*slope, *((-x, y) for x, y in slope[-2::-1])]
    outer = [(x + 0.022, y + 0.012) for x, y in slope]
    band = [*slope[:-1], (0, tall - 0.03), (0, tall + 0.035), *outer[-2::-1]]
    front = depth / 2
    parts = [
        extrude(solid, depth, role("canvas")),
        *(
            moved(p, (0, 0, z))
            for z in (0.05 - front, 0, front - 0.05)
            for p in both_sides(extrude(band, 0.13, role("trim")))
        ),
        bar((0, tall - 0.005, -front - 0.06), (0, tall - 0.005, front + 0.06), 0.045, DARK_WOOD, sides=10),
    ]
    opening = [(-0.7 * half, 0), (0.7 * half, 0), (0, tall * 0.9)]
    flap = [
        (0.48 * half, 0),
        (0.82 * half, 0),
        (0.03, tall * 0.91),
        (-0.01, tall * 0.86),
        (0.24 * half, 0.32),
        (0.4 * half, 0.16),
    ]
    parts += [
        plate(opening, DARK, front + 0.015),
        *both_sides(
            plate([(float(x), float(y)) for x, y in flap], role("canvas", 1.15), front + 0.07, front)
        ),
        *both_sides(
            *(
                frustum((0.11, 0.09), (0.05, 0.05), 0.1, DARK_WOOD, (half + 0.03, 0, z))
                for z in (-front + 0.04, front - 0.04)
            )
        ),
        box((width * 0.62, 0.035, 0.2), role("trim", 0.8), (0, 0.018, front + 0.09)),
    ]
    return parts


KINDS = (
    Kind(
        ("dog house", "kennel"),
        dog_house,
        {"walls": ("red", "brown"), "roof": ("blue", "grey")},
        {"roof": "a {} roof"},
    ),
    Kind(
        ("tent",), tent, {"canvas": ("orange", "green", "blue"), "trim": ("white",)}, {"trim": "{} stripes"}
    ),
)
