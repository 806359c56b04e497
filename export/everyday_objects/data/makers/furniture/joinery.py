"""What furniture is made of: rounded blocks, panels, legs, knobs."""

import numpy as np

from export.everyday_objects.data.shapes import GOLD, Paint, Part, Vector, bar, ellipsoid, grid_faces


def block(size: Vector, paint: Paint, at: Vector = (0.0, 0.0, 0.0), bevel: float = 0.03) -> Part:
    """A box whose edges and corners are rounded with the radius `bevel`, `at` its centre."""
    half = np.asarray(size) / 2
    r = min(bevel, *(0.98 * half))
    quarter = np.linspace(0, np.pi / 2, 4)
    rows = [np.tile((0, half[1], 0), (16, 1))]
    for sign, polar in [(1, t) for t in quarter] + [(-1, t + np.pi / 2) for t in quarter]:
        for turn in range(4):
            a = turn * np.pi / 2 + quarter
            x, z = np.cos(a), np.sin(a)
            sx, sz = ((1, 1), (-1, 1), (-1, -1), (1, -1))[turn]
            row = np.stack(
                [
                    sx * (half[0] - r) + r * np.sin(polar) * x,
                    np.full(4, sign * (half[1] - r) + r * np.cos(polar)),
                    sz * (half[2] - r) + r * np.sin(polar) * z,
                ],
                -1,
            )
            rows.append(row)
    rows.append(np.tile((0, -half[1], 0), (16, 1)))
    return Part(np.concatenate(rows) + at, grid_faces(10, 16), paint)


def evenly(count: int, span: float) -> np.ndarray:
    """Centres of `count` equal places side by side in a width `span` about 0."""
    return (np.arange(count) + 0.5) / count * span - span / 2


def arched_outline(width: float, foot: float, shoulder: float, rise: float) -> list[tuple[float, float]]:
    """Outline of an upright panel from `foot` to `shoulder`, a bow `rise` higher on top."""
    t = np.linspace(0, np.pi, 15)
    bow = [(width / 2 * np.cos(a), shoulder + rise * np.sin(a) ** 0.8) for a in t]
    return [(-width / 2, foot), (width / 2, foot), *bow]


def four_legs(
    x: float, z: float, height: float, thick: float, paint: Paint, square: bool, splay: float = 0.0
) -> list[Part]:
    """Four legs from the ground up, under (+-x, height, +-z); square or round, thinner at the foot."""
    parts = []
    for sx, sz in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        if square:
            parts.append(block((thick, height, thick), paint, (sx * x, height / 2, sz * z), 0.015))
        else:
            parts.append(
                bar(
                    (sx * x, height, sz * z),
                    (sx * (x + splay), 0, sz * (z + splay)),
                    0.58 * thick,
                    paint,
                    0.7,
                )
            )
    return parts


def knob(at: Vector, radius: float) -> Part:
    """A round brass knob on a front."""
    return ellipsoid((radius, radius, 0.8 * radius), GOLD, at)
