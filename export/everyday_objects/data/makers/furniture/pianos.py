"""Pianos: an upright one and a grand one."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.furniture.joinery import block
from export.everyday_objects.data.shapes import (
    DARK,
    GOLD,
    WHITE,
    Part,
    Vector,
    bar,
    both_sides,
    box,
    extrude,
    fixed,
    lathe,
    moved,
    role,
    turned,
)


def _keyboard(w: float, d: float, at: Vector) -> list[Part]:
    """White keys in one slab, black ones in twos and threes on its rear part; `at` the middle of its top."""
    x, y, z = np.asarray(at)
    keys = [box((w, 0.06, d), WHITE, (x, y - 0.03, z))]
    pitch = w / 9.4
    for place in (-4, -3, -1, 0, 1, 3, 4):
        black = (x + place * pitch, y + 0.015, z - 0.19 * d)
        keys.append(box((0.6 * pitch, 0.06, 0.6 * d), DARK, black))
    return keys


def piano(rng: np.random.Generator) -> list[Part]:
    """An upright piano: a tall case, keys on a shelf with two legs, a sheet of music, pedals."""
    w, tall, d = rng.uniform(1.3, 1.42), rng.uniform(1.08, 1.2), 0.36
    legs = rng.random() < 0.5
    key, front, out = 0.56, d / 2, 0.32
    parts = [
        block((w - 0.06, tall - 0.04, d), role("body"), (0, tall / 2, 0), 0.02),
        block((w + 0.05, 0.09, d + 0.1), role("trim"), (0, tall - 0.02, 0.01), 0.03),
        block((w + 0.02, 0.11, d + 0.06), role("trim"), (0, 0.055, 0), 0.02),
        box((w - 0.26, tall - 0.36, 0.03), role("body", 0.75), (0, tall / 2, -front)),
        box((w - 0.2, 0.3, 0.03), role("body", 0.75), (0, 0.29, front)),
        block((w - 0.02, 0.1, out + 0.06), role("trim"), (0, key - 0.05, front + out / 2 - 0.02), 0.02),
        *_keyboard(w - 0.22, 0.24, (0, key + 0.05, front + 0.13)),
        block((w - 0.1, 0.09, 0.07), role("body"), (0, key + 0.07, front + 0.02), 0.02),
        block((w - 0.2, 0.06, 0.07), role("body", 0.85), (0, key + 0.21, front + 0.02), 0.02),
    ]
    sheet = block((0.46, 0.3, 0.05), WHITE, (0, key + 0.38, front + 0.05), 0.015)
    parts.append(turned(sheet, 0, -0.1, (0, key + 0.24, front)))
    parts += [
        box((0.34, 0.025, 0.02), DARK, (0, key + y, front + z))
        for y, z in ((0.33, 0.062), (0.4, 0.055), (0.47, 0.05))
    ]
    parts += [block((0.07, 0.05, 0.16), GOLD, (x, 0.09, front + 0.06), 0.02) for x in (-0.1, 0.1)]
    side = [
        block(
            (0.11, 0.19, out + 0.06), role("body"), (w / 2 - 0.055, key + 0.03, front + out / 2 - 0.02), 0.03
        )
    ]
    if legs:
        profile = [
            (0, 0),
            (0.08, 0),
            (0.08, 0.06),
            (0.05, 0.1),
            (0.075, 0.26),
            (0.055, 0.36),
            (0.08, 0.42),
            (0.08, 0.5),
        ]
        side.append(lathe(profile, role("trim"), (w / 2 - 0.09, 0, front + out - 0.09), 16))
    else:
        side.append(block((0.11, key, 0.12), role("trim"), (w / 2 - 0.06, key / 2, front + out - 0.08), 0.02))
    return parts + both_sides(*side)


def _wing(w: float, long: float, inset: float = 0.0) -> list[tuple[float, float]]:
    """Outline (x, z) of a grand piano: keyboard edge at z = 0, straight side at -x, bowed side at +x."""
    a = w / 2 - inset
    t = np.linspace(0, 1, 13)[1:]
    bow = [
        (a - (0.62 * w - inset) * (3 * s**2 - 2 * s**3), -0.32 * long - (0.5 * long - inset) * s) for s in t
    ]
    r = (bow[-1][0] + a) / 2
    middle = bow[-1][0] - r
    tip = [
        (middle + r * np.cos(s), bow[-1][1] - 0.16 * long * np.sin(s)) for s in np.linspace(0, np.pi, 11)[1:]
    ]
    return [(-a, 0), (a, 0), (a, -0.32 * long), *bow, *tip]


def grand_piano(rng: np.random.Generator) -> list[Part]:
    """A grand piano: the winged case, golden inside, lid propped open, keys in front, three legs."""
    w, long, open_ = rng.uniform(1.15, 1.25), rng.uniform(1.2, 1.35), rng.uniform(0.52, 0.62)
    low, high = 0.4, 0.26
    top = low + high
    case = moved(extrude(_wing(w, long), high, role("body"), 1), (0, low + high / 2, 0))
    inner = moved(extrude(_wing(w - 0.02, long, 0.07), 0.03, GOLD, 1), (0, top + 0.005, -0.08))
    parts = [case, inner]
    parts += [
        bar(
            (-0.36 + 0.14 * k, top + 0.01, -0.16),
            (-0.42 + 0.05 * k, top + 0.01, -0.7 * long),
            0.014,
            fixed(0.6, 0.42, 0.12),
            sides=6,
        )
        for k in range(5)
    ]
    lid = moved(extrude(_wing(w + 0.04, long + 0.02), 0.06, role("body"), 1), (w / 2 + 0.02, 0.03, 0.0))
    lid = moved(turned(lid, 2, open_), (-w / 2 - 0.01, top + 0.02, -0.09))
    reach = 0.72 * w
    prop = (-w / 2 + reach * np.cos(open_), top + reach * np.sin(open_), -0.4 * long)
    parts += [lid, bar((w / 2 - 0.12, top, -0.33 * long), prop, 0.035, role("legs"))]
    parts += [
        block((w + 0.02, 0.1, 0.36), role("body"), (0, low + 0.05, 0.14), 0.03),
        *_keyboard(w - 0.24, 0.25, (0, low + 0.15, 0.16)),
        *both_sides(block((0.12, 0.22, 0.36), role("body"), (w / 2 - 0.05, low + 0.11, 0.14), 0.03)),
        turned(
            block((0.56, 0.2, 0.06), role("body", 0.8), (0, top + 0.09, -0.02), 0.03), 0, -0.25, (0, top, 0)
        ),
        turned(block((0.3, 0.18, 0.05), WHITE, (0, top + 0.11, 0.02), 0.02), 0, -0.25, (0, top, 0)),
    ]
    profile = [
        (0, 0),
        (0.075, 0),
        (0.085, 0.05),
        (0.065, 0.09),
        (0.1, 0.3),
        (0.12, 0.35),
        (0.12, low + 0.02),
        (0, low + 0.02),
    ]
    for x, z in ((w / 2 - 0.12, 0.06), (-w / 2 + 0.12, 0.06), (-w / 2 + 0.24, -0.82 * long)):
        parts.append(lathe(profile, role("legs"), (x, 0, z), 20))
    parts += [
        block((0.16, low, 0.08), role("legs"), (0, low / 2 + 0.06, -0.02), 0.02),
        block((0.26, 0.06, 0.2), GOLD, (0, 0.09, 0.03), 0.02),
    ]
    return parts


KINDS = (
    Kind(
        ("piano", "upright piano"),
        piano,
        {"body": ("brown", "black"), "trim": ("black", "brown")},
        {"trim": "{} trim"},
        weight=1.3,
    ),
    Kind(
        ("grand piano",),
        grand_piano,
        {"body": ("black",), "legs": ("black",)},
        {"legs": "{} legs"},
        weight=1.3,
    ),
)
