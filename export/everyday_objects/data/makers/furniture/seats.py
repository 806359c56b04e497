"""Seats: a chair, an armchair, a sofa, a bench, a stool."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.furniture.joinery import arched_outline, block, evenly, four_legs
from export.everyday_objects.data.shapes import (
    Paint,
    Part,
    bar,
    both_sides,
    ellipsoid,
    extrude,
    frustum,
    lathe,
    moved,
    role,
    torus,
    turned,
)


def chair(rng: np.random.Generator) -> list[Part]:
    """A kitchen chair: four stout legs, a cushion on the seat, a back of rungs, of posts or in one piece."""
    w, d, tall = rng.uniform(0.68, 0.76), rng.uniform(0.62, 0.68), rng.uniform(1.12, 1.24)
    style, square = int(3 * rng.random()), rng.random() < 0.5
    seat, thick = 0.47, 0.13
    parts = four_legs(w / 2 - 0.07, d / 2 - 0.07, seat, thick, role("body", 0.9), bool(square), 0.03)
    parts += [
        block((w, 0.1, d), role("body"), (0, seat + 0.01, 0), 0.04),
        block((w - 0.1, 0.12, d - 0.12), role("cushion"), (0, seat + 0.09, 0.02), 0.055),
    ]
    high = tall - seat
    back = []
    if style == 2:
        panel = extrude(arched_outline(w, 0, high - 0.14, 0.14), 0.09, role("body"))
        pad = extrude(arched_outline(w - 0.2, 0.2, high - 0.2, 0.1), 0.06, role("cushion"))
        back += [panel, moved(pad, (0, 0, 0.05)), moved(pad, (0, 0, -0.04))]
    else:
        back += both_sides(block((0.11, high, 0.11), role("body"), (w / 2 - 0.06, high / 2, 0), 0.04))
        if style == 0:
            back += [
                block((w - 0.15, 0.15, 0.075), role("body", 0.92), (0, y * high, 0), 0.035)
                for y in (0.45, 0.82)
            ]
        else:
            rail = extrude(arched_outline(w + 0.02, high - 0.17, high - 0.03, 0.09), 0.12, role("body"))
            back += [
                rail,
                *(bar((x, 0, 0), (x, high - 0.1, 0), 0.05, role("body", 0.92)) for x in evenly(3, w - 0.16)),
            ]
    return parts + [moved(turned(p, 0, -0.1), (0, seat, -d / 2 + 0.06)) for p in back]


def _upholstered(
    w: float, d: float, tall: float, arm: float, seats: int, rolled: bool, seat_paint: Paint
) -> list[Part]:
    """Base, arms, back, seat and back cushions of an armchair or a sofa `w` wide."""
    frame, soft = role("body", 0.74), role("body")
    inner, top, back = w - 2 * arm, 0.68, -d / 2
    parts = [
        block((w + 0.03, 0.15, d + 0.04), role("body", 0.62), (0, 0.22, 0.01), 0.03),
        turned(
            block((inner + 0.16, tall - 0.15, 0.24), frame, (0, tall / 2 + 0.075, back + 0.12), 0.11),
            0,
            -0.06,
            (0, 0.2, back),
        ),
    ]
    for x in evenly(seats, inner):
        wide = inner / seats - 0.03
        parts += [
            block((wide, 0.21, d - 0.22), seat_paint, (x, 0.455, 0.15), 0.08),
            turned(
                block((wide, tall - 0.58, 0.22), soft, (x, tall / 2 + 0.24, back + 0.29), 0.1),
                0,
                -0.12,
                (0, 0.5, back),
            ),
        ]
    if rolled:
        r = 0.62 * arm
        x = w / 2 - arm / 2 + 0.02
        side = [
            block(
                (arm - 0.04, top - 0.2, d - 0.03),
                frame,
                (w / 2 - arm / 2, 0.12 + (top - 0.2) / 2, 0.01),
                0.05,
            ),
            bar((x, top - r, back + 0.06), (x, top - r, d / 2 + 0.02), r, role("body", 0.86), sides=24),
            ellipsoid((0.66 * r, 0.66 * r, 0.04), soft, (x, top - r, d / 2 + 0.02)),
        ]
    else:
        side = [
            block(
                (arm, top - 0.13, d - 0.02),
                role("body", 0.86),
                (w / 2 - arm / 2, top / 2 + 0.065, 0.01),
                0.09,
            )
        ]
    return parts + both_sides(*side)


def _feet(w: float, d: float, high: float, thick: float) -> list[Part]:
    """Four short feet that widen upwards."""
    return [
        frustum(
            (0.7 * thick, 0.7 * thick),
            (thick, thick),
            high,
            role("feet"),
            (sx * (w / 2 - 0.1), 0, sz * (d / 2 - 0.11)),
        )
        for sx in (1, -1)
        for sz in (1, -1)
    ]


def armchair(rng: np.random.Generator) -> list[Part]:
    """A plump armchair: thick arms, a high back, one seat cushion, short feet."""
    w, d, tall = rng.uniform(1.08, 1.18), rng.uniform(0.92, 1.0), rng.uniform(1.14, 1.26)
    rolled = bool(rng.random() < 0.5)
    parts = _upholstered(w, d, tall, rng.uniform(0.24, 0.28), 1, rolled, role("cushion"))
    return parts + _feet(w, d, 0.16, 0.17)


def sofa(rng: np.random.Generator) -> list[Part]:
    """A sofa of two or three seats: arms, back and seat cushions, a pillow at either end, short feet."""
    seats = 2 if rng.random() < 0.6 else 3
    w, d, tall = rng.uniform(1.6, 1.72), rng.uniform(0.84, 0.92), rng.uniform(0.95, 1.05)
    arm = rng.uniform(0.22, 0.26)
    parts = _upholstered(w, d, tall, arm, seats, bool(rng.random() < 0.5), role("body"))
    pillow = turned(turned(block((0.36, 0.36, 0.17), role("pillows"), (0, 0, 0), 0.08), 2, 0.12), 0, -0.3)
    parts += both_sides(moved(pillow, (w / 2 - arm - 0.19, 0.72, 0.02)))
    return parts + _feet(w, d, 0.16, 0.18)


def bench(rng: np.random.Generator) -> list[Part]:
    """A park bench: planks on two stout side frames with arm rests."""
    w, tall, rest = rng.uniform(1.3, 1.45), rng.uniform(0.9, 1.0), rng.random() < 0.6
    seat, d = 0.45, 0.6
    parts = [block((w, 0.08, 0.17), role("body"), (0, seat + 0.03, z), 0.03) for z in (-0.19, 0.01, 0.21)]
    lean = [block((w, 0.18, 0.08), role("body"), (0, y, 0.05), 0.03) for y in (0.23, tall - seat - 0.06)]
    side = [
        block((0.12, seat, 0.12), role("legs"), (0, seat / 2, d / 2 - 0.08), 0.02),
        block((0.12, seat, 0.12), role("legs"), (0, seat / 2, -d / 2 + 0.08), 0.02),
        block((0.12, 0.1, d), role("legs"), (0, seat - 0.05, 0), 0.02),
    ]
    if rest:
        side += [
            block((0.13, 0.08, d), role("legs"), (0, seat + 0.26, 0.02), 0.03),
            block((0.11, 0.27, 0.11), role("legs"), (0, seat + 0.13, d / 2 - 0.07), 0.02),
        ]
    post = block((0.12, tall - seat, 0.1), role("legs"), (0, (tall - seat) / 2, -0.035), 0.02)
    parts += [moved(turned(p, 0, -0.15), (0, seat, -d / 2 + 0.05)) for p in lean]
    side.append(moved(turned(post, 0, -0.15), (0, seat, -d / 2 + 0.05)))
    return parts + both_sides(*(moved(p, (w / 2 - 0.12, 0, 0)) for p in side))


def stool(rng: np.random.Generator) -> list[Part]:
    """A round stool: a thick seat on four spread legs with a ring."""
    r, tall, thick = rng.uniform(0.33, 0.38), rng.uniform(0.66, 0.8), rng.uniform(0.14, 0.19)
    profile = [(0, 0), (r - 0.03, 0), (r, 0.03), (r, thick - 0.06), (r - 0.06, thick), (0, thick + 0.02)]
    parts = [lathe(profile, role("seat"), (0, tall - thick, 0))]
    parts.append(
        lathe([(0, 0), (r - 0.06, 0), (r - 0.06, 0.08), (0, 0.08)], role("legs"), (0, tall - thick - 0.06, 0))
    )
    for a in np.pi / 4 + np.arange(4) * np.pi / 2:
        s, c = np.sin(a), np.cos(a)
        parts.append(
            bar((0.2 * s, tall - thick, 0.2 * c), (0.36 * s, 0, 0.36 * c), 0.065, role("legs"), 0.85)
        )
    return [*parts, torus(0.3, 0.04, role("legs", 0.85), (0, 0.24, 0))]


KINDS = (
    Kind(
        ("chair",),
        chair,
        {"body": ("brown", "beige"), "cushion": ("red", "blue")},
        {"cushion": "a {} cushion"},
        weight=1.5,
    ),
    Kind(
        ("armchair",),
        armchair,
        {"body": ("green", "red"), "cushion": ("beige",), "feet": ("brown",)},
        {"cushion": "a {} cushion", "feet": "{} feet"},
        weight=1.3,
    ),
    Kind(
        ("sofa", "couch"),
        sofa,
        {"body": ("blue", "grey"), "pillows": ("yellow", "white"), "feet": ("brown",)},
        {"pillows": "{} pillows", "feet": "{} feet"},
        weight=1.5,
    ),
    Kind(("bench",), bench, {"body": ("brown",), "legs": ("black", "grey")}, {"legs": "{} legs"}),
    Kind(
        ("stool",),
        stool,
        {"seat": ("red", "brown"), "legs": ("brown", "beige")},
        {"legs": "{} legs"},
        front=False,
    ),
)
