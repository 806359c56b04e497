"""Parts turned and placed: against a wall, around an axis."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.shapes import Part, Vector, moved, turned


def facing(parts: Sequence[Part], angle: float, at: Vector) -> list[Part]:
    """Parts that face +z at the origin, turned about y by `angle` [rad] and moved."""
    return [moved(turned(p, 1, angle), at) for p in parts]


def ring_of(parts: Sequence[Part], count: int, phase: float = 0.0, axis: int = 1) -> list[Part]:
    """`count` copies of parts, evenly around an axis."""
    return [turned(p, axis, phase + 2 * np.pi * i / count) for i in range(count) for p in parts]
