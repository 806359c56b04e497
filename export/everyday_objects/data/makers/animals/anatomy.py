"""What animals share: legs, hooves, tails, eyes, ears."""

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
    both_sides,
    curve,
    ellipsoid,
    lathe,
    moved,
    scaled,
    turned,
)

Piece = Limb | Lump
"""Of a body that `blend` makes."""
CELL = 0.028
"""Of the grid that most skins are found on."""


def four_legs(
    x: float, back: float, front: float, top: float, thick: float, foot: float, paw: float = 0.0
) -> list[Piece]:
    """Four legs from height `top`; with `paw` > 0 feet of that radius that stick out in front."""
    pieces: list[Piece] = []
    for s in (-x, x):
        for z in (back, front):
            pieces.append(Limb((s, top, z), (s, 0.85 * foot, z), thick, foot))
            if paw:
                pieces.append(Lump((s, 0.06, z + 0.35 * paw), (paw, 0.075, 1.25 * paw)))
    return pieces


def four_hooves(x: float, back: float, front: float, radius: float, paint: Paint) -> list[Part]:
    """Four hooves, wider below."""
    profile = [(0, -0.02), (1.12 * radius, -0.02), (1.0 * radius, 0.11), (0, 0.11)]
    return [lathe(profile, paint, (s, 0, z), 20) for s in (-x, x) for z in (back, front)]


def paired(*pieces: Piece) -> list[Piece]:
    """The pieces and their mirror images at x = 0."""
    mirror = np.array([-1.0, 1.0, 1.0])
    result: list[Piece] = list(pieces)
    for p in pieces:
        if isinstance(p, Limb):
            result.append(p._replace(start=np.asarray(p.start) * mirror, end=np.asarray(p.end) * mirror))
        else:
            result.append(p._replace(at=np.asarray(p.at) * mirror))
    return result


def limbs_along(points: Sequence[Vector], radii: Sequence[float] | np.ndarray, count: int = 7) -> list[Piece]:
    """Limbs along a smooth curve: tails, trunks, horns."""
    path = curve(points, count)
    thick = np.interp(np.linspace(0, 1, count), np.linspace(0, 1, len(radii)), radii)
    return [Limb(path[i], path[i + 1], thick[i], thick[i + 1]) for i in range(count - 1)]


def nearest_on(skin: Part, at: Vector) -> np.ndarray:
    """The point of a skin nearest to `at`."""
    return skin.vertices[np.linalg.norm(skin.vertices - np.asarray(at), axis=1).argmin()]


def two_eyes(
    skin: Part, at: Vector, size: float, look: Vector = (0.35, 0.1, 1.0), iris: Paint | None = None
) -> list[Part]:
    """Two eyes on the skin near `at`: white, a large dark pupil towards `look`; a glint would not survive."""
    centre, ahead = nearest_on(skin, at), np.asarray(look) / np.linalg.norm(look)
    white = ellipsoid(size, iris or WHITE, centre - 0.45 * size * ahead)
    return both_sides(white, ellipsoid(0.72 * size, DARK, centre + 0.02 * size * ahead))


def two_ears(
    root: Vector, tip: Vector, width: float, paint: Paint, inner: Paint, pointed: bool = False
) -> list[Part]:
    """Two ears from root to tip, leaves or triangles, with an inner side in another paint."""
    start, way = np.asarray(root, float), np.subtract(tip, root)
    length = float(np.linalg.norm(way))
    leaf = [(0, 0), (0.72, 0.06), (0.98, 0.25), (1.0, 0.4), (0.8, 0.65), (0.42, 0.88), (0.15, 0.98), (0, 1)]
    if pointed:
        leaf = [(0, 0), (0.95, 0.06), (1.0, 0.2), (0.72, 0.48), (0.4, 0.76), (0.14, 0.96), (0, 1)]
    parts = []
    for scale, forward, colour in ((1.0, 0.0, paint), (0.62, 0.25, inner)):
        ear = lathe(
            [(width * scale * r, length * (0.6 * (1 - scale) + scale * h)) for r, h in leaf], colour, sides=20
        )
        ear = moved(scaled(ear, (1.0, 1.0, 0.5)), (0, 0, forward * width))
        ear = turned(turned(ear, 0, np.arcsin(way[2] / length)), 2, -np.arctan2(way[0], way[1]))
        parts.append(moved(ear, start))
    return both_sides(*parts)
