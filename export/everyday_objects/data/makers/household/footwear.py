"""What people wear on their feet: a boot and a sneaker."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.household.pieces import bead, sweep
from export.everyday_objects.data.makers.household.plates import (
    lying,
    mirrored,
    pillow,
    smooth_loop,
    surface_at,
)
from export.everyday_objects.data.shapes import (
    DARK,
    Limb,
    Lump,
    Paint,
    Part,
    blend,
    both_sides,
    cushion,
    ellipsoid,
    lathe,
    moved,
    role,
    scaled,
    torus,
    turned,
)

_FOOT = mirrored(
    [
        (0, -0.48),
        (0.16, -0.44),
        (0.21, -0.28),
        (0.2, -0.05),
        (0.24, 0.2),
        (0.28, 0.4),
        (0.24, 0.58),
        (0.12, 0.68),
        (0, 0.7),
    ]
)


def _sole(low: float, high: float, paint: Paint, size: float = 1.0) -> Part:
    """A sole as a rounded plate between two heights."""
    outline = smooth_loop(_FOOT, 4) * size + (0, 0.11 * (1 - size))
    return moved(lying(pillow(outline, high - low, 0.04, paint)), (0, (low + high) / 2, 0))


def _laces(skin: Part, rows: Sequence[float], half: float, paint: Paint) -> list[Part]:
    """Laces across the instep of a shoe, at some z, following its skin."""
    parts = []
    for z in rows:
        x = np.linspace(-half, half, 7)
        y = surface_at(skin, np.stack([x, np.full(7, z)], -1), 1)
        parts.append(sweep(np.stack([x, y + 0.012, np.full(7, z)], -1), 0.042, paint, 8))
    return parts


def boot(rng: np.random.Generator) -> list[Part]:
    """An ankle boot, toe to +z: thick sole with a heel, laces up the front, a padded collar."""
    high, fat = rng.uniform(0.92, 1.0), rng.uniform(0.95, 1.05)
    skin = blend(
        [
            Limb((0, 0.27, -0.24), (0, 0.24, 0.3), 0.22 * fat, 0.2 * fat),
            Lump((0, 0.25, 0.42), (0.27 * fat, 0.21, 0.25)),
            Limb((0, 0.35, -0.22), (0, high - 0.26, -0.22), 0.23 * fat, 0.26 * fat),
            Limb((0, 0.45, -0.1), (0, 0.3, 0.2), 0.19, 0.2),
        ],
        role("boot"),
        0.1,
        0.03,
    )
    parts = [
        skin,
        _sole(0.03, 0.17, role("sole")),
        cushion((0.44, 0.2, 0.36), role("sole"), (0, 0.0, -0.27), 6),
        cushion((0.54, 0.2, 0.56), role("sole"), (0, 0.0, 0.38), 5),
        moved(scaled(torus(0.205 * fat, 0.068, role("boot", 0.7)), (1, 1, 1.08)), (0, high, -0.22)),
        lathe([(0, 0), (0.2, 0)], DARK, (0, high + 0.035, -0.22)),
        cushion((0.26, 0.26, 0.1), role("boot", 0.8), (0, high + 0.03, 0.03), 4),
        ellipsoid((0.13, 0.14, 0.06), role("boot", 0.7), (0, high + 0.03, -0.5)),
    ]
    for y in np.linspace(0.51, high - 0.12, 4):
        x = np.linspace(-0.17, 0.17, 7)
        z = surface_at(skin, np.stack([x, np.full(7, y)], -1))
        parts.append(sweep(np.stack([x, np.full(7, y), z + 0.015], -1), 0.042, role("laces"), 8))
    knot = float(surface_at(skin, np.array([[0, high - 0.1]]))[0]) + 0.05
    loop = turned(bead((0.13, 0.06, 0.045), role("laces"), (0.12, 0, 0)), 2, 0.25)
    parts += both_sides(moved(loop, (0, high - 0.1, knot)))
    return [scaled(p, (1.18, 1, 1)) for p in parts]


def shoe(rng: np.random.Generator) -> list[Part]:
    """A sneaker, toe to +z: white sole and toe cap, laces, a tongue, stripes on the sides."""
    ankle, fat = rng.uniform(0.5, 0.56), rng.uniform(0.95, 1.05)
    skin = blend(
        [
            Limb((0, 0.3, -0.26), (0, ankle, -0.3), 0.24 * fat, 0.2 * fat),
            Limb((0, 0.38, -0.1), (0, 0.26, 0.32), 0.24 * fat, 0.21 * fat),
            Lump((0, 0.24, 0.44), (0.27 * fat, 0.19, 0.26)),
        ],
        role("shoe"),
        0.1,
        0.03,
    )
    tongue = turned(cushion((0.27, 0.34, 0.11), role("shoe", 0.75), roundness=4), 0, -0.35)
    parts = [
        skin,
        _sole(0.0, 0.2, role("sole"), 1.03),
        _sole(0.075, 0.12, role("shoe", 0.8), 1.06),
        ellipsoid((0.3 * fat, 0.215, 0.25), role("sole"), (0, 0.2, 0.485)),
        moved(
            turned(scaled(torus(0.195 * fat, 0.066, role("shoe", 0.75)), (1, 1, 1.2)), 0, 0.1),
            (0, ankle + 0.17, -0.3),
        ),
        moved(scaled(lathe([(0, 0), (0.18, 0)], DARK), (1, 1, 1.2)), (0, ankle + 0.2, -0.3)),
        moved(tongue, (0, ankle + 0.17, -0.06)),
        *_laces(skin, (0.0, 0.1, 0.2), 0.15, role("laces")),
    ]
    loop = turned(bead((0.12, 0.05, 0.055), role("laces"), (0.11, 0, 0)), 2, 0.2)
    parts += both_sides(moved(loop, (0, ankle + 0.13, 0.03)))
    for z in (-0.2, -0.03):
        stripe = turned(cushion((0.1, 0.3, 0.09), role("laces"), roundness=5), 0, 0.35)
        parts += both_sides(moved(stripe, (0.2 * fat, 0.32, z)))
    return [scaled(p, (1.15, 1.08, 1)) for p in parts]


KINDS = (
    Kind(("boot",), boot, {"boot": ("brown",), "sole": ("black", "beige"), "laces": ("yellow", "white")},
         {"sole": "a {} sole", "laces": "{} laces"}, weight=1.1),
    Kind(("shoe", "sneaker"), shoe, {"shoe": ("red", "blue"), "sole": ("white",), "laces": ("white",)},
         {"sole": "a {} sole", "laces": "{} laces"}, weight=1.2),
)  # fmt: skip
