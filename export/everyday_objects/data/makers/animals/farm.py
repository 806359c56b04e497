"""Animals of the farm: a pig, a cow, a sheep."""

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
from export.everyday_objects.data.makers.animals.coats import any_of, patched, spot
from export.everyday_objects.data.shapes import (
    DARK,
    PINK,
    Limb,
    Lump,
    Part,
    blend,
    both_sides,
    ellipsoid,
    fixed,
    lathe,
    moved,
    role,
    scaled,
    turned,
)

_IVORY = fixed(0.93, 0.87, 0.72)


def pig(rng: np.random.Generator) -> list[Part]:
    """A pig: a barrel with a big snout, hanging ears and a curly tail."""
    fat, head = rng.uniform(0.94, 1.06), rng.uniform(0.95, 1.06)
    x, back, front, y, z = 0.18, -0.25, 0.19, 0.6, 0.36
    skin = blend(
        [
            Lump((0, 0.47, -0.06), (0.32 * fat, 0.3 * fat, 0.42)),
            *four_legs(x, back, front, 0.32, 0.125, 0.105),
            Lump((0, y, z), (0.28 * head, 0.265 * head, 0.22 * head)),
            Limb((0, y - 0.06, z + 0.1), (0, y - 0.06, z + 0.22 * head), 0.15, 0.14),
        ],
        role("skin"),
        cell=CELL,
    )
    turn = np.linspace(0, 1, 12)
    coil = [(0.085 * np.sin(7.5 * t), 0.56 + 0.09 * (1 - np.cos(7.5 * t)), -0.44 - 0.2 * t) for t in turn]
    tail = blend(limbs_along(coil, [0.05, 0.045], 16), role("skin"), softness=0.02, cell=CELL)
    tip = z + 0.22 * head
    profile = [(0, 0), (0.15, 0), (0.165, 0.05), (0.155, 0.15), (0.13, 0.17), (0, 0.17)]
    disc = turned(lathe(profile, role("snout", 0.85)), 0, np.pi / 2)
    return [
        skin,
        tail,
        moved(scaled(disc, (1, 0.88, 1)), (0, y - 0.06, tip)),
        *four_hooves(x, back, front, 0.115, role("hooves")),
        *both_sides(ellipsoid((0.032, 0.05, 0.03), DARK, (0.06, y - 0.06, tip + 0.16))),
        *two_ears((0.16, y + 0.18, z), (0.29, y + 0.36, z + 0.1), 0.12, role("skin"), role("snout", 0.85)),
        *two_eyes(skin, (0.14 * head, y + 0.1, z + 0.19 * head), 0.082),
    ]


def cow(rng: np.random.Generator) -> list[Part]:
    """A cow: black patches on white, a broad pink muzzle, horns, an udder."""
    fat, head = rng.uniform(0.94, 1.06), rng.uniform(0.95, 1.05)
    x, back, front, y, z = 0.18, -0.3, 0.2, 0.86, 0.36
    skin = blend(
        [
            Limb((0, 0.58, -0.24), (0, 0.58, 0.14), 0.27 * fat, 0.26 * fat),
            *four_legs(x, back, front, 0.45, 0.125, 0.095),
            Lump((0, y, z), (0.24 * head, 0.24 * head, 0.2 * head)),
            Limb((0, y - 0.06, z + 0.08), (0, y - 0.16, z + 0.2), 0.17, 0.16),
            *limbs_along([(0, 0.74, -0.44), (0, 0.68, -0.6), (0, 0.44, -0.62)], [0.055, 0.05, 0.05]),
        ],
        role("coat"),
        cell=CELL,
    )
    shift = rng.uniform(-0.05, 0.05)
    dark = any_of(
        spot((0.24, 0.68, -0.26 + shift), (0.26, 0.2, 0.17), mirrored=False),
        spot((0.26, 0.5, 0.12 + shift), (0.15, 0.19, 0.12), mirrored=False),
        spot((-0.24, 0.64, 0.06 + shift), (0.26, 0.22, 0.16), mirrored=False),
        spot((-0.26, 0.46, -0.3 + shift), (0.2, 0.2, 0.14), mirrored=False),
        spot((-0.1, 0.78, -0.42 + shift), (0.14, 0.16, 0.16), mirrored=False),
        spot((0.2, y + 0.08, z + 0.1), (0.15, 0.2, 0.2)),
    )
    tip = [(0.13, y + 0.18, z - 0.02), (0.24, y + 0.24, z - 0.02), (0.27, y + 0.34, z)]
    horn = blend(limbs_along(tip, [0.065, 0.06, 0.04]), _IVORY, cell=CELL)
    return [
        *patched(skin, (dark, role("patches"))),
        ellipsoid((0.2 * head, 0.135, 0.13), role("muzzle"), (0, y - 0.17, z + 0.26)),
        ellipsoid((0.13, 0.1, 0.13), role("muzzle"), (0, 0.33, -0.14)),
        ellipsoid((0.075, 0.1, 0.075), role("patches"), (0, 0.38, -0.62)),
        *four_hooves(x, back, front, 0.11, role("hooves")),
        *both_sides(horn, ellipsoid((0.03, 0.035, 0.03), DARK, (0.085, y - 0.14, z + 0.375))),
        *two_ears((0.2, y + 0.1, z - 0.03), (0.43, y + 0.13, z - 0.02), 0.09, role("patches"), PINK),
        *two_eyes(skin, (0.13 * head, y + 0.07, z + 0.19 * head), 0.085),
    ]


