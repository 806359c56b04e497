"""Heavy vehicles: a tractor and a tank."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.vehicles.outlines import Outline, polygon, rectangle, ring_piece
from export.everyday_objects.data.makers.vehicles.parts import CHASSIS, OUT, disc, narrowed, one_wheel, slab
from export.everyday_objects.data.shapes import (
    DARK,
    GLASS,
    LAMP,
    RED,
    WHITE,
    Part,
    bar,
    both_sides,
    box,
    cushion,
    frustum,
    lathe,
    loft,
    role,
    turned,
)


def tractor(rng: np.random.Generator) -> list[Part]:
    """A farm tractor: huge rear wheels with lugs, small front ones, a bonnet, a glass cab, an exhaust."""
    body, hub, tyre = role("body"), role("rims"), role("wheels")
    big, small, top = rng.uniform(0.48, 0.53), rng.uniform(0.28, 0.31), rng.uniform(1.38, 1.5)
    zr, zf = -0.42, 0.62
    bonnet = polygon((-0.1, 0.42), (-0.1, 0.94), (0.72, 0.86, 0.16), (0.86, 0.76, 0.1), (0.86, 0.44, 0.06))
    lugs = []
    for a in np.arange(12) * np.pi / 6:
        lug = frustum((0.38, 0.16), (0.34, 0.1), 0.09, tyre, (0.52, 2 * big - 0.04, zr))
        lugs.append(turned(lug, 0, a, (0, big, zr)))
    return [
        slab(bonnet, 0.56, body, edge=0.12),
        box((0.44, 0.24, 1.4), CHASSIS, (0, 0.42, 0.08)),
        box((0.8, 0.14, 0.16), CHASSIS, (0, small, zf)),
        slab(
            polygon((-0.8, 0.5, 0.08), (-0.02, 0.5), (-0.02, 0.96, 0.05), (-0.8, 0.92, 0.1)),
            0.6,
            body,
            edge=0.06,
        ),
        *narrowed(
            [slab(polygon((-0.74, 0.86), (-0.02, 0.86), (-0.1, top, 0.06), (-0.66, top, 0.06)), 0.68, GLASS)],
            0.9,
            top,
            0.9,
        ),
        *both_sides(
            *(
                bar((0.33, 0.88, z0), (0.3, top, z1), 0.06, body)
                for z0, z1 in ((-0.72, -0.64), (-0.05, -0.12))
            )
        ),
        slab(rectangle((-0.4, 0.4), (-0.82, 0.08), 0.12), 0.16, body, 1, (0, top + 0.04, 0), 0.07),
        *both_sides(
            *one_wheel((0.52, big, zr), big, 0.36, tyre, hub),
            *one_wheel((0.46, small, zf), small, 0.26, tyre, hub),
            *lugs,
            slab(
                ring_piece(zr, big, big + 0.06, big + 0.16, 0.35 * np.pi, 0.92 * np.pi),
                0.36,
                body,
                0,
                (0.48, 0, 0),
                0.04,
            ),
            disc((0.16, 0.68, 0.86), 0.09, 0.12, LAMP),
            disc((0.2, 0.76, -0.82), 0.09, 0.12, RED),
        ),
        cushion((0.4, 0.12, 0.08), DARK, (0, 0.52, 0.87)),
        cushion((0.3, 0.14, 0.3), CHASSIS, (0, 0.42, -0.86), 4.0),
        lathe(
            [(0, 0.7), (0.07, 0.7), (0.07, 1.1), (0.1, 1.12), (0.1, 1.3), (0.07, 1.32), (0, 1.3)],
            CHASSIS,
            (0.13, 0, 0.46),
            18,
        ),
        *(
            slab(rectangle((0.2 + d, 0.28 + d), (0.56, 0.78), 0.02), 0.56 + 2 * OUT, DARK, edge=0.02)
            for d in (0.06, 0.24, 0.42)
        ),
    ]


def _star(radius: float) -> Outline:
    """A star of five points that stands on two of them."""
    away = [radius if i % 2 == 0 else 0.45 * radius for i in range(10)]
    angle = np.pi / 2 + np.arange(10) * np.pi / 5
    return [(r * float(np.cos(a)), r * float(np.sin(a))) for r, a in zip(away, angle, strict=True)]


def tank(rng: np.random.Generator) -> list[Part]:
    """A toy tank: wide tracks around wheels, a sloped hull, a round turret with a short thick gun."""
    body, track, lower = role("body"), role("tracks"), role("body", 0.82)
    wide, gun, high = rng.uniform(0.95, 1.05), rng.uniform(0.95, 1.1), rng.uniform(0.34, 0.4)
    x = 0.47 * wide
    hull = polygon(
        (-0.9, 0.42, 0.06),
        (-0.94, 0.66, 0.06),
        (-0.7, 0.76, 0.06),
        (0.5, 0.76, 0.06),
        (0.95, 0.52, 0.06),
        (0.8, 0.26, 0.06),
        (-0.7, 0.26, 0.06),
    )
    belt = polygon(
        (-0.62, 0.0, 0.2),
        (0.62, 0.0, 0.2),
        (1.0, 0.34, 0.24),
        (0.8, 0.6, 0.2),
        (-0.8, 0.6, 0.2),
        (-1.0, 0.34, 0.24),
    )
    links = [
        box((0.38, 0.06, 0.1), track._replace(shade=0.7), (x, -0.01, z)) for z in np.linspace(-0.55, 0.55, 6)
    ]
    turret = loft(
        [
            (0.7, -0.1, 0.4, 0.42, 0),
            (0.78, -0.1, 0.44, 0.46, 0),
            (0.98, -0.12, 0.38, 0.4, 0),
            (0.74 + high, -0.14, 0.3, 0.32, 0),
        ],
        body,
        3.0,
        1,
    )
    return [
        slab(hull, 0.8 * wide, lower, edge=0.05),
        turret,
        bar((0, 0.92, 0.2), (0, 0.98, gun), 0.085, body._replace(shade=0.8)),
        bar((0, 0.985 - 0.02, gun - 0.14), (0, 0.99, gun + 0.06), 0.12, body._replace(shade=0.8)),
        bar((0, 0.9, 0.2), (0, 0.92, 0.42), 0.16, body),
        lathe(
            [(0, 0.1), (0.14, 0.1), (0.18, 0.05), (0.18, 0)],
            body._replace(shade=0.75),
            (0.0, 0.74 + high, -0.2),
            20,
        ),
        *both_sides(
            slab(belt, 0.38, track, 0, (x, 0, 0), 0.05),
            *links,
            *(disc((x + 0.19, 0.27, z), 0.15, 0.1, lower, 0) for z in (-0.66, -0.22, 0.22, 0.66)),
            slab(rectangle((-0.86, 0.86), (0.6, 0.7), 0.04), 0.3, lower, 0, (x - 0.05, 0, 0), 0.04),
            turned(slab(_star(0.19), 0.12, WHITE, 0, (0.38, 0.9, -0.12), 0.02), 2, 0.3, (0.38, 0.9, -0.12)),
        ),
        slab(_star(0.23), 0.1, WHITE, 1, (0, 0.76, -0.66), 0.02),
    ]


KINDS = (
    Kind(
        ("tractor",),
        tractor,
        {"body": ("green", "red"), "rims": ("yellow",), "wheels": ("black",)},
        {"rims": "{} rims", "wheels": "{} wheels"},
    ),
    Kind(("tank",), tank, {"body": ("green",), "tracks": ("black",)}, {"tracks": "{} tracks"}),
)
