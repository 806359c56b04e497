"""Cats: a kitten, a tiger, a lion."""

from typing import NamedTuple

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.animals.anatomy import (
    CELL,
    Piece,
    four_legs,
    limbs_along,
    nearest_on,
    paired,
    two_ears,
    two_eyes,
)
from export.everyday_objects.data.makers.animals.coats import (
    Field,
    all_of,
    any_of,
    below,
    patched,
    spot,
    stripes_along,
)
from export.everyday_objects.data.shapes import (
    DARK,
    PINK,
    Limb,
    Lump,
    Paint,
    Part,
    blend,
    both_sides,
    ellipsoid,
    fixed,
    role,
)

_GREEN = fixed(0.45, 0.72, 0.2)


class _Feline(NamedTuple):
    """What cat, tiger and lion share."""

    skin: Part
    """Body, head and tail, to be patched."""
    face: list[Part]
    """Eyes and nose."""
    white: Field
    """Muzzle, chest and paws."""
    head: np.ndarray
    """(3,) its centre."""


def _feline(
    rng: np.random.Generator, coat: Paint, size: float, iris: Paint | None, tail: list[Piece]
) -> _Feline:
    """A cat with a round head and short muzzle, `size` 1 a kitten, more a heavier animal."""
    fat, head = rng.uniform(0.94, 1.07), rng.uniform(0.95, 1.05)
    y, z = 0.78, 0.28
    skin = blend(
        [
            Limb((0, 0.42, -0.24), (0, 0.43, 0.14), 0.16 * fat * size, 0.17 * fat * size),
            *four_legs(0.125 * size, -0.25, 0.17, 0.36, 0.09 * size, 0.08 * size, 0.09 * size),
            Lump((0, y, z), (0.28 * head, 0.235 * head, 0.22 * head)),
            *paired(
                Lump((0.17, y - 0.08, z + 0.05), (0.12, 0.1, 0.13)),
                Lump((0.055, y - 0.09, z + 0.2 * head), (0.085, 0.07, 0.08)),
            ),
            *tail,
        ],
        coat,
        cell=CELL,
    )
    white = any_of(
        spot((0, y - 0.11, z + 0.26), (0.17, 0.1, 0.2)),
        spot((0, 0.38, 0.28), (0.13 * size, 0.2, 0.18)),
        below(0.12),
    )
    face = [
        *two_eyes(skin, (0.13 * head, y + 0.035, z + 0.21 * head), 0.092, iris=iris),
        ellipsoid(
            (0.05, 0.035, 0.04), PINK if size == 1 else DARK, nearest_on(skin, (0, y - 0.035, z + 0.32))
        ),
    ]
    return _Feline(skin, face, white, np.array([0, y, z]))


def kitten(rng: np.random.Generator) -> list[Part]:
    """A kitten: pointed ears, green eyes, tail up, often tabby stripes."""
    bend = rng.uniform(-0.06, 0.06)
    tail = limbs_along(
        [(0, 0.48, -0.36), (0, 0.56, -0.54), (0, 0.8, -0.6), (0, 1.0, -0.5 + bend)], [0.07, 0.07, 0.07, 0.06]
    )
    cat = _feline(rng, role("coat"), 1.0, _GREEN, tail)
    patches = [(any_of(cat.white, spot((0, 1.02, -0.5), 0.15)), role("white"))]
    stripes = stripes_along(lambda p: p[:, 2] / 0.17, 0.45)
    crown = all_of(
        stripes_along(lambda p: p[:, 0] / 0.13, 0.45), spot(cat.head + (0, 0.24, 0.1), (0.2, 0.15, 0.2))
    )
    patches.append(
        (any_of(all_of(stripes, spot((0, 0.62, -0.2), (0.3, 0.2, 0.34))), crown), role("coat", 0.62))
    )
    return [
        *patched(cat.skin, *patches),
        *two_ears(
            cat.head + (0.16, 0.12, -0.03), cat.head + (0.23, 0.39, -0.03), 0.13, role("coat"), PINK, True
        ),
        *cat.face,
    ]