def sheep(rng: np.random.Generator) -> list[Part]:
    """A sheep: a cloud of wool with a dark face, ears and legs."""
    fat, head = rng.uniform(0.94, 1.06), rng.uniform(0.95, 1.07)
    x, back, front, y, z = 0.16, -0.22, 0.16, 0.72, 0.4
    radii = np.array([0.3 * fat, 0.28 * fat, 0.38])
    count = 30
    k = np.arange(count) + 0.5
    height, turn = 1 - 2 * k / count, k * np.pi * (3 - 5**0.5)
    ring = np.sqrt(1 - height**2)
    bumps = np.stack([ring * np.sin(turn), height, ring * np.cos(turn)], 1) * radii + (0, 0.54, -0.04)
    wool = blend(
        [
            Lump((0, 0.54, -0.04), radii),
            *(Lump(b, (0.125, 0.125, 0.125)) for b in bumps),
            *(
                Lump((dx, y + 0.17, z - 0.04 + dz), (0.1, 0.095, 0.1))
                for dx, dz in ((-0.1, 0), (0.1, 0), (0, 0.07), (0, -0.06))
            ),
            Lump((0, 0.6, -0.46), (0.09, 0.1, 0.09)),
        ],
        role("wool"),
        softness=0.03,
        cell=CELL,
    )
    dark = blend(
        [
            Limb((0, y + 0.05, z), (0, y - 0.07, z + 0.17 * head), 0.185 * head, 0.145 * head),
            *four_legs(x, back, front, 0.4, 0.095, 0.09),
        ],
        role("face"),
        cell=CELL,
    )
    return [
        wool,
        dark,
        *two_ears((0.14, y + 0.06, z + 0.06), (0.4, y - 0.02, z + 0.06), 0.09, role("face"), PINK),
        *two_eyes(dark, (0.11 * head, y + 0.06, z + 0.15 * head), 0.085),
        *both_sides(ellipsoid((0.022, 0.026, 0.02), PINK, nearest_on(dark, (0.045, y - 0.04, z + 0.34)))),
    ]


KINDS = (
    Kind(("pig", "piglet"), pig, {"skin": ("pink",), "snout": ("pink",), "hooves": ("brown",)},
         {"snout": "a {} snout", "hooves": "{} hooves"}),
    Kind(("cow",), cow,
         {"coat": ("white",), "patches": ("black",), "muzzle": ("pink",), "hooves": ("black",)},
         {"patches": "{} patches", "muzzle": "a {} muzzle"}),
    Kind(("sheep", "lamb"), sheep, {"wool": ("white",), "face": ("black",)}, {"face": "a {} face"}),
)  # fmt: skip
