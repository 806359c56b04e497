"""Trees: one of leaves, a palm, a pine."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.outdoors.foliage import folded_leaf
from export.everyday_objects.data.makers.outdoors.palette import DARK_WOOD
from export.everyday_objects.data.makers.outdoors.placing import ring_of
from export.everyday_objects.data.shapes import (
    GOLD,
    Limb,
    Lump,
    Paint,
    Part,
    Vector,
    blend,
    curve,
    ellipsoid,
    extrude,
    fixed,
    grid_faces,
    lathe,
    moved,
    role,
    turned,
)


def tree(rng: np.random.Generator) -> list[Part]:
    """A round crown of leafy lumps on a stout trunk that flares into roots."""
    big, tall = rng.uniform(0.36, 0.4), rng.uniform(0.4, 0.48)
    middle = tall + 0.34
    lumps = [Lump((0, middle, 0), (big, big * 0.9, big))]
    phase = rng.uniform(0, 0.3)
    for count, height, out, size in ((6, -0.1, 0.34, 0.2), (5, 0.18, 0.25, 0.2)):
        for k in range(count):
            a = phase + 2 * np.pi * (k + rng.uniform(-0.12, 0.12)) / count + height * 5
            r = size * rng.uniform(0.9, 1.12)
            lumps.append(
                Lump(
                    (out * np.sin(a), middle + height + rng.uniform(-0.03, 0.03), out * np.cos(a)),
                    (r, r * 0.9, r),
                )
            )
    lumps.append(Lump((0, middle + 0.32, 0), (0.19, 0.17, 0.19)))
    crown = blend(lumps, role("crown"), 0.05, 0.032)
    roots = [
        Limb((0, 0.08, 0), (0.17 * np.sin(a), 0.02, 0.17 * np.cos(a)), 0.08, 0.04)
        for a in phase + np.arange(5) * 2 * np.pi / 5
    ]
    branches = [Limb((0, tall * 0.6, 0), (s * 0.2, tall + 0.1, 0), 0.07, 0.05) for s in (-1, 1)]
    trunk = blend(
        [Limb((0, 0.03, 0), (0, tall + 0.15, 0), 0.125, 0.095), *roots, *branches], role("trunk"), 0.08, 0.03
    )
    return [crown, trunk]


def palm_tree(rng: np.random.Generator) -> list[Part]:
    """A stout trunk of rings, a crown of broad arching fronds, coconuts, a small hill of sand."""
    tall, reach, droop = rng.uniform(0.7, 0.78), rng.uniform(0.5, 0.56), rng.uniform(0.1, 0.17)
    parts = [lathe([(0, 0), (0.31, 0), (0.28, 0.05), (0.17, 0.1), (0, 0.11)], fixed(0.9, 0.8, 0.56))]
    step = tall / 7
    for k in range(7):
        r = 0.12 - 0.006 * k
        ring = [(0, 0), (0.8 * r, 0), (r, step * 0.9), (0.9 * r, step * 1.05), (0, step * 1.05)]
        parts.append(lathe(ring, role("trunk", 0.95 if k % 2 else 1.3), (0, k * step + 0.05, 0), 20))
    u = np.linspace(0, 1, 16)
    path = curve(
        [(0, 0, 0.02), (0, 0.15, reach * 0.38), (0, 0.12, reach * 0.75), (0, 0.0 - droop, reach * 1.08)], 16
    )
    widths = 0.16 * np.sin(np.pi * (0.13 + 0.85 * u)) ** 0.65 * np.where(np.arange(16) % 3 == 2, 0.66, 1.05)
    short = curve(
        [(0, 0.04, 0), (0, 0.26, reach * 0.25), (0, 0.3, reach * 0.55), (0, 0.17, reach * 0.82)], 16
    )
    crown = [
        *ring_of([folded_leaf(path, widths, role("leaves", 0.9), fold=-0.35)], 7, 0.2),
        *ring_of([folded_leaf(short, widths * 0.85, role("leaves", 1.15), fold=-0.35)], 5, 0.5),
        *ring_of([ellipsoid(0.08, DARK_WOOD, (0, -0.05, 0.115))], 3, 0.6),
    ]
    return parts + [moved(p, (0, tall + 0.05, 0)) for p in crown]


def _bead(radius: float, paint: Paint, at: Vector) -> Part:
    """A small ball of few faces."""
    t = np.linspace(0, np.pi, 8)
    return lathe([(radius * np.sin(a), radius * np.cos(a)) for a in t], paint, at, 12)


def pine_tree(rng: np.random.Generator) -> list[Part]:
    """Three tiers of scalloped, drooping branches on a short trunk; often with baubles and a star."""
    wide, festive, y = rng.uniform(0.46, 0.52), rng.random() < 0.5, 0.36
    parts = [lathe([(0, 0), (0.17, 0), (0.13, 0.08), (0.12, 0.5), (0, 0.5)], role("trunk"), sides=16)]
    angle = np.arange(72) * 2 * np.pi / 72
    height = rng.uniform(0.5, 0.56)
    for k in range(3):
        r, wave = wide * (1 - 0.24 * k), 1 + 0.1 * np.cos(9 * angle + np.pi * k)
        profile = [(0, 0.1), (0.55, 0.08), (0.96, -0.06), (1.0, 0.0), (0.74, 0.2), (0.4, 0.55), (0.0, 1.0)]
        rows = []
        for out, up in profile:
            wavy = r * out * (1 + (wave - 1) * out)
            drop = up * height - 0.35 * r * (wave - 1) * out
            rows.append(np.stack([wavy * np.sin(angle), y + drop, wavy * np.cos(angle)], -1))
        parts.append(Part(np.concatenate(rows), grid_faces(len(rows), 72), role("needles", 0.86 + 0.14 * k)))
        if festive:
            n = 6 - k
            parts += ring_of([_bead(0.065, role("baubles"), (0, y + 0.1 * height, 0.94 * r))], n, 0.4 * k)
            between = _bead(0.052, GOLD, (0, y + 0.33 * height, 0.64 * r))
            parts += ring_of([between], n, 0.4 * k + np.pi / n)
        y += 0.58 * height
    top = y + 0.4 * height
    if festive:
        points = [
            (r * np.sin(a), r * np.cos(a))
            for r, a in zip([0.16, 0.075] * 5, np.arange(10) * np.pi / 5, strict=True)
        ]
        star = moved(extrude(points, 0.07, GOLD), (0, top + 0.07, 0))
        parts += [star, turned(star, 1, np.pi / 2)]
    return parts


KINDS = (
    Kind(
        ("tree",),
        tree,
        {"crown": ("green",), "trunk": ("brown",)},
        {"trunk": "a {} trunk"},
        weight=1.2,
        front=False,
    ),
    Kind(
        ("palm tree", "palm"),
        palm_tree,
        {"leaves": ("green",), "trunk": ("brown",)},
        {"trunk": "a {} trunk"},
        front=False,
    ),
    Kind(
        ("pine tree", "christmas tree", "fir tree"),
        pine_tree,
        {"needles": ("green",), "baubles": ("red",), "trunk": ("brown",)},
        front=False,
    ),
)