def tiger(rng: np.random.Generator) -> list[Part]:
    """A tiger: heavy orange cat, black stripes, round ears, white cheeks."""
    tail = limbs_along(
        [(0, 0.48, -0.38), (0, 0.52, -0.58), (0, 0.76, -0.64), (0, 0.92, -0.54)], [0.07, 0.07, 0.075, 0.075]
    )
    cat = _feline(rng, role("coat"), 1.2, None, tail)

    def phase(points: np.ndarray) -> np.ndarray:
        """Count stripes: upright on the body, across legs and tail."""
        y, z = points[:, 1], points[:, 2]
        return np.where((y < 0.32) | (z < -0.5), y / 0.15, z / 0.16)

    y, z = cat.head[1:]
    striped = any_of(spot((0, 0.6, -0.4), (0.6, 0.75, 0.56)), spot((0.2, 0.27, 0.16), (0.13, 0.2, 0.16)))
    body = all_of(stripes_along(phase, 0.4), striped)
    marks = any_of(
        spot((0, y + 0.24, z + 0.05), (0.045, 0.2, 0.16)),
        spot((0.13, y + 0.22, z + 0.06), (0.035, 0.08, 0.16)),
        spot((0.3, y + 0.02, z - 0.02), (0.09, 0.035, 0.2)),
        spot((0.3, y - 0.1, z - 0.04), (0.09, 0.035, 0.2)),
        spot((0, y + 0.09, z - 0.2), (0.16, 0.035, 0.12)),
        spot((0, y - 0.04, z - 0.2), (0.16, 0.035, 0.12)),
    )
    cheeks = any_of(cat.white, spot((0.17, y - 0.13, z + 0.16), (0.1, 0.1, 0.14)))
    return [
        *patched(cat.skin, (marks, role("stripes")), (cheeks, role("white")), (body, role("stripes"))),
        *both_sides(
            ellipsoid((0.1, 0.1, 0.06), role("coat"), (0.2, y + 0.19, z - 0.04)),
            ellipsoid((0.06, 0.06, 0.03), PINK, (0.2, y + 0.19, z + 0.01)),
        ),
        *cat.face,
    ]


def lion(rng: np.random.Generator) -> list[Part]:
    """A lion: a great mane about the face, a tuft at the tail's end."""
    tail = limbs_along([(0, 0.48, -0.38), (0, 0.5, -0.58), (0, 0.68, -0.66)], [0.065, 0.06, 0.055])
    cat = _feline(rng, role("coat"), 1.2, None, tail)
    size, count = rng.uniform(0.93, 1.05), int(rng.integers(9, 12))
    y, z = cat.head[1:]
    turn = 2 * np.pi * np.arange(count) / count
    mane = blend(
        [
            Lump((0, y - 0.02, z - 0.1), (0.34 * size, 0.34 * size, 0.2)),
            Lump((0, 0.5, 0.2), (0.21, 0.22, 0.17)),
            *(
                Lump(
                    (0.33 * size * np.sin(t), y - 0.02 + 0.32 * size * np.cos(t), z - 0.02),
                    (0.125, 0.125, 0.12),
                )
                for t in turn
            ),
        ],
        role("mane"),
        cell=CELL,
    )
    return [
        *patched(cat.skin, (cat.white, role("white"))),
        mane,
        ellipsoid((0.11, 0.14, 0.11), role("mane"), (0, 0.78, -0.66)),
        *both_sides(
            ellipsoid((0.095, 0.095, 0.06), role("coat"), (0.2, y + 0.21, z + 0.09)),
            ellipsoid((0.055, 0.055, 0.03), PINK, (0.2, y + 0.21, z + 0.14)),
        ),
        *cat.face,
    ]


KINDS = (
    Kind(("cat", "kitten"), kitten, {"coat": ("orange",), "white": ("white",)},
         {"white": "{} paws"}, weight=1.4),
    Kind(("tiger",), tiger, {"coat": ("orange",), "stripes": ("black",), "white": ("white",)},
         {"stripes": "{} stripes"}),
    Kind(("lion",), lion, {"coat": ("yellow",), "mane": ("brown",), "white": ("beige",)},
         {"mane": "a {} mane"}),
)  # fmt: skip
