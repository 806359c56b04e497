"""Outlines of vehicles from the side."""

import numpy as np

Outline = list[tuple[float, float]]
"""A polygon; which plane it lies in is up to `slab`."""


def polygon(*corners: tuple[float, ...]) -> Outline:
    """A polygon of corners (first, second) or, rounded, (first, second, how much of each edge is cut off)."""
    points: Outline = []
    for i, corner in enumerate(corners):
        p = np.array(corner[:2])
        if len(corner) == 2:
            points.append((corner[0], corner[1]))
            continue
        a, b = np.array(corners[i - 1][:2]) - p, np.array(corners[(i + 1) % len(corners)][:2]) - p
        la, lb = np.linalg.norm(a), np.linalg.norm(b)
        a, b = p + a / la * min(corner[2], 0.49 * la), p + b / lb * min(corner[2], 0.49 * lb)
        for t in np.linspace(0, 1, 6):
            x, y = (1 - t) ** 2 * a + 2 * t * (1 - t) * p + t**2 * b
            points.append((float(x), float(y)))
    return points


def rectangle(first: tuple[float, float], second: tuple[float, float], cut: float = 0.06) -> Outline:
    """A rectangle with rounded corners, from `first` (low, high) and `second` (low, high)."""
    (a, b), (c, d) = first, second
    return polygon((a, c, cut), (b, c, cut), (b, d, cut), (a, d, cut))


def wheel_arch(z: float, y: float, radius: float, sill: float) -> Outline:
    """A wheel arch cut into the lower edge of an outline that comes from the front."""
    t = np.linspace(0, np.pi, 13)
    arc = [(z + radius * float(np.cos(a)), y + radius * float(np.sin(a))) for a in t]
    return [(z + radius, sill), *arc, (z - radius, sill)]


def ring_piece(z: float, y: float, inner: float, outer: float, start: float, end: float) -> Outline:
    """A piece of a ring, as a mudguard: from one angle [rad] to another, 0 at +z, pi/2 on top."""
    t = np.linspace(start, end, 14)
    away = [(z + outer * float(np.cos(a)), y + outer * float(np.sin(a))) for a in t]
    back = [(z + inner * float(np.cos(a)), y + inner * float(np.sin(a))) for a in t[::-1]]
    return away + back
