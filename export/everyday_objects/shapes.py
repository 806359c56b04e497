"""Parts that procedural objects are assembled from: surfaces of revolution, boxes, cushions, ellipsoids, each
with one flat colour; y up, front to +z.
"""

import numpy as np

from export.everyday_objects.captions import draw_colour
from export.everyday_objects.catalogue import Model, fit

Vector = tuple[float, float, float] | np.ndarray
Part = tuple[np.ndarray, np.ndarray, np.ndarray]  # vertices, faces, RGB


def assemble(parts: list[Part]) -> Model:
    """Join parts into one untextured model."""
    starts = np.cumsum([0] + [len(p[0]) for p in parts])
    vertices = fit(np.concatenate([p[0] for p in parts]))
    return Model(
        vertices,
        np.concatenate([p[1] + s for p, s in zip(parts, starts, strict=False)]).astype(np.int32),
        np.zeros((len(vertices), 2), np.float32),
        np.repeat(np.arange(len(parts), dtype=np.int32), [len(p[1]) for p in parts]),
        np.array([[*p[2], 1.0] for p in parts], np.float32),
        np.zeros(len(parts), bool),
        np.zeros((1, 1, 1, 4), np.uint8),
        tuple(f"part{i}" for i in range(len(parts))),
    )


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Triangles of a (rows, columns) vertex grid that closes around its columns."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = a + columns, b + columns
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([b, d, c], -1).reshape(-1, 3)])


def lathe(
    profile: list[tuple[float, float]], colour: np.ndarray, at: Vector = (0.0, 0.0, 0.0), sides: int = 40
) -> Part:
    """Turn a polyline of (radius, height) about the y axis."""
    radius, height = np.asarray(profile, np.float64).T
    angle = np.arange(sides) * 2 * np.pi / sides
    x, z = np.outer(radius, np.sin(angle)), np.outer(radius, np.cos(angle))
    y = np.repeat(height[:, None], sides, 1)
    return np.stack([x, y, z], -1).reshape(-1, 3) + at, grid_faces(len(profile), sides), colour


def ellipsoid(
    radii: Vector, colour: np.ndarray, at: Vector = (0.0, 0.0, 0.0), top: float = 0.0, bottom: float = np.pi
) -> Part:
    """An ellipsoid (or the zone of it between two polar angles)."""
    t = np.linspace(top, bottom, 24)
    vertices, faces, _ = lathe(list(zip(np.sin(t), np.cos(t), strict=True)), colour)
    return vertices * np.asarray(radii) + at, faces, colour


def box(size: Vector, colour: np.ndarray, at: Vector = (0.0, 0.0, 0.0)) -> Part:
    """An axis-parallel box, `at` its centre."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
             [0, 2, 6], [0, 6, 4],
             [1, 5, 7], [1, 7, 3]]  # fmt: skip
    return corners * np.asarray(size) + at, np.array(faces), colour


def cushion(size: Vector, colour: np.ndarray, at: Vector = (0.0, 0.0, 0.0), roundness: float = 6.0) -> Part:
    """A box with rounded edges, `at` its centre: the unit ball of the p-norm, p = `roundness`."""
    vertices, faces, _ = ellipsoid((1.0, 1.0, 1.0), colour)
    norm = (np.abs(vertices) ** roundness).sum(axis=1, keepdims=True) ** (1 / roundness)
    return vertices / norm * np.asarray(size) / 2 + at, faces, colour


def bar(start: Vector, end: Vector, radius: float, colour: np.ndarray, taper: float = 1.0) -> Part:
    """A round bar between two points, `taper` times as thick at its end; closed."""
    first, last = np.asarray(start, np.float64), np.asarray(end, np.float64)
    length = float(np.linalg.norm(last - first))
    vertices, faces, _ = lathe([(0, 0), (radius, 0), (radius * taper, length), (0, length)], colour, sides=12)
    up = (last - first) / length
    side = np.cross(up, (1.0, 0, 0) if abs(up[0]) < 0.9 else (0, 1.0, 0))
    side /= np.linalg.norm(side)
    frame = np.stack([side, up, np.cross(side, up)], axis=1)
    return vertices @ frame.T + first, faces, colour


def frustum(
    lower: tuple[float, float],
    upper: tuple[float, float],
    height: float,
    colour: np.ndarray,
    at: Vector,
    lean: float = 0.0,
) -> Part:
    """A box whose top (width, depth) differs from its bottom, the top moved by `lean` along z; `at` the
    centre of its bottom.
    """
    vertices, faces, _ = box((1.0, 1.0, 1.0), colour)
    top = vertices[:, 1] > 0
    scale = np.where(top[:, None], np.asarray(upper), np.asarray(lower))
    placed = np.stack(
        [vertices[:, 0] * scale[:, 0], top * height, vertices[:, 2] * scale[:, 1] + top * lean], -1
    )
    return placed + at, faces, colour


def torus(
    major: float,
    minor: float,
    colour: np.ndarray,
    arc: tuple[float, float] = (0.0, 2 * np.pi),
    at: Vector = (0.0, 0.0, 0.0),
    squash: float = 1.0,
) -> Part:
    """A ring about the y axis, or the arc of its tube between two angles of the tube."""
    t = np.linspace(arc[0], arc[1], 28)
    return lathe([(major + minor * np.cos(a), squash * minor * np.sin(a)) for a in t], colour, at, 56)


def tilt(part: Part, axis: int, angle: float) -> Part:
    """Turn a part about a coordinate axis through the origin."""
    i, j = [k for k in range(3) if k != axis]
    rotation = np.eye(3)
    rotation[i, i] = rotation[j, j] = np.cos(angle)
    rotation[i, j], rotation[j, i] = -np.sin(angle), np.sin(angle)
    return part[0] @ rotation.T, part[1], part[2]


def pick(rng: np.random.Generator, *names: str) -> np.ndarray:
    """A random colour of one of these names."""
    return draw_colour(rng, names[rng.integers(len(names))])
