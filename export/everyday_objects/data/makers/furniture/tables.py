"""Tables: a dining table and a desk."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.furniture.joinery import block, evenly, four_legs, knob
from export.everyday_objects.data.shapes import Part, box, moved, role


def table(rng: np.random.Generator) -> list[Part]:
    """A table: a thick top, an apron, four stout legs."""
    w, d, tall = rng.uniform(1.2, 1.4), rng.uniform(0.8, 0.92), rng.uniform(0.72, 0.84)
    square = bool(rng.random() < 0.6)
    parts = [block((w, 0.11, d), role("body"), (0, tall - 0.055, 0), 0.035)]
    parts.append(block((w - 0.2, 0.04, d - 0.2), role("body", 1.12), (0, tall - 0.01, 0), 0.01))
    parts.append(block((w - 0.16, 0.13, d - 0.16), role("body", 0.85), (0, tall - 0.16, 0), 0.01))
    return parts + four_legs(w / 2 - 0.1, d / 2 - 0.1, tall - 0.08, 0.14, role("legs"), square)


def desk(rng: np.random.Generator) -> list[Part]:
    """A writing desk: a thick top over drawers at one side or both, a knee hole, a panel behind."""
    w, d, tall = rng.uniform(1.3, 1.45), rng.uniform(0.68, 0.76), rng.uniform(0.8, 0.88)
    double = rng.random() < 0.6
    wide, under = 0.42, tall - 0.09
    parts = [
        block((w, 0.11, d), role("body"), (0, tall - 0.05, 0), 0.03),
        box((w - 0.14, 0.5, 0.06), role("body", 0.8), (0, under - 0.25, -d / 2 + 0.12)),
        box((w - 0.14, 0.13, d - 0.2), role("body", 0.85), (0, under - 0.06, -0.02)),
    ]
    chest: list[Part] = [block((wide, under, d - 0.1), role("body", 0.85), (0, under / 2, 0), 0.015)]
    for y in evenly(3, under - 0.12) + under / 2 + 0.02:
        chest += [
            block((wide - 0.08, 0.17, 0.06), role("drawers"), (0, y, d / 2 - 0.04), 0.02),
            knob((0, y, d / 2 + 0.01), 0.04),
        ]
    parts += [moved(p, (w / 2 - wide / 2 - 0.05, 0, 0)) for p in chest]
    if double:
        return parts + [moved(p, (-w / 2 + wide / 2 + 0.05, 0, 0)) for p in chest]
    return parts + [
        block((0.12, under, 0.12), role("body", 0.85), (-w / 2 + 0.12, under / 2, z * (d / 2 - 0.12)), 0.015)
        for z in (-1, 1)
    ]


KINDS = (
    Kind(("table",), table, {"body": ("brown",), "legs": ("brown", "beige")}, {"legs": "{} legs"}),
    Kind(("desk",), desk, {"body": ("brown",), "drawers": ("beige", "white")}, {"drawers": "{} drawers"}),
)
