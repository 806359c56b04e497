"""Castles: of stone and of sand."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.outdoors.openings import arch, arched_opening, plate
from export.everyday_objects.data.makers.outdoors.palette import DARK_WOOD
from export.everyday_objects.data.makers.outdoors.placing import facing, ring_of
from export.everyday_objects.data.shapes import (
    DARK,
    GOLD,
    WHITE,
    Paint,
    Part,
    Vector,
    bar,
    box,
    ellipsoid,
    extrude,
    fixed,
    frustum,
    lathe,
    moved,
    role,
    torus,
)


def _battlements(radius: float, height: float, count: int, paint: Paint, size: float) -> list[Part]:
    """Merlons around a round tower's top at y = `height`."""
    merlon = box((size, size * 1.1, size * 0.75), paint, (0, height + size * 0.4, radius - size * 0.375))
    return ring_of([merlon], count)


def _flag(at: Vector, paint: Paint, height: float = 0.22, size: float = 0.15) -> list[Part]:
    """A pennant on a pole, flying to +x."""
    pennant = extrude([(0, 0), (size * 1.3, -size * 0.5), (0, -size)], 0.05, paint)
    pole = bar((0, -0.04, 0), (0, height, 0), 0.025, DARK_WOOD, sides=8)
    return [
        moved(p, at)
        for p in (pole, moved(pennant, (0.015, height - 0.005, 0)), ellipsoid(0.035, GOLD, (0, height, 0)))
    ]


def castle(rng: np.random.Generator) -> list[Part]:
    """Four round towers with cones or battlements, walls between them, a gatehouse and a roofed keep."""
    half, r, tall = rng.uniform(0.33, 0.36), rng.uniform(0.135, 0.155), rng.uniform(0.56, 0.66)
    wall, keep, cones = rng.uniform(0.34, 0.38), rng.uniform(0.72, 0.78), rng.random() < 0.6
    stone, pale, dark = role("stone"), role("stone", 1.28), role("stone", 0.74)
    tall += 0 if cones else 0.08
    parts = [box((2 * half, 0.1, 2 * half), dark, (0, 0.05, 0))]
    slit = [plate(arch(0.07, 0.15), DARK, 0.02, -0.04)]
    for angle in (np.pi / 4, -np.pi / 4, 3 * np.pi / 4, -3 * np.pi / 4):
        at = (np.sqrt(2) * half * np.sin(angle), 0.0, np.sqrt(2) * half * np.cos(angle))
        tower = [
            lathe(
                [(0, 0), (1.22 * r, 0), (1.22 * r, 0.07), (r, 0.12), (r, tall - 0.1), (0, tall - 0.1)], stone
            ),
            lathe(
                [(0, tall - 0.15), (r, tall - 0.15), (1.2 * r, tall - 0.09), (1.2 * r, tall), (0, tall)], pale
            ),
            *facing(slit, 0, (0, tall * 0.5, r)),
        ]
        if cones:
            tower += [
                lathe(
                    [(0, tall - 0.01), (1.42 * r, tall - 0.01), (0.55 * r, tall + 0.2), (0, tall + 0.34)],
                    role("roofs"),
                ),
                ellipsoid(0.035, GOLD, (0, tall + 0.34, 0)),
            ]
        else:
            tower += _battlements(1.2 * r, tall, 6, pale, 0.095)
        parts += facing(tower, angle, at)
    for angle in (0, np.pi / 2, np.pi, -np.pi / 2):
        side = [
            box((2 * half, wall, 0.14), stone, (0, wall / 2, 0)),
            box((2 * half, 0.05, 0.17), pale, (0, wall, 0)),
        ]
        side += [box((0.09, 0.1, 0.08), pale, (x, wall + 0.06, 0.04)) for x in (-0.16, 0, 0.16)]
        side += [plate(arch(0.09, 0.17, floor=0.12), DARK, 0.09, 0.05)]
        parts += facing(side, angle, (half * np.sin(angle), 0, half * np.cos(angle)))
    front = half + 0.13
    parts += [
        box((0.34, wall + 0.1, 0.2), stone, (0, wall / 2 + 0.05, front - 0.1)),
        box((0.38, 0.06, 0.24), pale, (0, wall + 0.1, front - 0.1)),
        *(box((0.09, 0.09, 0.22), pale, (x, wall + 0.16, front - 0.1)) for x in (-0.145, 0, 0.145)),
        *facing(arched_opening(0.26, 0.32, dark, role("gate"), edge=0.035), 0, (0, 0, front)),
        *(box((0.025, 0.24, 0.03), DARK_WOOD, (x, 0.12, front + 0.04)) for x in (-0.05, 0, 0.05)),
        box((0.24, 0.03, 0.14), role("gate"), (0, 0.015, front + 0.08)),
        box((0.34, keep, 0.34), stone, (0, keep / 2, -0.04)),
        box((0.4, 0.06, 0.4), pale, (0, keep, -0.04)),
    ]
    for angle in (0, np.pi / 2, np.pi, -np.pi / 2):
        at = (0.17 * np.sin(angle), keep - 0.26, 0.17 * np.cos(angle) - 0.04)
        parts += facing([plate(arch(0.1, 0.18), DARK, 0.02, -0.04)], angle, at)
    parts += [
        frustum((0.46, 0.46), (0, 0), 0.36, role("roofs"), (0, keep + 0.02, -0.04)),
        ellipsoid(0.04, GOLD, (0, keep + 0.37, -0.04)),
    ]
    return parts


