"""A bed."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.furniture.joinery import arched_outline, block
from export.everyday_objects.data.shapes import Part, both_sides, box, ellipsoid, extrude, moved, role, turned


def bed(rng: np.random.Generator) -> list[Part]:
    """A bed: headboard with a bow, footboard, mattress, one or two pillows, a blanket folded back."""
    w, long, head = rng.uniform(0.98, 1.14), rng.uniform(1.35, 1.46), rng.uniform(0.86, 0.96)
    posts, double = rng.random() < 0.5, rng.random() < 0.6
    front, back = long / 2, -long / 2
    parts = [
        moved(extrude(arched_outline(w, 0.1, head - 0.16, 0.16), 0.1, role("body")), (0, 0, back)),
        moved(
            extrude(arched_outline(w - 0.2, 0.3, head - 0.2, 0.1), 0.04, role("body", 0.8)),
            (0, 0, back + 0.05),
        ),
        moved(extrude(arched_outline(w, 0.1, 0.42, 0.07), 0.1, role("body")), (0, 0, front)),
        moved(
            extrude(arched_outline(w - 0.2, 0.17, 0.36, 0.05), 0.04, role("body", 0.8)), (0, 0, front + 0.05)
        ),
        box((w - 0.02, 0.16, long), role("body", 0.9), (0, 0.22, 0)),
        block((w - 0.08, 0.22, long - 0.1), role("pillows", 0.95), (0, 0.38, 0), 0.05),
        block((w + 0.03, 0.26, 0.6 * long), role("blanket"), (0, 0.42, front - 0.03 - 0.3 * long), 0.05),
        block((w + 0.06, 0.28, 0.18), role("blanket", 0.72), (0, 0.43, front - 0.03 - 0.6 * long), 0.06),
    ]
    for x in (-0.24 * w, 0.24 * w) if double else (0.0,):
        wide = 0.42 * w if double else 0.66 * w
        parts.append(
            turned(
                block((wide, 0.15, 0.34), role("pillows"), (x, 0.55, back + 0.26), 0.07),
                0,
                0.25,
                (0, 0.52, back + 0.25),
            )
        )
    for z, high in ((back, head - 0.08), (front, 0.44)):
        if posts:
            post = [
                block((0.13, high, 0.13), role("body", 0.9), (w / 2, high / 2, z), 0.02),
                ellipsoid(0.085, role("body"), (w / 2, high + 0.04, z)),
            ]
        else:
            post = [block((0.14, 0.2, 0.14), role("body", 0.85), (w / 2 - 0.09, 0.1, z), 0.02)]
        parts += both_sides(*post)
    return parts


KINDS = (
    Kind(
        ("bed",),
        bed,
        {"body": ("brown",), "blanket": ("blue", "red"), "pillows": ("white",)},
        {"blanket": "a {} blanket", "pillows": "{} pillows"},
        weight=1.5,
    ),
)
