"""Small pieces, any way round: beads, leaves, tubes along a path."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.shapes import Paint, Part, Vector, lathe, moved, scaled, tube


def bead(radii: Vector | float, paint: Paint, at: Vector = (0.0, 0.0, 0.0)) -> Part:
    """A small ellipsoid of few faces."""
    t = np.linspace(0, np.pi, 9)
    return moved(scaled(lathe(list(zip(np.sin(t), np.cos(t), strict=True)), paint, sides=14), radii), at)


def aimed(part: Part, direction: Vector, at: Vector = (0.0, 0.0, 0.0)) -> Part:
    """The part turned so that its y axis points in a direction, then moved."""
    up = np.asarray(direction, np.float64) / np.linalg.norm(direction)
    side = np.cross(up, (0, 0, 1.0) if abs(up[2]) < 0.9 else (1.0, 0, 0))
    side /= np.linalg.norm(side)
    return part._replace(vertices=part.vertices @ np.stack([side, up, np.cross(side, up)]) + np.asarray(at))


def sweep(
    path: np.ndarray, radii: Sequence[float] | np.ndarray | float, paint: Paint, sides: int = 14
) -> Part:
    """A tube along an (n, 3) path, one radius each or one for all."""
    return tube(list(path), np.broadcast_to(radii, len(path)).tolist(), paint, sides)


def stout_leaf(length: float, paint: Paint, direction: Vector, at: Vector) -> Part:
    """A stout leaf from a point in a direction."""
    return aimed(
        moved(bead((length * 0.3, length / 2, length * 0.12), paint), (0, length / 2, 0)), direction, at
    )
