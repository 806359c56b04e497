"""Dogs: a puppy, a German Shepherd, a fox."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.animals.anatomy import (
    CELL,
    four_legs,
    limbs_along,
    nearest_on,
    paired,
    two_ears,
    two_eyes,
)
from export.everyday_objects.data.makers.animals.coats import any_of, below, patched, spot
from export.everyday_objects.data.shapes import (
    DARK,
    Limb,
    Lump,
    Part,
    blend,
    both_sides,
    ellipsoid,
    moved,
    role,
    torus,
    turned,
)


def puppy(rng: np.random.Generator) -> list[Part]:
    """A puppy: big head, hanging ears, white muzzle and chest, a collar."""
    fat, head, ear = rng.uniform(0.93, 1.08), rng.uniform(0.94, 1.05), rng.uniform(0.17, 0.23)
    y, z = 0.84, 0.27
    skin = blend(
        [
            Limb((0, 0.42, -0.24), (0, 0.45, 0.16), 0.19 * fat, 0.2 * fat),
            *four_legs(0.145, -0.25, 0.19, 0.36, 0.11, 0.095, 0.11),
            Lump((0, y, z), (0.28 * head, 0.26 * head, 0.25 * head)),
            Lump((0, y - 0.1, z + 0.22 * head), (0.16, 0.125, 0.16)),
            *limbs_along([(0, 0.5, -0.38), (0, 0.66, -0.52), (0, 0.84, -0.5)], [0.075, 0.07, 0.055]),
        ],
        role("coat"),
        cell=CELL,
    )
    white = any_of(
        spot((0, y - 0.11, z + 0.28), (0.19, 0.16, 0.22)),
        spot((0, y + 0.15, z + 0.25), (0.06, 0.22, 0.2)),
        spot((0, 0.36, 0.3), (0.15, 0.2, 0.2)),
        spot((0, 0.84, -0.5), 0.13),
        below(0.12),
    )
    patches = [(white, role("white"))]
    if rng.random() < 0.5:
        patches.append((spot((0.05, 0.62, -0.16), (0.24, 0.16, 0.2)), role("ears")))
    flap = ellipsoid((0.075, ear, 0.125), role("ears"))
    flap = moved(turned(flap, 2, 0.32), (0.3 * head, y - 0.02, z - 0.03))
    return [
        *patched(skin, *patches),
        *both_sides(flap),
        *two_eyes(skin, (0.125 * head, y + 0.06, z + 0.24 * head), 0.09),
        ellipsoid((0.075, 0.055, 0.055), DARK, nearest_on(skin, (0, y - 0.03, z + 0.4))),
        turned(torus(0.17, 0.05, role("collar"), (0, 0.62, 0.2)), 0, 0.35, (0, 0.62, 0.2)),
    ]


def german_shepherd(rng: np.random.Generator) -> list[Part]:
    """A German Shepherd: erect ears, long dark muzzle, black saddle on tan, bushy hanging tail."""
    fat, head, up = rng.uniform(0.95, 1.07), rng.uniform(0.96, 1.05), rng.uniform(-0.03, 0.03)
    y, z = 0.92 + up, 0.3
    skin = blend(
        [
            Limb((0, 0.5, -0.28), (0, 0.54, 0.14), 0.19 * fat, 0.215 * fat),
            *four_legs(0.15, -0.3, 0.18, 0.42, 0.115, 0.095, 0.11),
            *paired(Lump((0.13, 0.4, -0.3), (0.11, 0.16, 0.14))),
            Limb((0, 0.6, 0.16), (0, y - 0.06, z - 0.06), 0.21, 0.2),
            Lump((0, y, z), (0.25 * head, 0.225 * head, 0.22 * head)),
            *paired(Limb((0.12, y - 0.04, z), (0.2, y - 0.16, z - 0.06), 0.14, 0.1)),
            Limb((0, y - 0.06, z + 0.1), (0, y - 0.11, z + 0.36 * head), 0.15, 0.105),
            *limbs_along([(0, 0.54, -0.42), (0, 0.46, -0.56), (0, 0.23, -0.59)], [0.09, 0.135, 0.09]),
        ],
        role("coat", 1.45),
        cell=CELL,
    )
    saddle = any_of(
        spot((0, 0.74, -0.16), (0.34, 0.24, 0.4)),
        spot((0, 0.82, 0.04), (0.2, 0.3, 0.18)),
        spot((0, 0.4, -0.64), (0.2, 0.4, 0.17)),
    )
    mask = spot((0, y - 0.1, z + 0.41), (0.17, 0.11, 0.2))
    cream = any_of(
        spot((0, 0.46, 0.34), (0.15, 0.26, 0.2)),
        below(0.13),
    )
    return [
        *patched(skin, (mask, role("saddle")), (cream, role("chest")), (saddle, role("saddle"))),
        *two_ears(
            (0.14, y + 0.11, z - 0.05),
            (0.2, y + 0.45, z - 0.05),
            0.135,
            role("coat", 1.45),
            role("saddle"),
            True,
        ),
        *two_eyes(skin, (0.135 * head, y + 0.075, z + 0.2 * head), 0.085),
        ellipsoid((0.07, 0.05, 0.05), DARK, (0, y - 0.065, z + 0.43 * head)),
    ]


def fox(rng: np.random.Generator) -> list[Part]:
    """A fox: pointed snout, big ears, white cheeks and chest, dark socks, bushy tail with a white tip."""
    fat, head, up = rng.uniform(0.94, 1.07), rng.uniform(0.95, 1.06), rng.uniform(-0.03, 0.04)
    y, z = 0.76 + up, 0.3
    skin = blend(
        [
            Limb((0, 0.42, -0.22), (0, 0.44, 0.16), 0.165 * fat, 0.175 * fat),
            *four_legs(0.13, -0.24, 0.18, 0.36, 0.095, 0.08, 0.085),
            Lump((0, y, z), (0.27 * head, 0.205 * head, 0.21 * head)),
            *paired(Limb((0.15, y - 0.06, z + 0.03), (0.3 * head, y - 0.1, z), 0.1, 0.05)),
            Limb((0, y - 0.05, z + 0.12), (0, y - 0.1, z + 0.34 * head), 0.14, 0.075),
        ],
        role("coat"),
        cell=CELL,
    )
    tail = blend(
        limbs_along(
            [(0, 0.46, -0.34), (0, 0.5, -0.58), (0, 0.74, -0.7), (0, 1.0, -0.62)],
            [0.07, 0.16, 0.19, 0.16, 0.11],
        ),
        role("coat"),
        cell=CELL,
    )
    white = any_of(
        spot((0.17, y - 0.14, z + 0.17), (0.17, 0.13, 0.3)),
        spot((0, 0.4, 0.3), (0.14, 0.2, 0.18)),
    )
    return [
        *patched(skin, (white, role("white")), (below(0.24), role("socks"))),
        *patched(tail, (spot((0, 1.02, -0.62), 0.23), role("white"))),
        *two_ears(
            (0.15, y + 0.12, z - 0.04), (0.22, y + 0.42, z - 0.04), 0.135, role("coat"), role("socks"), True
        ),
        *two_eyes(skin, (0.135 * head, y + 0.05, z + 0.2 * head), 0.085),
        ellipsoid((0.06, 0.05, 0.05), DARK, (0, y - 0.07, z + 0.4 * head)),
    ]


KINDS = (
    Kind(("dog", "puppy"), puppy,
         {"coat": ("brown",), "white": ("white",), "ears": ("black",), "collar": ("red",)},
         {"ears": "{} ears", "collar": "a {} collar"}, weight=1.4),
    Kind(("German Shepherd", "shepherd dog", "German Shepherd dog"), german_shepherd,
         {"coat": ("brown",), "saddle": ("black",), "chest": ("beige",)}, {"saddle": "a {} back"}),
    Kind(("fox",), fox, {"coat": ("orange",), "white": ("white",), "socks": ("black",)},
         {"socks": "{} paws"}),
)  # fmt: skip
