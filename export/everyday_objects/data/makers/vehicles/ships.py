"""Ships: a fishing boat, a rowboat, a galleon."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.vehicles.outlines import polygon, rectangle
from export.everyday_objects.data.makers.vehicles.parts import OUT, disc, slab
from export.everyday_objects.data.shapes import (
    DARK,
    GLASS,
    LAMP,
    RED,
    WOOD,
    Paint,
    Part,
    Vector,
    bar,
    both_sides,
    curve,
    cushion,
    ellipsoid,
    fixed,
    grid_faces,
    lathe,
    moved,
    role,
    torus,
    tube,
    turned,
)


def _hull(sections: Sequence[tuple[float, float, float, float]], paint: Paint, fullness: float = 2.6) -> Part:
    """A hull with a flat deck; sections from stern to bow: (z, half width at the deck, keel y, deck y)."""
    angle = np.linspace(0, np.pi, 25)
    p = 2 / fullness
    u, v = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** p, np.abs(np.sin(angle)) ** p
    rows = []
    for z, width, keel, deck in sections:
        rows.append(np.stack([width * u, deck - (deck - keel) * v, np.full(len(u), z)], -1))
    ends = [np.repeat(r.mean(0, keepdims=True), len(u), 0) for r in (rows[0], rows[-1])]
    grid = [ends[0], *rows, ends[1]]
    return Part(np.concatenate(grid), grid_faces(len(grid), len(u)), paint)


def _smooth(sections: Sequence[tuple[float, ...]]) -> list[tuple[float, float, float, float]]:
    """More sections of a hull between those given, on smooth curves."""
    return [
        (float(z), max(float(w), 0.02), float(k), float(d))
        for z, w, k, d in curve([np.array(s) for s in sections], 16)
    ]


def _rim(sections: Sequence[tuple[float, float, float, float]], radius: float, paint: Paint) -> list[Part]:
    """A thick rail around the deck of a hull."""
    edge = [(w, deck, z) for z, w, _, deck in sections]
    stern, bow = edge[0], edge[-1]
    ends = [bar((-x, y, z), (x, y, z), radius, paint) for x, y, z in (stern, bow)]
    return [
        *both_sides(tube(edge, radius, paint)),
        *ends,
        ellipsoid(radius * 1.1, paint, (0, bow[1], bow[2])),
    ]


def boat(rng: np.random.Generator) -> list[Part]:
    """A little fishing boat: a round hull with a thick rail, a wooden deck, a cabin, a funnel."""
    hull, cabin = role("hull"), role("cabin")
    wide, high, bow = rng.uniform(0.46, 0.52), rng.uniform(0.95, 1.05), rng.uniform(0.62, 0.7)
    ribs = _smooth(
        [
            (-0.98, 0.36 * wide / 0.48, 0.1, 0.5),
            (-0.6, wide, 0.0, 0.45),
            (0.0, wide * 1.03, 0.0, 0.44),
            (0.55, 0.36, 0.06, 0.52),
            (1.0, 0.03, 0.3, bow),
        ]
    )
    deck = [(z * 0.95, w * 0.9, y - 0.1, y + 0.02) for z, w, _, y in ribs]
    water = [(z * 1.02, w * 0.92 + 0.03, k - 0.03, k + 0.4 * (y - k)) for z, w, k, y in ribs]
    house = polygon((-0.58, 0.4), (0.3, 0.4), (0.24, high, 0.06), (-0.54, high, 0.06))
    return [
        _hull(ribs, hull),
        _hull(water, hull._replace(shade=0.6)),
        _hull(deck, WOOD),
        *_rim(ribs, 0.075, cabin),
        slab(house, 0.56, cabin, edge=0.06),
        slab(rectangle((-0.38, 0.38), (-0.68, 0.4), 0.08), 0.12, hull, 1, (0, high + 0.02, 0), 0.05),
        slab(rectangle((-0.44, -0.2), (0.62, high - 0.12)), 0.56 + 2 * OUT, GLASS, edge=0.02),
        slab(rectangle((-0.08, 0.16), (0.62, high - 0.12)), 0.56 + 2 * OUT, GLASS, edge=0.02),
        slab(rectangle((-0.2, 0.2), (0.62, high - 0.12)), 0.92, GLASS, 2, (0, 0, -0.14), 0.02),
        lathe([(0, 0), (0.12, 0), (0.12, 0.3), (0, 0.3)], hull, (0, high + 0.04, -0.34), 24),
        lathe([(0, 0), (0.135, 0), (0.135, 0.12), (0, 0.12)], DARK, (0, high + 0.26, -0.34), 24),
        *both_sides(
            moved(turned(torus(0.13, 0.05, fixed(0.95, 0.45, 0.1)), 2, np.pi / 2), (wide * 1.03, 0.28, -0.1))
        ),
    ]


def _opened(hull: Part, rows: int) -> Part:
    """A hull of so many rows of vertices without its deck."""
    n = len(hull.vertices) // rows
    row, column = np.divmod(hull.faces, n)
    deck = (column.min(1) == 0) & (column.max(1) == n - 1) & (row.min(1) > 0) & (row.max(1) < rows - 1)
    return hull._replace(faces=hull.faces[~deck])


def rowboat(rng: np.random.Generator) -> list[Part]:
    """An open boat: a round hull with a thick rail, two benches, an oar over each side."""
    hull, rail = role("hull"), role("rail")
    wide, bow = rng.uniform(0.5, 0.56), rng.uniform(0.72, 0.8)
    ribs = _smooth(
        [
            (-0.9, 0.4 * wide / 0.5, 0.12, 0.6),
            (-0.5, wide, 0.0, 0.54),
            (0.0, wide * 1.05, 0.0, 0.52),
            (0.5, 0.42, 0.05, 0.59),
            (0.94, 0.03, 0.34, bow),
        ]
    )
    outer = _hull(ribs, hull)
    inner = _hull(
        [(z * 0.94, w * 0.9, k + 0.45 * (y - k), y) for z, w, k, y in ribs], hull._replace(shade=0.72), 4.0
    )
    rows = len(ribs) + 2
    return [
        _opened(outer, rows),
        _opened(inner, rows),
        *_rim(ribs, 0.08, rail),
        *(
            slab(rectangle((-w, w), (z - 0.12, z + 0.12), 0.03), 0.1, WOOD, 1, (0, 0.47, 0), 0.03)
            for z, w in ((-0.5, wide * 0.88), (0.12, wide * 0.94))
        ),
        *both_sides(
            bar((0.16, 0.74, 0.2), (0.7, 0.52, -0.26), 0.06, WOOD),
            bar((0.62, 0.555, -0.19), (0.78, 0.49, -0.33), 0.07, WOOD, 1.7),
        ),
    ]


def _sail(width: float, height: float, bulge: float, paint: Paint, at: Vector) -> Part:
    """A square sail full of wind, thick, wider at its foot; `at` the middle of its yard."""
    cloth = cushion((width, height, 0.12), paint, roundness=8.0)
    v = cloth.vertices
    u, t = 2 * v[:, 0] / width, 2 * v[:, 1] / height
    v[:, 0] *= 1 - 0.1 * t
    v[:, 2] += bulge * (1 - 0.75 * u**2) * (1 - 0.75 * t**2)
    return moved(cloth, np.asarray(at) - (0, height / 2, 0))


def sailing_ship(rng: np.random.Generator) -> list[Part]:
    """A small galleon: a round hull with a high stern, two masts, thick billowing sails, a flag."""
    hull, sail = role("hull"), role("sails")
    wide, tall = rng.uniform(0.36, 0.4), rng.uniform(0.95, 1.05)
    trim = hull._replace(shade=0.65)
    ribs = _smooth(
        [
            (-0.86, 0.28, 0.16, 0.62),
            (-0.5, wide, 0.02, 0.46),
            (0.0, wide * 1.05, 0.0, 0.4),
            (0.5, 0.3, 0.06, 0.5),
            (0.92, 0.04, 0.34, 0.7),
        ]
    )
    deck = [(z * 0.95, w * 0.9, y - 0.1, y + 0.02) for z, w, _, y in ribs]
    top = 1.5 * tall
    return [
        _hull(ribs, hull),
        _hull(deck, fixed(0.78, 0.6, 0.38)),
        *_rim(ribs, 0.065, trim),
        slab(polygon((-0.94, 0.5), (-0.42, 0.4), (-0.42, 0.7, 0.04), (-0.96, 0.86, 0.05)), 0.56, hull),
        slab(polygon((-1.0, 0.8), (-0.38, 0.64), (-0.38, 0.74), (-1.0, 0.92)), 0.62, trim),
        slab(rectangle((-0.18, 0.18), (0.56, 0.74), 0.05), 0.2, LAMP, 2, (0, 0, -0.88), 0.02),
        bar((0, 0.3, -0.16), (0, top + 0.1, -0.16), 0.065, WOOD),
        bar((0, 0.3, 0.46), (0, top - 0.16, 0.46), 0.06, WOOD),
        bar((0, 0.6, 0.7), (0, 0.84, 1.1), 0.06, WOOD),
        _sail(0.96, 0.8 * tall, 0.36, sail, (0, top, -0.08)),
        _sail(0.76, 0.62 * tall, 0.3, sail, (0, top - 0.24, 0.54)),
        slab(polygon((0, 0), (0.3, 0.1), (0, 0.2)), 0.09, RED, 0, (0, top + 0.06, -0.16), 0.02),
        *both_sides(*(disc((wide * 0.98, 0.27, z), 0.07, 0.12, DARK, 0) for z in (-0.44, -0.12, 0.2))),
    ]


KINDS = (
    Kind(
        ("boat", "fishing boat"),
        boat,
        {"hull": ("red", "blue"), "cabin": ("white",)},
        {"cabin": "a {} cabin"},
    ),
    Kind(
        ("rowboat", "rowing boat"),
        rowboat,
        {"hull": ("red", "blue"), "rail": ("white",)},
        {"rail": "a {} rail"},
        weight=0.6,
    ),
    Kind(
        ("sailing ship", "ship", "sailboat"),
        sailing_ship,
        {"hull": ("brown",), "sails": ("white", "beige")},
        {"sails": "{} sails"},
    ),
)
