"""Hands: a mechanical one and a human one."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.shapes import (
    Limb,
    Lump,
    Part,
    Vector,
    blend,
    cushion,
    ellipsoid,
    lathe,
    loft,
    moved,
    role,
    scaled,
    turned,
)


def robot_hand(rng: np.random.Generator) -> list[Part]:
    """A mechanical right hand on its wrist, the palm to the front: plated fingers on dark balls, spread."""
    wide, long, thick = rng.uniform(0.7, 0.76), rng.uniform(0.95, 1.08), rng.uniform(0.086, 0.094)
    joint = role("joints")

    def finger(at: Vector, lean: float, lengths: Sequence[float]) -> list[Part]:
        """Plates along a line that leans to +x, a ball before each."""
        parts, y = [], 0.0
        for i, length in enumerate(lengths):
            size = thick * (1 - 0.05 * i)
            last = i == len(lengths) - 1
            plate = [(0.02, 0.8), (0.05, 1.0), (length - 0.06, 0.95), (length - 0.02, 0.72 if last else 0.78)]
            plate += [(length + 0.015, 0.4)] * last
            sections = [(y + h, 0.0, size * r, size * r, 0.0) for h, r in plate]
            parts += [ellipsoid(size * 0.82, joint, (0, y, 0)), loft(sections, role("body"), 4.0, 1)]
            y += length
        return [moved(turned(p, 2, -lean), at) for p in parts]

    base, top = 0.3, 0.78
    palm = loft(
        [
            (base, 0, 0.2, 0.12, 0),
            (base + 0.04, 0, wide * 0.38, 0.14, 0),
            (base + 0.2, 0, wide * 0.5, 0.15, 0),
            (top - 0.05, 0, wide * 0.54, 0.14, 0),
            (top, 0, wide * 0.5, 0.1, 0),
        ],
        role("body"),
        4.0,
        1,
    )
    wrist = [(0, 0), (0.25, 0), (0.27, 0.03), (0.27, 0.13), (0.24, 0.16), (0, 0.17)]
    return [
        palm,
        lathe(wrist, role("body", 0.8)),
        lathe([(0.27, 0.05), (0.285, 0.06), (0.285, 0.1), (0.27, 0.11)], joint),
        lathe([(0.17, 0.12), (0.17, 0.34)], joint),
        cushion((wide * 0.66, 0.26, 0.06), joint, (0, base + 0.24, 0.14), 5),
        cushion((wide * 0.66, 0.3, 0.06), role("body", 0.7), (0, base + 0.24, -0.14), 5),
        *finger((-wide * 0.42, top - 0.02, 0), -0.24, (0.19 * long, 0.16 * long, 0.13 * long)),
        *finger((-wide * 0.145, top + 0.01, 0), -0.08, (0.23 * long, 0.19 * long, 0.16 * long)),
        *finger((wide * 0.145, top + 0.01, 0), 0.08, (0.23 * long, 0.19 * long, 0.16 * long)),
        *finger((wide * 0.42, top - 0.02, 0), 0.24, (0.21 * long, 0.17 * long, 0.14 * long)),
        *finger((wide * 0.46, base + 0.18, 0.02), 0.85, (0.22 * long, 0.19 * long)),
    ]


def hand(rng: np.random.Generator) -> list[Part]:
    """A right hand upright on its wrist, the palm to the front, fingers a little spread; a cuff."""
    long, thick, spread = rng.uniform(0.95, 1.06), rng.uniform(0.08, 0.088), rng.uniform(0.9, 1.1)
    fingers = [
        (-0.27, 0.72, -0.3, 0.32),
        (-0.095, 0.8, -0.1, 0.45),
        (0.09, 0.81, 0.08, 0.48),
        (0.265, 0.75, 0.28, 0.42),
    ]
    pieces: list[Limb | Lump] = [
        Limb((0, 0.2, 0), (0, 0.35, 0), 0.18, 0.18),
        Lump((0, 0.53, 0), (0.35, 0.28, 0.145)),
        Lump((0.2, 0.42, 0.05), (0.14, 0.18, 0.12)),
        Limb((-0.24, 0.45, 0), (-0.26, 0.66, 0), 0.11, 0.1),
        Limb((0.24, 0.5, 0), (0.26, 0.68, 0), 0.11, 0.1),
        Limb((0.2, 0.42, 0.03), (0.44, 0.54, 0.05), 0.12, 0.1),
        Limb((0.44, 0.54, 0.05), (0.57 + 0.03 * spread, 0.72, 0.05), 0.1, 0.085),
    ]
    nails = []
    for x, y, lean, length in fingers:
        root, way = (
            np.array((x, y - 0.05, 0.0)),
            np.array((np.sin(lean * spread), np.cos(lean * spread), 0.0)),
        )
        tip = root + way * length * long
        pieces += [
            Limb(root - way * 0.1, root + way * 0.5 * length, thick * 1.1, thick * 1.04),
            Limb(root + way * 0.5 * length, tip, thick * 1.04, thick * 0.9),
        ]
        nail = ellipsoid((0.05, 0.065, 0.025), role("skin", 1.12), (0, 0, -thick * 0.78))
        nails.append(moved(turned(nail, 2, -lean * spread), tip))
    cuff = [(0, 0), (0.23, 0), (0.25, 0.03), (0.25, 0.19), (0.23, 0.22), (0.16, 0.22)]
    return [
        blend(pieces, role("skin"), 0.045),
        *nails,
        scaled(lathe(cuff, role("sleeve")), (1, 1, 0.9)),
    ]


KINDS = (
    Kind(
        ("robot hand", "mechanical hand"),
        robot_hand,
        {"body": ("grey", "white"), "joints": ("black",)},
        {"joints": "{} joints"},
    ),
    Kind(
        ("hand", "human hand"),
        hand,
        {"skin": ("beige",), "sleeve": ("blue", "red")},
        {"sleeve": "a {} sleeve"},
    ),
)
