"""Animals of the savanna: a giraffe and an elephant."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.animals.anatomy import (
    CELL,
    four_hooves,
    four_legs,
    limbs_along,
    nearest_on,
    two_ears,
    two_eyes,
)
from export.everyday_objects.data.makers.animals.coats import all_of, any_of, below, mosaic, patched, spot
from export.everyday_objects.data.shapes import (
    DARK,
    PINK,
    WHITE,
    Limb,
    Lump,
    Part,
    bar,
    blend,
    both_sides,
    ellipsoid,
    moved,
    role,
    turned,
)


def giraffe(rng: np.random.Generator) -> list[Part]:
    """A giraffe: a long stout neck, brown patches on yellow, two horns."""
    fat, head, up = rng.uniform(0.94, 1.06), rng.uniform(0.95, 1.06), rng.uniform(-0.06, 0.05)
    x, back, front, y, z = 0.14, -0.23, 0.17, 1.4 + up, 0.36
    skin = blend(
        [
            Limb((0, 0.6, -0.2), (0, 0.64, 0.13), 0.2 * fat, 0.21 * fat),
            *four_legs(x, back, front, 0.5, 0.115, 0.09),
            Limb((0, 0.7, 0.13), (0, y - 0.05, z - 0.05), 0.2, 0.135),
            Lump((0, y, z), (0.18 * head, 0.17 * head, 0.19 * head)),
            Limb((0, y - 0.04, z + 0.12), (0, y - 0.08, z + 0.3 * head), 0.135, 0.12),
        ],
        role("coat"),
        cell=CELL,
    )
    crest = limbs_along([(0, y + 0.12, z - 0.14), (0, 1.1, 0.1), (0, 0.86, -0.02)], [0.06, 0.065, 0.05])
    mane = blend(crest, role("patches"), cell=CELL)
    bare = any_of(spot((0, y, z + 0.1), (0.3, 0.24, 0.38)), below(0.2), spot((0, 0.38, 0), (0.16, 0.12, 0.4)))
    patches = all_of(mosaic(skin, 0.19, 0.055), lambda p: -bare(p))
    tail = blend(
        limbs_along([(0, 0.7, -0.36), (0, 0.6, -0.5), (0, 0.42, -0.52)], [0.05, 0.05, 0.05]),
        role("coat"),
        cell=CELL,
    )
    return [
        *patched(
            skin,
            (spot((0, y - 0.1, z + 0.36), (0.2, 0.17, 0.15)), role("muzzle")),
            (patches, role("patches")),
        ),
        mane,
        tail,
        ellipsoid((0.08, 0.11, 0.08), role("patches"), (0, 0.36, -0.52)),
        *four_hooves(x, back, front, 0.105, role("patches", 0.75)),
        *both_sides(
            bar((0.08, y + 0.1, z - 0.03), (0.1, y + 0.29, z - 0.05), 0.05, role("coat")),
            ellipsoid(0.07, role("patches"), (0.1, y + 0.3, z - 0.05)),
            ellipsoid((0.02, 0.03, 0.025), DARK, nearest_on(skin, (0.06, y - 0.05, z + 0.45))),
        ),
        *two_ears((0.14, y + 0.06, z - 0.06), (0.36, y + 0.14, z - 0.08), 0.08, role("coat"), PINK),
        *two_eyes(skin, (0.14 * head, y + 0.04, z + 0.13 * head), 0.085, (0.75, 0.1, 0.65)),
    ]


def elephant(rng: np.random.Generator) -> list[Part]:
    """An elephant: pillar legs, great ears, a trunk, tusks."""
    fat, head, ear = rng.uniform(0.95, 1.06), rng.uniform(0.95, 1.05), rng.uniform(0.92, 1.08)
    x, back, front, y, z = 0.19, -0.28, 0.16, 0.84, 0.3
    nose = [
        (0, y - 0.04, z + 0.16),
        (0, y - 0.22, z + 0.29),
        (0, y - 0.48, z + 0.28),
        (0, y - 0.6, z + 0.4),
        (0, y - 0.46, z + 0.48),
    ]
    skin = blend(
        [
            Lump((0, 0.6, -0.1), (0.33 * fat, 0.31 * fat, 0.4)),
            *four_legs(x, back, front, 0.42, 0.15, 0.13),
            Lump((0, y, z), (0.28 * head, 0.28 * head, 0.25 * head)),
            *limbs_along(nose, [0.16, 0.125, 0.105, 0.095, 0.09], 12),
            *limbs_along([(0, 0.7, -0.46), (0, 0.6, -0.58), (0, 0.42, -0.58)], [0.05, 0.05, 0.05]),
        ],
        role("skin"),
        cell=0.031,
    )
    flap = []
    for scale, forward, paint in ((1.0, 0.0, role("skin", 0.92)), (0.74, 0.04, role("ears"))):
        leaf = ellipsoid((0.25 * scale * ear, 0.29 * scale * ear, 0.06), paint, (0.2 * ear, 0, forward))
        flap.append(moved(turned(leaf, 1, 0.45), (0.22, y + 0.02, z - 0.02)))
    nails = [
        ellipsoid((0.06, 0.06, 0.035), WHITE, (x + dx, 0.06, f + 0.125 - abs(dx) * 0.3))
        for f in (back, front)
        for dx in (-0.065, 0.065)
    ]
    tusk = blend(
        limbs_along(
            [(0.15, y - 0.16, z + 0.16), (0.18, y - 0.25, z + 0.29), (0.18, y - 0.22, z + 0.4)],
            [0.06, 0.058, 0.045],
        ),
        role("tusks"),
        cell=CELL,
    )
    return [
        skin,
        *both_sides(*flap, *nails, tusk),
        ellipsoid((0.07, 0.09, 0.07), DARK, (0, 0.38, -0.58)),
        *two_eyes(skin, (0.16 * head, y + 0.06, z + 0.23 * head), 0.085),
    ]


KINDS = (
    Kind(("giraffe",), giraffe, {"coat": ("yellow",), "patches": ("brown",), "muzzle": ("beige",)},
         {"patches": "{} patches"}),
    Kind(("elephant",), elephant, {"skin": ("grey",), "ears": ("pink",), "tusks": ("white",)},
         {"ears": "{} ears", "tusks": "{} tusks"}),
)  # fmt: skip
