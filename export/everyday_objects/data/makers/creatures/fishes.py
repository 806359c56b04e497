"""Fishes: a goldfish and a piranha."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.creatures.parts import (
    MOUTH,
    big_eyes,
    patch,
    pillow,
    sideways,
    spike,
)
from export.everyday_objects.data.shapes import (
    WHITE,
    Limb,
    Lump,
    Part,
    blend,
    both_sides,
    curve,
    ellipsoid,
    loft,
    moved,
    role,
    scaled,
    torus,
    turned,
)


def fish(rng: np.random.Generator) -> list[Part]:
    """A plump goldfish: big eyes and lips, a tall forked tail, back, belly and side fins."""
    fat, tall, tail = rng.uniform(0.95, 1.1), rng.uniform(0.34, 0.39), rng.uniform(0.36, 0.44)
    shape = [
        (0.0, 0.0),
        (0.06, 0.3),
        (0.2, 0.62),
        (0.4, 0.92),
        (0.6, 1.0),
        (0.78, 0.86),
        (0.92, 0.6),
        (0.985, 0.3),
    ]
    spine = curve([(z, h, 0) for z, h in shape], 28)
    sections = [
        (1.1 * z - 0.55, 0.0, max(h, 0.02) * 0.27 * fat + 0.03, max(h, 0.02) * tall + 0.07, 0.0)
        for z, h, _ in spine
    ]
    fins = [
        sideways(
            pillow(
                [
                    (0.22, tall - 0.06),
                    (0.1, tall + 0.2),
                    (-0.14, tall + 0.22),
                    (-0.36, tall + 0.06),
                    (-0.3, tall * 0.6),
                ],
                0.14,
                role("fins"),
            )
        ),
        sideways(
            pillow(
                [(0.08, -tall + 0.05), (-0.08, -tall - 0.17), (-0.26, -tall - 0.16), (-0.24, -tall * 0.6)],
                0.13,
                role("fins"),
            )
        ),
    ]
    fin = sideways(pillow([(0.12, 0.07), (0.1, -0.1), (-0.16, -0.24), (-0.26, -0.08)], 0.11, role("fins")))
    side = moved(turned(fin, 1, -0.6), (0.3 * fat, -0.08, 0.04))
    lobes = [
        (0.08, 0.0),
        (-0.14, tail),
        (-0.5, tail * 1.2),
        (-0.34, 0.0),
        (-0.5, -tail * 1.2),
        (-0.14, -tail),
    ]
    veil = moved(turned(sideways(pillow(lobes, 0.12, role("fins"))), 1, -0.3), (0.02, 0, -0.5))
    lips = [
        scaled(turned(torus(0.055, 0.042, role("body", 0.75)), 0, np.pi / 2), (1.25, 1.0, 1.0)),
        ellipsoid((0.06, 0.045, 0.03), MOUTH),
    ]
    return [
        loft(sections, role("body")),
        *fins,
        *both_sides(side, veil),
        *(moved(p, (0, -0.05, 0.55)) for p in lips),
        *big_eyes((0.2 * fat, 0.1, 0.33), 0.1, (1.0, 0.1, 0.5)),
    ]


def piranha(rng: np.random.Generator) -> list[Part]:
    """A deep-bodied fish with a heavy open jaw, pointed teeth all round it and angry eyes."""
    fat, tall, gape = rng.uniform(0.95, 1.08), rng.uniform(0.4, 0.45), rng.uniform(0.0, 0.06)
    skin = blend(
        [
            Lump((0, 0.02, -0.08), (0.29 * fat, tall, 0.45)),
            Lump((0, 0.14, 0.28), (0.26 * fat, 0.21, 0.28), 0.25),
            Lump((0, -0.27 - gape, 0.33), (0.27 * fat, 0.13, 0.33), -0.18),
            Limb((0, 0, -0.4), (0, 0, -0.62), 0.2, 0.09),
        ],
        role("body"),
        0.07,
    )
    parts = patch(skin, [Lump((0, -0.45, 0.1), (0.5, 0.36, 0.75), -0.15)], role("belly"))
    parts.append(ellipsoid((0.22 * fat, 0.16, 0.26), MOUTH, (0, -0.09 - gape / 2, 0.26)))
    for turn in (-1.25, -0.75, -0.25, 0.25, 0.75, 1.25):
        x, z = 0.21 * fat * np.sin(turn), 0.28 + 0.28 * np.cos(turn)
        root = np.array((x, -0.2 - gape, z))
        parts.append(spike(root, root + (0, 0.16, 0.01), 0.06, WHITE))
    for turn in (-1.0, -0.5, 0.0, 0.5, 1.0):
        x, z = 0.2 * fat * np.sin(turn), 0.22 + 0.25 * np.cos(turn)
        root = np.array((x, 0.03, z))
        parts.append(spike(root, root + (0, -0.13, 0.0), 0.055, WHITE))
    brow = turned(ellipsoid((0.05, 0.045, 0.13), role("body", 0.6)), 0, 0.45)
    fins = [
        sideways(
            pillow(
                [(-0.5, 0.0), (-0.68, 0.36), (-0.9, 0.42), (-0.78, 0.0), (-0.9, -0.42), (-0.68, -0.36)],
                0.13,
                role("fins"),
            )
        ),
        sideways(
            pillow(
                [(0.1, tall - 0.08), (-0.08, tall + 0.22), (-0.32, tall + 0.16), (-0.4, tall * 0.5)],
                0.14,
                role("fins"),
            )
        ),
        sideways(
            pillow(
                [(-0.02, -tall + 0.1), (-0.16, -tall - 0.16), (-0.36, -tall - 0.1), (-0.36, -tall * 0.5)],
                0.13,
                role("fins"),
            )
        ),
    ]
    fin = sideways(pillow([(0.1, 0.08), (0.08, -0.08), (-0.14, -0.17), (-0.2, 0.02)], 0.1, role("fins")))
    return [
        *parts,
        *fins,
        *both_sides(
            moved(turned(fin, 1, -0.5), (0.31 * fat, -0.08, -0.12)), moved(brow, (0.215 * fat, 0.3, 0.3))
        ),
        *big_eyes((0.2 * fat, 0.2, 0.3), 0.1, (1.0, -0.05, 0.6)),
    ]


KINDS = (
    Kind(
        ("fish", "goldfish"),
        fish,
        {"body": ("orange",), "fins": ("yellow", "white")},
        {"fins": "{} fins"},
        weight=1.2,
    ),
    Kind(
        ("piranha",),
        piranha,
        {"body": ("green", "grey"), "belly": ("red", "orange"), "fins": ("red", "orange")},
        {"belly": "a {} belly", "fins": "{} fins"},
    ),
)
