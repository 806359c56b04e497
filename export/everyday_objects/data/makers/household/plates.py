"""Plates of an outline, flat or on the skin of a body."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.shapes import Paint, Part, curve, extrude, grid_faces, turned


def smooth_loop(points: Sequence[tuple[float, float]], steps: int = 6) -> np.ndarray:
    """A smooth closed outline through points, `steps` between two of them."""
    path = [np.array(p) for p in (points[-1], *points, points[0], points[1])]
    return curve(path, (len(points) + 2) * steps + 1)[steps : -2 * steps]


def mirrored(half: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """A closed outline from its right half, which begins and ends at x = 0."""
    return [*half, *((-x, y) for x, y in half[-2:0:-1])]


def pillow(
    outline: Sequence[tuple[float, float]] | np.ndarray, thickness: float, edge: float, paint: Paint
) -> Part:
    """A plate of an outline in x and y, centred in z, with rounded edges."""
    flat = np.asarray(outline, np.float64)
    along = np.roll(flat, -1, 0) - np.roll(flat, 1, 0)
    out = np.stack([along[:, 1], -along[:, 0]], -1) / (np.linalg.norm(along, axis=1, keepdims=True) + 1e-9)
    x, y = flat.T
    out *= np.sign((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    t = np.linspace(0, np.pi / 2, 4)
    rings = [(edge * (1 - np.sin(a)), thickness / 2 - edge * (1 - np.cos(a))) for a in t]
    rings = [*((i, -z) for i, z in rings), *rings[::-1]]
    layers = [np.column_stack([flat - inset * out, np.full(len(flat), z)]) for inset, z in rings]
    lid = extrude(layers[0][:, :2].tolist(), 1.0, paint).faces
    lid = lid[: (len(lid) - 2 * len(flat)) // 2]
    faces = [grid_faces(len(rings), len(flat)), lid, lid + (len(rings) - 1) * len(flat)]
    return Part(np.concatenate(layers), np.concatenate(faces), paint)


def lying(part: Part) -> Part:
    """A plate in x and y laid down: its y becomes z."""
    return turned(part, 0, np.pi / 2)


def surface_at(part: Part, points: np.ndarray, axis: int = 2) -> np.ndarray:
    """The greatest coordinate of a part along an axis above (n, 2) points of the other two.

    Where nothing is there: the least of them.
    """
    others = [k for k in range(3) if k != axis]
    corners = part.vertices[part.faces]
    flat = corners[:, :, others]
    low, high = flat.min(1), flat.max(1)
    result = np.full(len(points), np.nan)
    for i, p in enumerate(points):
        near = ((low <= p) & (p <= high)).all(axis=1)
        (a, b, c), z = flat[near].swapaxes(0, 1), corners[near][:, :, axis]
        if not near.any():
            continue
        area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] + 1e-15
        u = ((p - a)[:, 0] * (c - a)[:, 1] - (p - a)[:, 1] * (c - a)[:, 0]) / area
        v = ((b - a)[:, 0] * (p - a)[:, 1] - (b - a)[:, 1] * (p - a)[:, 0]) / area
        hit = (u >= -1e-6) & (v >= -1e-6) & (u + v <= 1 + 1e-6)
        if hit.any():
            result[i] = (z[:, 0] * (1 - u - v) + z[:, 1] * u + z[:, 2] * v)[hit].max()
    return np.where(np.isnan(result), np.nanmin(result), result)


def patch_on_front(outline: Sequence[tuple[float, float]], body: Part, paint: Paint) -> Part:
    """A patch of an outline in x and y on the front of a body, a little above its skin, with walls."""
    lift = 0.02
    plate = extrude(outline, 1.0, paint)
    count = len(outline)
    faces = plate.faces[: (len(plate.faces) - 2 * count) // 2]
    flat, rim = plate.vertices[:count, :2], np.arange(count)
    while np.linalg.norm(flat[faces] - flat[np.roll(faces, 1, 1)], axis=-1).max() > 0.07:
        edges = np.sort(np.stack([faces, np.roll(faces, -1, 1)], -1).reshape(-1, 2), 1)
        edges, which = np.unique(edges, axis=0, return_inverse=True)
        m = which.reshape(-1, 3) + len(flat)
        middle = {tuple(e): i + len(flat) for i, e in enumerate(edges.tolist())}
        after = np.roll(rim, -1)
        rim = np.stack(
            [rim, [middle[min(a, b), max(a, b)] for a, b in zip(rim, after, strict=True)]], -1
        ).ravel()
        flat = np.concatenate([flat, flat[edges].mean(1)])
        a, b, c = faces.T
        faces = np.concatenate(
            [
                np.stack(t, -1)
                for t in (
                    (a, m[:, 0], m[:, 2]),
                    (b, m[:, 1], m[:, 0]),
                    (c, m[:, 2], m[:, 1]),
                    (m[:, 0], m[:, 1], m[:, 2]),
                )
            ]
        )
    top = np.column_stack([flat, surface_at(body, flat) + lift])
    foot = top[rim] - (0, 0, lift + 0.05)
    i, k = np.arange(len(rim)), len(flat)
    j = np.roll(i, -1)
    walls = [np.stack([rim[i], rim[j], i + k], -1), np.stack([rim[j], j + k, i + k], -1)]
    return Part(np.concatenate([top, foot]), np.concatenate([faces, *walls]), paint)
