"""Horses: a horse and a zebra."""

from typing import NamedTuple

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.animals.anatomy import (
    four_hooves,
    four_legs,
    limbs_along,
    nearest_on,
    two_ears,
    two_eyes,
)
from export.everyday_objects.data.makers.animals.coats import (
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
    WHITE,
    Limb,
    Lump,
    Paint,
    Part,
    blend,
    both_sides,
    ellipsoid,
    role,
)


class _Mount(NamedTuple):
    """What horse and zebra share."""

    skin: Part
    """Body, neck and head, to be patched."""
    others: list[Part]
    """Mane, tail, hooves, face."""


def _mount(rng: np.random.Generator, coat: Paint, mane: Paint, hoof: Paint) -> _Mount:
    """A stocky horse: arched neck, long head, thick mane and tail."""
    fat, head, up = rng.uniform(0.94, 1.06), rng.uniform(0.95, 1.07), rng.uniform(-0.03, 0.05)
    x, back, front, y = 0.16 * fat, -0.29, 0.22, 0.63
    poll = np.array([0, 1.13 + up, 0.38])
    nose = poll + np.array([0, -0.2, 0.34]) * head
    skin = blend(
        [
            Limb((0, y, -0.24), (0, y, 0.18), 0.235 * fat, 0.235 * fat),
            *four_legs(x, back, front, 0.54, 0.12, 0.09),
            Limb((0, y + 0.1, 0.2), poll - (0, 0.06, 0.03), 0.2, 0.14),
            Limb(poll, nose, 0.175 * head, 0.125 * head),
            Lump(poll + (0, -0.09, 0.08), (0.13, 0.15, 0.15)),
            Lump(nose, (0.145 * head, 0.125 * head, 0.14 * head), 0.5),
        ],
        coat,
        cell=0.03,
    )
    crest = blend(
        [
            *limbs_along(
                [poll + (0, 0.17, 0.1), poll + (0, 0.14, -0.12), (0, 0.98, 0.14), (0, 0.8, -0.02)],
                [0.07, 0.095, 0.11, 0.07],
            ),
            Lump(poll + (0, 0.13, 0.13), (0.07, 0.07, 0.11), 0.8),
        ],
        mane,
        cell=0.03,
    )
    tail = blend(
        limbs_along(
            [(0, 0.74, -0.42), (0, 0.72, -0.58), (0, 0.46, -0.65), (0, 0.2, -0.62)], [0.065, 0.09, 0.11, 0.05]
        ),
        mane,
        cell=0.03,
    )
    others = [
        crest,
        tail,
        *four_hooves(x, back, front, 0.1, hoof),
        *two_ears(poll + (0.09, 0.1, -0.02), poll + (0.13, 0.34, -0.02), 0.07, coat, PINK),
        *two_eyes(skin, poll + (0.16 * head, 0.02, 0.12), 0.088, (0.85, 0.1, 0.6)),
        *both_sides(ellipsoid((0.025, 0.035, 0.03), DARK, nearest_on(skin, nose + (0.06, 0.02, 0.13)))),
    ]
    return _Mount(skin, others)


def horse(rng: np.random.Generator) -> list[Part]:
    """A stocky horse with a thick mane, a pale muzzle, often white socks."""
    mount = _mount(rng, role("coat"), role("mane"), role("hooves"))
    nose = mount.skin.vertices[mount.skin.vertices[:, 2].argmax()]
    patches = [(spot(nose + (0, 0, -0.02), (0.2, 0.16, 0.15)), role("muzzle"))]
    if rng.random() < 0.5:
        patches.append((below(0.24), WHITE))
    return [*patched(mount.skin, *patches), *mount.others]


def zebra(rng: np.random.Generator) -> list[Part]:
    """A zebra: bold stripes, a bristly mane, a dark muzzle."""
    mount = _mount(rng, role("coat"), role("stripes"), role("stripes"))
    nose = mount.skin.vertices[mount.skin.vertices[:, 2].argmax()]

    def phase(points: np.ndarray) -> np.ndarray:
        """Count stripes: upright on the body, across the neck, the rump and the legs."""
        y, z = points[:, 1], points[:, 2]
        hind, fore = np.clip((-0.25 - z) / 0.2, 0, 1), np.clip((z + 0.1) / 0.35, 0, 1)
        neck = 0.9 * (y - 0.62) + 0.4 * (z - 0.12)
        along = np.minimum(z, 0.12) + np.maximum(neck, fore * neck) - 0.8 * hind * (y - 0.6)
        return np.where(y < 0.42, y / 0.16, along / 0.19)

    def from_nose(points: np.ndarray) -> np.ndarray:
        """Distances."""
        return np.linalg.norm(points - nose, axis=1)

    eyes = spot((0.17, 1.17, 0.5), 0.12)
    dark = any_of(
        lambda p: 10 * from_nose(p) - 1.7,
        lambda p: 10 * np.abs(from_nose(p) - 0.27) - 0.3,
        all_of(lambda p: 10 * np.abs(from_nose(p) - 0.4) - 0.35, lambda p: -eyes(p)),
        all_of(stripes_along(phase, 0.46), lambda p: 10 * (0.52 - from_nose(p)), lambda p: -eyes(p)),
    )
    patches = [(dark, role("stripes"))]
    return [*patched(mount.skin, *patches), *mount.others]


KINDS = (
    Kind(("horse", "pony"), horse,
         {"coat": ("brown",), "mane": ("black",), "muzzle": ("beige",), "hooves": ("black",)},
         {"mane": "a {} mane", "hooves": "{} hooves"}, weight=1.5),
    Kind(("zebra",), zebra, {"coat": ("white",), "stripes": ("black",)}, {"stripes": "{} stripes"}),
)  # fmt: skip