def sandcastle(rng: np.random.Generator) -> list[Part]:
    """A castle of sand on a mound: bucket-shaped towers with notched rims, low walls, flags, shells."""
    half, big, small = rng.uniform(0.34, 0.38), rng.uniform(0.21, 0.24), rng.uniform(0.14, 0.16)
    tall, high = rng.uniform(0.38, 0.44), rng.uniform(0.66, 0.74)
    sand, dark, hole = role("sand"), role("sand", 0.86), role("sand", 0.5)

    def bucket(r: float, h: float) -> list[Part]:
        """A tower out of a bucket, notched."""
        wide = [
            (0, 0),
            (1.12 * r, 0),
            (0.84 * r, h - 0.12),
            (0.94 * r, h - 0.11),
            (0.92 * r, h - 0.02),
            (0.86 * r, h),
            (0, h),
        ]
        merlon = frustum((0.1, 0.07), (0.08, 0.055), 0.09, sand, (0, h - 0.01, 0.86 * r - 0.035))
        return [
            lathe(wide, sand),
            torus(0.9 * r, 0.025, dark, (0, h - 0.12, 0)),
            *ring_of([merlon], 6 if r < 0.18 else 8),
        ]

    mound = [(0, 0), (0.64, 0), (0.63, 0.05), (0.58, 0.09), (0.5, 0.12), (0, 0.12)]
    parts = [lathe(mound, dark, sides=40)]
    for x in (-half, half):
        for z in (-half, half):
            parts += facing(bucket(small, tall), 0, (x, 0.08, z))
            parts += facing(
                [plate(arch(0.08, 0.12), hole, 0.03, -0.05)],
                np.arctan2(x, z),
                (
                    x + 0.92 * small * np.sin(np.arctan2(x, z)),
                    0.22,
                    z + 0.92 * small * np.cos(np.arctan2(x, z)),
                ),
            )
    for angle in (0, np.pi / 2, np.pi, -np.pi / 2):
        wall = [
            frustum((2 * half, 0.17), (2 * half, 0.11), 0.2, sand, (0, 0.1, 0)),
            *(frustum((0.1, 0.1), (0.08, 0.08), 0.08, sand, (x, 0.29, 0)) for x in (-0.12, 0.12)),
        ]
        parts += facing(wall, angle, (half * np.sin(angle), 0, half * np.cos(angle)))
    parts += facing(bucket(big, high - 0.08), 0, (0, 0.08, 0))
    parts += [
        *facing(
            [plate(arch(0.2, 0.24), dark, 0.035), plate(arch(0.14, 0.2), hole, 0.055)],
            0,
            (0, 0.1, half + 0.05),
        ),
        *ring_of([plate(arch(0.09, 0.15, floor=0.42), hole, 0.98 * big, 0.3 * big)], 4),
        *_flag((0, high, 0), role("flags"), 0.24, 0.17),
        *_flag((-half, tall + 0.08, half), role("flags"), 0.2, 0.14),
        *_flag((half, tall + 0.08, -half), role("flags"), 0.2, 0.14),
        ellipsoid((0.06, 0.035, 0.05), fixed(0.96, 0.7, 0.66), (0.27, 0.11, half + 0.15)),
        ellipsoid((0.05, 0.035, 0.05), WHITE, (-0.26, 0.11, half + 0.17)),
    ]
    return parts


KINDS = (
    Kind(
        ("castle", "fortress"),
        castle,
        {"stone": ("grey",), "roofs": ("red", "blue"), "gate": ("brown",)},
        {"roofs": "{} roofs"},
        weight=1.3,
    ),
    Kind(
        ("sandcastle", "sand castle"),
        sandcastle,
        {"sand": ("beige",), "flags": ("red", "blue")},
        {"flags": "{} flags"},
    ),
)
