"""What creatures share: fins, tails, eyes, spikes, patches."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.shapes import (
    DARK,
    WHITE,
    Limb,
    Lump,
    Paint,
    Part,
    Vector,
    bar,
    both_sides,
    curve,
    ellipsoid,
    fixed,
    grid_faces,
    inside,
    tube,
    turned,
)

MOUTH = fixed(0.45, 0.06, 0.08)
"""Inside of it, and a smile."""


def pillow(outline: Sequence[tuple[float, float]], thickness: float, paint: Paint) -> Part:
    """A pillow over a polygon in x, y (star-shaped about its middle, its corners rounded): fins, wings."""
    flat = np.asarray(outline, np.float64)
    for _ in range(2):
        after = np.roll(flat, -1, axis=0)
        flat = np.stack([0.75 * flat + 0.25 * after, 0.25 * flat + 0.75 * after], 1).reshape(-1, 2)
    middle = flat.mean(0)
    rows = []
    for angle in np.linspace(-np.pi / 2, np.pi / 2, 11):
        ring = np.zeros((len(flat), 3))
        ring[:, :2] = middle + np.cos(angle) ** 0.6 * (flat - middle)
        ring[:, 2] = thickness / 2 * np.sin(angle)
        rows.append(ring)
    return Part(np.concatenate(rows), grid_faces(len(rows), len(flat)), paint)


def sideways(part: Part) -> Part:
    """A part drawn in x, y stood into the plane x = 0: its x runs to the front (+z)."""
    return turned(part, 1, -np.pi / 2)


def curl(points: Sequence[Vector], radii: Sequence[float], paint: Paint) -> Part:
    """A smooth round tube through points with a radius each: tails, arms, necks."""
    count = 5 * len(points)
    thick = np.interp(np.linspace(0, len(points) - 1, count), range(len(points)), radii)
    return tube(list(curve(points, count)), list(thick), paint, 18)


def beady_eyes(at: Vector, size: float) -> list[Part]:
    """Two beady eyes; `at` is the left one's place."""
    return both_sides(ellipsoid((size, size * 1.1, size * 0.7), DARK, at))


def big_eyes(at: Vector, size: float, look: Vector) -> list[Part]:
    """Two white eyeballs with large pupils towards `look` (of the left one)."""
    towards = np.asarray(look) / np.linalg.norm(look)
    pupil = np.asarray(at) + towards * size * 0.52
    glint = np.asarray(at) + (towards + (0.16, 0.3, 0.0)) * size * 0.93
    return both_sides(
        ellipsoid(size, WHITE, at), ellipsoid(size * 0.64, DARK, pupil), ellipsoid(size * 0.2, WHITE, glint)
    )


def spike(at: Vector, tip: Vector, radius: float, paint: Paint) -> Part:
    """A cone between two points, its tip rounded a little: spikes, horns, beaks, teeth."""
    return bar(at, tip, radius, paint, 0.12, 18)


def patch(part: Part, where: Sequence[Limb | Lump], paint: Paint) -> list[Part]:
    """As `repaint`, but with a clean seam: faces across the border of the pieces are cut along it."""
    hit = inside(part.vertices, where)
    count = hit[part.faces].sum(1)
    mixed = part.faces[(count == 1) | (count == 2)]
    odd = np.where((hit[mixed].sum(1) == 1)[:, None], hit[mixed], ~hit[mixed]).argmax(1)
    a, b, c = (mixed[np.arange(len(mixed)), (odd + k) % 3] for k in range(3))
    edges, index = np.unique(
        np.sort(np.concatenate([np.stack([a, b], 1), np.stack([a, c], 1)]), 1), axis=0, return_inverse=True
    )
    low, high = part.vertices[edges[:, 0]], part.vertices[edges[:, 1]]
    for _ in range(7):
        middle = (low + high) / 2
        same = (inside(middle, where) == hit[edges[:, 0]])[:, None]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    p, q = (len(part.vertices) + index.reshape(-1)).reshape(2, -1)
    faces = np.concatenate(
        [
            part.faces[(count == 0) | (count == 3)],
            np.stack([a, p, q], 1),
            np.stack([p, b, c], 1),
            np.stack([p, c, q], 1),
        ]
    )
    within = np.concatenate([count[(count == 0) | (count == 3)] == 3, hit[a], ~hit[a], ~hit[a]])
    points = np.concatenate([part.vertices, (low + high) / 2])
    return [Part(points, faces[~within], part.paint), Part(points, faces[within], paint)]
