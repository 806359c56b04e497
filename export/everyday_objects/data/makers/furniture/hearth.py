"""Light and warmth: a table lamp and a fireplace."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.furniture.joinery import block, evenly
from export.everyday_objects.data.shapes import (
    LAMP,
    WOOD,
    Part,
    bar,
    both_sides,
    box,
    extrude,
    fixed,
    frustum,
    lathe,
    role,
    torus,
)

_SOOT = fixed(0.09, 0.08, 0.08)


def lamp(rng: np.random.Generator) -> list[Part]:
    """A table lamp: a big shade with a warm inside over a round, stout foot."""
    wide, narrow, tall = rng.uniform(0.42, 0.48), rng.uniform(0.24, 0.3), rng.uniform(0.46, 0.54)
    ball = rng.random() < 0.5
    y = 0.56
    shade = [(wide - 0.03, y), (wide, y), (narrow, y + tall), (narrow - 0.03, y + tall)]
    parts = [
        lathe(shade, role("shade"), sides=40),
        lathe([(0, y + 0.05), (wide - 0.03, y + 0.02), (wide - 0.03, y)], LAMP, sides=40),
        lathe(
            [(0, y + tall - 0.03), (narrow - 0.03, y + tall - 0.03), (narrow - 0.03, y + tall)],
            LAMP,
            sides=40,
        ),
        torus(wide - 0.005, 0.03, role("base"), (0, y, 0)),
        torus(narrow, 0.03, role("base"), (0, y + tall, 0)),
    ]
    foot = [(0, 0), (0.28, 0), (0.29, 0.03), (0.27, 0.07), (0.12, 0.09)]
    if ball:
        t = np.linspace(0.35, np.pi - 0.3, 12)[::-1]
        foot += [(0.22 * np.sin(a), 0.29 + 0.22 * np.cos(a)) for a in t]
    else:
        foot += [(0.11, 0.12), (0.16, 0.2), (0.19, 0.3), (0.17, 0.4), (0.09, 0.48)]
    return [*parts, lathe([*foot, (0.07, 0.52), (0.07, y + 0.06)], role("base"))]


def fireplace(rng: np.random.Generator) -> list[Part]:
    """A fireplace: a stone surround with a mantel and a chimney breast, a hearth, logs and a fire."""
    w, tall, d = rng.uniform(1.25, 1.4), rng.uniform(0.94, 1.02), rng.uniform(0.44, 0.5)
    chimney, arch = rng.uniform(0.28, 0.36), rng.random() < 0.5
    hole, lintel = 0.76, 0.72
    t = np.linspace(0, np.pi, 11)
    top = (
        [(hole / 2 * np.cos(a), lintel - 0.16 + 0.18 * np.sin(a)) for a in t]
        if arch
        else [(hole / 2, lintel), (-hole / 2, lintel)]
    )
    outline = [
        (-w / 2, 0.08),
        (-w / 2, tall),
        (w / 2, tall),
        (w / 2, 0.08),
        (hole / 2, 0.08),
        *top,
        (-hole / 2, 0.08),
    ]
    parts = [
        extrude(outline, d, role("body")),
        box((hole + 0.1, lintel + 0.06, 0.06), _SOOT, (0, lintel / 2 + 0.06, -d / 2 + 0.06)),
        box((w - 0.04, tall - 0.1, 0.05), role("body", 0.9), (0, tall / 2 + 0.04, -d / 2)),
        block((w + 0.14, 0.11, d + 0.4), role("body", 0.72), (0, 0.055, 0.13), 0.02),
        block((w + 0.16, 0.12, d + 0.16), role("mantel"), (0, tall + 0.05, 0.03), 0.03),
        frustum(
            (w - 0.2, d - 0.06), (w - 0.45, d - 0.14), chimney, role("body"), (0, tall + 0.1, -0.03), -0.03
        ),
        block((w - 0.35, 0.1, d - 0.04), role("mantel"), (0, tall + 0.1 + chimney, -0.06), 0.03),
    ]
    stones = []
    for k, y in enumerate(evenly(4, tall - 0.1) + tall / 2 + 0.04):
        wide = 0.23 if k % 2 else 0.17
        tone = role("body", (0.84, 1.12)[k % 2])
        stones.append(
            block((wide, (tall - 0.1) / 4 - 0.03, d + 0.02), tone, (w / 2 - wide / 2 + 0.03, y, 0.03), 0.02)
        )
    stone = block((0.17, 0.2, 0.08), role("body", 0.84), (0, tall - 0.12, d / 2 - 0.01), 0.02)
    parts += [*both_sides(*stones), stone]
    parts += [
        bar((x, y, 0.02 + z), (-x, y, z + 0.1), 0.06, WOOD)
        for x, y, z in ((0.25, 0.17, -0.02), (-0.25, 0.2, -0.04))
    ]
    flame = [(0, 0), (0.75, 0.12), (1, 0.3), (0.8, 0.52), (0.38, 0.78), (0, 1)]
    for x, z, r, high, paint in (
        (0, -0.06, 0.19, 0.54, fixed(0.96, 0.36, 0.07)),
        (0.19, -0.04, 0.13, 0.36, fixed(0.96, 0.36, 0.07)),
        (-0.19, -0.04, 0.13, 0.4, fixed(0.96, 0.36, 0.07)),
        (0.03, 0.06, 0.13, 0.34, fixed(1.0, 0.8, 0.2)),
        (-0.13, 0.08, 0.08, 0.2, fixed(1.0, 0.8, 0.2)),
    ):
        parts.append(lathe([(r * a, high * b) for a, b in flame], paint, (x, 0.15, z), 16))
    return parts


KINDS = (
    Kind(
        ("lamp", "table lamp"),
        lamp,
        {"shade": ("yellow", "beige"), "base": ("brown", "blue")},
        {"base": "a {} base"},
        front=False,
    ),
    Kind(
        ("fireplace",),
        fireplace,
        {"body": ("grey", "beige"), "mantel": ("brown", "white")},
        {"mantel": "a {} mantel"},
    ),
)
