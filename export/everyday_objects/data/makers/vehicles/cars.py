"""Cars: for every day, for sport, for races."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.vehicles.outlines import polygon, rectangle, wheel_arch
from export.everyday_objects.data.makers.vehicles.parts import CHASSIS, OUT, disc, narrowed, slab, wheel_pairs
from export.everyday_objects.data.shapes import (
    DARK,
    GLASS,
    LAMP,
    RED,
    STEEL,
    WHITE,
    Paint,
    Part,
    Vector,
    both_sides,
    box,
    cushion,
    ellipsoid,
    role,
    turned,
)

_SEVEN = [(-0.5, 1.0), (0.5, 1.0), (0.5, 0.7), (0.12, -1.0), (-0.25, -1.0), (0.14, 0.66), (-0.5, 0.66)]


def _cabin(
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    width: float,
    paint: Paint,
    roof: Paint,
    pillar: float | None,
) -> list[Part]:
    """Shell, windows and roof of a car.

    `low` and `high` are (y, z of the rear, z of the front), `pillar` is the z of the one between windows.
    """
    (y0, back0, front0), (y1, back1, front1) = low, high

    def back(y: float) -> float:
        """z of the rear at a height."""
        return back0 + (back1 - back0) * (y - y0) / (y1 - y0)

    def front(y: float) -> float:
        """z of the front at a height."""
        return front0 + (front1 - front0) * (y - y0) / (y1 - y0)

    a, b = y0 + 0.08, y1 - 0.13
    c = y1 - 0.08
    panes = [
        polygon(
            (back(a) + 0.13, a, 0.05),
            (front(a) - 0.15, a, 0.05),
            (front(b) - 0.15, b, 0.05),
            (back(b) + 0.13, b, 0.05),
        )
    ]
    if pillar is not None:
        panes = [
            polygon(
                (back(a) + 0.13, a, 0.05),
                (pillar - 0.06, a, 0.03),
                (pillar - 0.06, b, 0.03),
                (back(b) + 0.13, b, 0.05),
            ),
            polygon(
                (pillar + 0.06, a, 0.03),
                (front(a) - 0.15, a, 0.05),
                (front(b) - 0.15, b, 0.05),
                (pillar + 0.06, b, 0.03),
            ),
        ]
    screen = polygon((back(a) - OUT, a), (front(a) + OUT, a), (front(b) + OUT, b), (back(b) - OUT, b))
    parts = [
        slab(polygon((back0, y0), (front0, y0), (front1, y1, 0.12), (back1, y1, 0.12)), width, paint),
        slab(screen, 0.8 * width, GLASS),
        *(slab(p, width + 2 * OUT, GLASS, edge=0.02) for p in panes),
        slab(
            polygon(
                (back(c) - 0.05, c, 0.05),
                (front(c) + 0.06, c, 0.05),
                (front1 - 0.05, y1 + 0.06, 0.1),
                (back1 + 0.05, y1 + 0.06, 0.1),
            ),
            width + 2 * OUT,
            roof,
            edge=0.07,
        ),
    ]
    return narrowed(parts, y0, y1, 0.82)


def car(rng: np.random.Generator) -> list[Part]:
    """A small round everyday car: short bonnet, high glass cabin, big wheels in arches, round lamps."""
    body, roof, tyre = role("body"), role("roof"), role("wheels")
    length, top, r = rng.uniform(0.96, 1.04), rng.uniform(1.12, 1.2), rng.uniform(0.27, 0.3)
    boot = float(rng.choice([0.0, 0.22]))
    z = length - r - 0.2
    side = polygon(
        (length, 0.18, 0.08),
        (length + 0.02, 0.52, 0.16),
        (length - 0.12, 0.7, 0.2),
        (0.3, 0.76),
        (-length + 0.1, 0.74, 0.18),
        (-length, 0.5, 0.14),
        (-length, 0.18, 0.08),
    )
    side += [*wheel_arch(-z, r, r + 0.06, 0.18)[::-1], *wheel_arch(z, r, r + 0.06, 0.18)[::-1]]
    return [
        slab(side, 1.1, body, edge=0.08),
        box((0.7, 0.4, 1.5), CHASSIS, (0, 0.36, 0)),
        *_cabin(
            (0.7, -length + 0.08 + boot, 0.5),
            (top, -length + 0.26 + boot, 0.18),
            1.04,
            body,
            roof,
            -0.24 + boot / 2,
        ),
        *wheel_pairs([(z, r), (-z, r)], 0.47, 0.26, tyre),
        cushion((1.12, 0.15, 0.16), STEEL, (0, 0.27, length)),
        cushion((1.12, 0.15, 0.16), STEEL, (0, 0.27, -length)),
        cushion((0.4, 0.14, 0.1), DARK, (0, 0.47, length)),
        cushion((0.36, 0.16, 0.08), WHITE, (0, 0.46, -length)),
        *both_sides(
            disc((0.37, 0.5, length), 0.13, 0.14, LAMP),
            cushion((0.2, 0.18, 0.1), RED, (0.4, 0.5, -length)),
            ellipsoid((0.1, 0.08, 0.06), body, (0.58, 0.82, 0.36)),
        ),
    ]


def sports_car(rng: np.random.Generator) -> list[Part]:
    """A low wedge with a pointed nose, a black glass canopy, fat rear wheels and a spoiler."""
    body, trim, tyre = role("body"), role("spoiler"), role("wheels")
    nose, tail = rng.uniform(0.98, 1.06), rng.uniform(0.56, 0.62)
    high = rng.uniform(0.84, 0.9)
    front, rear = 0.26, 0.3
    zf, zr = nose - 0.45, -0.52
    side = [
        *polygon(
            (-0.96, 0.18),
            (-1.0, tail - 0.04, 0.1),
            (-0.9, tail + 0.04, 0.1),
            (-0.3, 0.62),
            (0.35, 0.56),
            (nose - 0.2, 0.42, 0.2),
            (nose, 0.3, 0.08),
            (nose - 0.04, 0.15, 0.05),
        ),
        *wheel_arch(zf, front, front + 0.05, 0.14),
        *wheel_arch(zr, rear, rear + 0.05, 0.14),
    ]
    glass = polygon((-0.72, 0.52), (0.5, 0.5), (0.1, high - 0.02, 0.12), (-0.36, high - 0.02, 0.16))
    roof = polygon(
        (-0.52, high - 0.14, 0.05),
        (0.2, high - 0.14, 0.05),
        (0.06, high + 0.03, 0.1),
        (-0.34, high + 0.03, 0.1),
    )
    return [
        slab(side, 1.14, body, edge=0.05),
        box((0.7, 0.3, 1.5), CHASSIS, (0, 0.32, 0)),
        *narrowed([slab(glass, 0.94, GLASS, edge=0.08), slab(roof, 1.0, body, edge=0.06)], 0.55, high, 0.76),
        *wheel_pairs([(zf, front)], 0.47, 0.28, tyre),
        *wheel_pairs([(zr, rear)], 0.46, 0.36, tyre),
        slab(rectangle((-0.58, 0.58), (-1.08, -0.78), 0.08), 0.1, trim, 1, (0, tail + 0.3, 0), 0.04),
        cushion((1.12, 0.1, 0.22), trim, (0, 0.16, nose - 0.06)),
        cushion((0.8, 0.14, 0.14), trim, (0, 0.26, -0.98)),
        *both_sides(
            slab(
                rectangle((-0.99, -0.85), (tail - 0.05, tail + 0.3), 0.02), 0.1, trim, 0, (0.36, 0, 0), 0.03
            ),
            cushion((0.1, 0.12, 0.5), trim, (0.55, 0.18, 0.02)),
            turned(
                cushion((0.28, 0.1, 0.24), LAMP, (0.36, 0.46, nose - 0.24)),
                0,
                0.45,
                (0.36, 0.46, nose - 0.24),
            ),
            cushion((0.3, 0.13, 0.1), RED, (0.34, tail - 0.1, -1.0)),
            ellipsoid((0.1, 0.07, 0.07), body, (0.54, 0.66, 0.26)),
        ),
    ]


def _seven(at: Vector, size: float, side: str) -> list[Part]:
    """A white round patch with a black 7 for the "left" (+x), "right" or "top" of a car."""
    if side == "top":
        digit = [(size * 0.66 * x, -size * 0.66 * y) for x, y in _SEVEN]
    else:
        flip = -1 if side == "left" else 1
        digit = [(flip * size * 0.66 * x, size * 0.66 * y) for x, y in _SEVEN]
    axis = 1 if side == "top" else 0
    return [disc(at, size, 0.12, WHITE, axis), slab(digit, 0.12 + 2 * OUT, DARK, axis, at, 0.01)]


def race_car(rng: np.random.Generator) -> list[Part]:
    """A stock car: long bonnet and boot, a bold stripe over everything, a 7 on its doors and roof."""
    body, stripe, tyre = role("body"), role("stripe"), role("wheels")
    r, top, length = rng.uniform(0.25, 0.28), rng.uniform(0.94, 1.0), rng.uniform(1.0, 1.06)
    z, y = length - r - 0.2, 0.68
    tall = [
        (length, 0.14, 0.06),
        (length, 0.5, 0.12),
        (length - 0.1, 0.6, 0.12),
        (0.3, y),
        (-length + 0.1, y + 0.02, 0.1),
        (-length, 0.6, 0.08),
        (-length + 0.02, 0.14, 0.06),
    ]
    arches = [*wheel_arch(-z, r, r + 0.05, 0.14)[::-1], *wheel_arch(z, r, r + 0.05, 0.14)[::-1]]
    over = [(p[0] * 1.035, p[1] + (OUT if p[1] > 0.3 else 0.05), *p[2:]) for p in tall]
    cabin = _cabin((0.62, -0.72, 0.42), (top, -0.44, 0.1), 1.0, body, body, None)
    return [
        slab(polygon(*tall) + arches, 1.14, body, edge=0.08),
        box((0.7, 0.36, 1.6), CHASSIS, (0, 0.34, 0)),
        slab(polygon(*over), 0.34, stripe, edge=0.03),
        *cabin,
        *_seven((0, top + 0.03, -0.17), 0.24, "top"),
        *_seven((0.56, 0.44, 0.0), 0.26, "left"),
        *_seven((-0.56, 0.44, 0.0), 0.26, "right"),
        *wheel_pairs([(z, r), (-z, r)], 0.46, 0.28, tyre),
        slab(
            rectangle((-0.54, 0.54), (-length, -length + 0.12), 0.03),
            0.22,
            stripe,
            1,
            (0, y + 0.08, 0),
            0.04,
        ),
        cushion((1.16, 0.14, 0.16), stripe, (0, 0.18, length)),
        cushion((0.66, 0.14, 0.1), DARK, (0, 0.36, length)),
        *both_sides(
            cushion((0.22, 0.14, 0.12), LAMP, (0.42, 0.48, length - 0.01)),
            cushion((0.12, 0.12, 2 * z - 2 * r - 0.04), stripe, (0.55, 0.16, 0)),
            cushion((0.26, 0.14, 0.1), RED, (0.4, 0.46, -length)),
        ),
    ]


KINDS = (
    Kind(
        ("car", "automobile"),
        car,
        {"body": ("red", "blue"), "roof": ("white",), "wheels": ("black",)},
        {"roof": "a {} roof", "wheels": "{} wheels"},
        weight=1.6,
    ),
    Kind(
        ("sports car",),
        sports_car,
        {"body": ("red", "yellow"), "spoiler": ("black",), "wheels": ("black",)},
        {"spoiler": "a {} spoiler", "wheels": "{} wheels"},
        weight=1.2,
    ),
    Kind(
        ("race car", "nascar", "racing car"),
        race_car,
        {"body": ("blue", "red"), "stripe": ("white", "yellow"), "wheels": ("black",)},
        {"stripe": "a {} stripe", "wheels": "{} wheels"},
    ),
)
