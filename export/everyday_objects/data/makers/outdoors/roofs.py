"""Gables and the roofs over them."""

import numpy as np

from export.everyday_objects.data.shapes import Paint, Part, Vector, bar, both_sides, extrude, moved, role


def gable_roof(
    width: float,
    depth: float,
    height: float,
    at: Vector,
    thickness: float = 0.07,
    rows: int = 3,
) -> list[Part]:
    """Two slopes of overlapping rows of tiles, the ridge along z; `at` the centre of the eaves' level."""
    eave, ridge = np.array([width / 2, 0.0]), np.array([0.0, height])
    normal = np.array([height, width / 2]) / np.hypot(height, width / 2)
    parts = []
    for k in range(rows):
        low, high = eave + (ridge - eave) * k / rows, eave + (ridge - eave) * min((k + 1.25) / rows, 1)
        quad = [
            low - 0.02 * normal,
            low + thickness * normal,
            high + 0.45 * thickness * normal,
            high - 0.02 * normal,
        ]
        slab = extrude([(float(x), float(y)) for x, y in quad], depth, role("roof", 1.0 if k % 2 else 0.86))
        parts += both_sides(slab)
    top = height + 0.35 * thickness
    parts.append(
        bar(
            (0, top, -depth / 2 - 0.01),
            (0, top, depth / 2 + 0.01),
            0.6 * thickness,
            role("roof", 0.75),
            sides=8,
        )
    )
    return [moved(p, at) for p in parts]


def gable_block(width: float, wall: float, rise: float, depth: float, paint: Paint) -> Part:
    """A block with gables to +z and -z, standing on y = 0."""
    w = width / 2
    return extrude([(-w, 0), (w, 0), (w, wall), (0, wall + rise), (-w, wall)], depth, paint)
