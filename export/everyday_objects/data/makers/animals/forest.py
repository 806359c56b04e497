"""Animals of the forest: a deer, a bear, a rabbit, a squirrel."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.animals.anatomy import (
    CELL,
    four_hooves,
    four_legs,
    limbs_along,
    nearest_on,
    paired,
    two_ears,
    two_eyes,
)
from export.everyday_objects.data.makers.animals.coats import any_of, patched, spot
from export.everyday_objects.data.shapes import (
    DARK,
    PINK,
    WHITE,
    Limb,
    Lump,
    Part,
    blend,
    both_sides,
    ellipsoid,
    role,
    scaled,
)


def deer(rng: np.random.Generator) -> list[Part]:
    """A stag: stout antlers, white spots on its back, white belly and rump."""
    fat, head, spread = rng.uniform(0.94, 1.06), rng.uniform(0.95, 1.06), rng.uniform(0.9, 1.1)
    x, back, front, y, z = 0.14, -0.25, 0.18, 0.98, 0.31
    skin = blend(
        [
            Limb((0, 0.54, -0.2), (0, 0.56, 0.14), 0.195 * fat, 0.205 * fat),
            *four_legs(x, back, front, 0.46, 0.11, 0.085),
            Limb((0, 0.62, 0.16), (0, y - 0.06, z - 0.03), 0.18, 0.15),
            Lump((0, y, z), (0.22 * head, 0.2 * head, 0.2 * head)),
            Limb((0, y - 0.03, z + 0.12), (0, y - 0.07, z + 0.3 * head), 0.14, 0.1),
            Limb((0, 0.64, -0.35), (0, 0.73, -0.46), 0.085, 0.06),
        ],
        role("coat", 1.15),
        cell=CELL,
    )
    white = any_of(
        spot((0, 0.56, -0.45), (0.17, 0.24, 0.16)),
        spot((0, 0.32, 0.0), (0.16, 0.16, 0.4)),
        spot((0, 0.56, 0.34), (0.12, 0.26, 0.14)),
        spot((0, y - 0.15, z + 0.3), (0.14, 0.09, 0.2)),
        *(spot((0.17, 0.66, place), 0.08) for place in (-0.16, 0.08)),
        *(spot((0.21, 0.52, place), 0.08) for place in (-0.24, -0.03)),
    )
    antlers = blend(
        paired(
            *limbs_along(
                [
                    (0.08, y + 0.12, z - 0.04),
                    (0.23 * spread, y + 0.32, z - 0.1),
                    (0.26 * spread, y + 0.52, z - 0.06),
                ],
                [0.07, 0.068, 0.055],
            ),
            Limb((0.19 * spread, y + 0.26, z - 0.08), (0.17 * spread, y + 0.38, z + 0.1), 0.06, 0.05),
            Limb((0.235 * spread, y + 0.38, z - 0.09), (0.4 * spread, y + 0.46, z - 0.1), 0.06, 0.05),
        ),
        role("antlers"),
        cell=CELL,
        softness=0.03,
    )
    return [
        *patched(skin, (white, WHITE)),
        antlers,
        *four_hooves(x, back, front, 0.098, role("hooves")),
        *two_ears((0.17, y + 0.06, z - 0.02), (0.42, y + 0.12, z - 0.02), 0.09, role("coat", 1.15), PINK),
        *two_eyes(skin, (0.13 * head, y + 0.04, z + 0.13 * head), 0.085, (0.7, 0.1, 0.7)),
        ellipsoid((0.07, 0.055, 0.05), DARK, (0, y - 0.03, z + 0.38 * head)),
    ]


def bear(rng: np.random.Generator) -> list[Part]:
    """A bear on four heavy legs: round ears, a pale muzzle."""
    fat, head = rng.uniform(0.95, 1.06), rng.uniform(0.95, 1.05)
    x, back, front, y, z = 0.18, -0.28, 0.2, 0.76, 0.36
    skin = blend(
        [
            Limb((0, 0.5, -0.22), (0, 0.52, 0.14), 0.27 * fat, 0.26 * fat),
            Lump((0, 0.66, 0.06), (0.2, 0.17, 0.2)),
            *four_legs(x, back, front, 0.4, 0.14, 0.115, 0.125),
            Lump((0, y, z), (0.28 * head, 0.255 * head, 0.24 * head)),
            *paired(Lump((0.21 * head, y + 0.22 * head, z - 0.02), (0.1, 0.1, 0.065))),
            Lump((0, y - 0.08, z + 0.2 * head), (0.16, 0.125, 0.17)),
            Lump((0, 0.58, -0.5), (0.09, 0.09, 0.08)),
        ],
        role("fur"),
        cell=CELL,
    )
    return [
        *patched(skin, (spot((0, y - 0.09, z + 0.32 * head), (0.19, 0.145, 0.2)), role("muzzle"))),
        *both_sides(ellipsoid((0.06, 0.06, 0.03), role("muzzle"), (0.21 * head, y + 0.22 * head, z + 0.04))),
        *two_eyes(skin, (0.125 * head, y + 0.09, z + 0.21 * head), 0.084),
        ellipsoid((0.075, 0.055, 0.055), DARK, nearest_on(skin, (0, y - 0.02, z + 0.45))),
    ]


def rabbit(rng: np.random.Generator) -> list[Part]:
    """A sitting bunny: long upright ears, white belly, a ball of a tail."""
    fat, head, long = rng.uniform(0.94, 1.06), rng.uniform(0.95, 1.06), rng.uniform(0.38, 0.48)
    y, z = 0.75, 0.12
    skin = blend(
        [
            Lump((0, 0.34, -0.06), (0.27 * fat, 0.32, 0.28 * fat)),
            *paired(
                Lump((0.22, 0.2, 0.02), (0.14, 0.2, 0.21)),
                Limb((0.2, 0.075, 0.0), (0.2, 0.07, 0.3), 0.085, 0.09),
                Limb((0.12, 0.42, 0.12), (0.09, 0.2, 0.24), 0.085, 0.075),
                Lump((0.1, y - 0.09, z + 0.14), (0.13, 0.1, 0.12)),
            ),
            Lump((0, y, z), (0.285 * head, 0.25 * head, 0.24 * head)),
        ],
        role("fur"),
        cell=CELL,
    )
    white = any_of(
        spot((0, 0.34, 0.22), (0.17, 0.2, 0.2)),
        spot((0, y - 0.11, z + 0.24), (0.15, 0.095, 0.16)),
        spot((0.2, 0.06, 0.36), (0.14, 0.14, 0.1)),
    )
    return [
        *patched(skin, (white, role("belly"))),
        ellipsoid(0.13, role("belly"), (0, 0.2, -0.36)),
        *two_ears(
            (0.09, y + 0.14, z - 0.05), (0.18, y + 0.2 + long, z - 0.08), 0.12, role("fur"), role("ears")
        ),
        *two_eyes(skin, (0.145 * head, y + 0.04, z + 0.21 * head), 0.09),
        ellipsoid((0.05, 0.038, 0.038), role("ears"), nearest_on(skin, (0, y - 0.03, z + 0.3))),
    ]


def squirrel(rng: np.random.Generator) -> list[Part]:
    """A sitting squirrel: a great curled tail behind it, tufted ears, an acorn in its paws."""
    fat, head, bushy = rng.uniform(0.94, 1.06), rng.uniform(0.95, 1.06), rng.uniform(0.93, 1.07)
    y, z = 0.76, 0.16
    skin = blend(
        [
            Lump((0, 0.34, 0), (0.23 * fat, 0.32, 0.22 * fat)),
            *paired(
                Lump((0.18, 0.2, 0.05), (0.12, 0.18, 0.17)),
                Limb((0.17, 0.07, 0.04), (0.17, 0.065, 0.3), 0.08, 0.085),
                Limb((0.18, 0.5, 0.08), (0.08, 0.42, 0.28), 0.075, 0.07),
                Lump((0.1, y - 0.08, z + 0.1), (0.13, 0.1, 0.12)),
            ),
            Lump((0, y, z), (0.24 * head, 0.21 * head, 0.21 * head)),
            Lump((0, y - 0.07, z + 0.17), (0.11, 0.09, 0.11)),
        ],
        role("fur", 1.25),
        cell=CELL,
    )
    spine = [
        (0, 0.14, -0.14),
        (0, 0.22, -0.42),
        (0, 0.58, -0.44),
        (0, 0.92, -0.36),
        (0, 1.12, -0.52),
        (0, 1.04, -0.74),
        (0, 0.86, -0.72),
    ]
    thick = bushy * np.array([0.09, 0.17, 0.19, 0.17, 0.16, 0.14, 0.11])
    brush = blend(limbs_along(spine, thick, 14), role("tail"), cell=CELL)
    tail = scaled(brush, (1.3, 1.0, 1.0))
    white = any_of(spot((0, 0.34, 0.2), (0.17, 0.25, 0.17)), spot((0, y - 0.11, z + 0.2), (0.15, 0.09, 0.16)))
    return [
        *patched(skin, (white, role("belly"))),
        *patched(tail, (spot((0, 0.88, -0.76), (0.26, 0.16, 0.17)), role("belly"))),
        *two_ears((0.12, y + 0.13, z - 0.04), (0.17, y + 0.36, z - 0.06), 0.085, role("fur", 1.25), PINK),
        *two_eyes(skin, (0.125 * head, y + 0.05, z + 0.19 * head), 0.08),
        ellipsoid((0.045, 0.035, 0.035), DARK, nearest_on(skin, (0, y - 0.03, z + 0.32))),
        ellipsoid((0.085, 0.1, 0.085), role("acorn"), (0, 0.41, 0.34)),
        ellipsoid((0.1, 0.06, 0.1), role("acorn", 0.55), (0, 0.48, 0.34)),
    ]


KINDS = (
    Kind(("deer", "stag"), deer, {"coat": ("brown",), "antlers": ("beige",), "hooves": ("black",)},
         {"antlers": "{} antlers", "hooves": "{} hooves"}, weight=1.2),
    Kind(("bear", "grizzly bear"), bear, {"fur": ("brown",), "muzzle": ("beige",)},
         {"muzzle": "a {} muzzle"}),
    Kind(("rabbit", "bunny"), rabbit, {"fur": ("grey",), "belly": ("white",), "ears": ("pink",)},
         {"belly": "a {} belly"}),
    Kind(("squirrel",), squirrel,
         {"fur": ("brown",), "belly": ("beige",), "tail": ("brown",), "acorn": ("orange",)},
         {"tail": "a {} tail"}),
)  # fmt: skip
