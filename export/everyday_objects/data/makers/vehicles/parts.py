"""What vehicles share: slabs, wheels, lamps."""

from collections.abc import Sequence

import mapbox_earcut
import numpy as np

from export.everyday_objects.data.shapes import (
    Paint,
    Part,
    Vector,
    both_sides,
    fixed,
    grid_faces,
    lathe,
    moved,
    turned,
)

CHASSIS = fixed(0.16, 0.16, 0.18)
"""Of frames, bumpers and engines."""
HUB = fixed(0.8, 0.81, 0.83)
"""Of the discs in wheels."""
OUT = 0.035
"""How far windows, patches and stripes stick out of what they are on, for things about 2 long."""


def slab(
    outline: Sequence[tuple[float, float]],
    thickness: float,
    paint: Paint,
    axis: int = 0,
    at: Vector = (0.0, 0.0, 0.0),
    edge: float = 0.05,
) -> Part:
    """An extruded outline with rounded edges; its coordinates are z, y for axis 0; x, z for 1; x, y for 2."""
    flat = np.asarray(outline, np.float64)
    after = np.roll(flat, -1, 0)
    if (flat[:, 0] * after[:, 1] - flat[:, 1] * after[:, 0]).sum() < 0:
        flat = flat[::-1]
    along = np.roll(flat, -1, 0) - flat
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-12
    inward = np.stack([-along[:, 1], along[:, 0]], -1)
    mitre = inward + np.roll(inward, 1, 0)
    mitre /= np.maximum((mitre**2).sum(1, keepdims=True) / 2, 0.5)
    edge = min(edge, 0.49 * thickness)
    bend = np.linspace(0, np.pi / 2, 4)
    steps = [(edge * (1 - np.sin(a)), -thickness / 2 + edge * (1 - np.cos(a))) for a in bend]
    steps += [(inset, -place) for inset, place in steps[::-1]]
    first, second = {2: (0, 1), 0: (2, 1), 1: (0, 2)}[axis]
    n = len(flat)
    points = np.zeros((len(steps), n, 3))
    for row, (inset, place) in zip(points, steps, strict=True):
        row[:, [first, second]] = flat + inset * mitre
        row[:, axis] = place
    lid = mapbox_earcut.triangulate_float64(points[0][:, [first, second]].copy(), np.array([n], np.uint32))
    lid = lid.reshape(-1, 3).astype(int)
    faces = np.concatenate([lid, lid[:, ::-1] + n * (len(steps) - 1), grid_faces(len(steps), n)])
    return Part(points.reshape(-1, 3) + at, faces, paint)


def narrowed(parts: Sequence[Part], low: float, high: float, factor: float) -> list[Part]:
    """The parts made narrower in x from height `low` to `factor` times as wide at `high`."""
    result = []
    for part in parts:
        v = part.vertices.copy()
        v[:, 0] *= 1 + (factor - 1) * np.clip((v[:, 1] - low) / (high - low), 0, 1.3)
        result.append(part._replace(vertices=v))
    return result


def one_wheel(at: Vector, radius: float, width: float, tyre: Paint, hub: Paint = HUB) -> list[Part]:
    """A wheel whose axle lies along x: a thick tyre, a disc in it."""
    r, w = radius, width / 2
    half = [(0.0, w * 0.7), (0.56 * r, w * 0.7), (0.64 * r, w), (0.86 * r, w), (r, 0.6 * w)]
    cap = [(0.0, 1.1 * w), (0.24 * r, 1.08 * w), (0.3 * r, 0.9 * w), (0.58 * r, 0.86 * w), (0.6 * r, 0.5 * w)]
    parts = [
        lathe(half + [(x, -y) for x, y in half[::-1]], tyre),
        lathe(cap + [(x, -y) for x, y in cap[::-1]], hub),
    ]
    return [moved(turned(p, 2, np.pi / 2), at) for p in parts]


def wheel_pairs(
    places: Sequence[tuple[float, float]], x: float, width: float, tyre: Paint, hub: Paint = HUB
) -> list[Part]:
    """Wheels on both sides, one pair for each (z, radius); they stand on y = 0."""
    parts = []
    for z, radius in places:
        parts += both_sides(*one_wheel((x, radius, z), radius, width, tyre, hub))
    return parts


def disc(at: Vector, radius: float, depth: float, paint: Paint, axis: int = 2) -> Part:
    """A round lamp or patch with soft edges that faces along an axis."""
    profile = [(0.0, depth / 2), (0.8 * radius, depth / 2), (radius, 0.2 * depth)]
    part = lathe(profile + [(r, -y) for r, y in profile[::-1]], paint, sides=24)
    part = {0: turned(part, 2, np.pi / 2), 1: part, 2: turned(part, 0, np.pi / 2)}[axis]
    return moved(part, at)
