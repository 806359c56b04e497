"""A wrapped gift."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.household.plates import lying
from export.everyday_objects.data.shapes import (
    Part,
    both_sides,
    cushion,
    ellipsoid,
    moved,
    role,
    scaled,
    torus,
    turned,
)


def gift(rng: np.random.Generator) -> list[Part]:
    """A present: a box with a lid, a ribbon both ways around, a big bow."""
    w, h = rng.uniform(0.94, 1.04), rng.uniform(0.7, 0.85)
    top = h + 0.02
    loop = scaled(lying(torus(0.14, 0.062, role("ribbon", 0.92))), (1.4, 0.9, 1.8))
    bow = both_sides(moved(turned(loop, 2, 0.4), (0.27, top + 0.17, 0)))
    return [
        cushion((w, h, w), role("box"), (0, h / 2, 0), 14),
        cushion((w + 0.1, 0.24, w + 0.1), role("box", 0.9), (0, h - 0.09, 0), 12),
        cushion((0.2, h + 0.02, w + 0.05), role("ribbon"), (0, h / 2, 0), 16),
        cushion((w + 0.05, h + 0.02, 0.2), role("ribbon"), (0, h / 2, 0), 16),
        cushion((0.2, 0.28, w + 0.14), role("ribbon"), (0, h - 0.09, 0), 14),
        cushion((w + 0.14, 0.28, 0.2), role("ribbon"), (0, h - 0.09, 0), 14),
        *bow,
        *(turned(p, 1, np.pi / 2) for p in bow),
        ellipsoid((0.13, 0.12, 0.13), role("ribbon", 0.85), (0, top + 0.13, 0)),
    ]


KINDS = (
    Kind(("gift", "present", "gift box"), gift, {"box": ("red", "blue"), "ribbon": ("yellow", "white")},
         {"ribbon": "a {} ribbon"}, front=False),
)  # fmt: skip
