"""Parts that objects are made of: surfaces of revolution, blocks, sweeps, blended bodies. y up, front to +z.

A part says how it is painted: by a role of its object ("body", "roof"), whose colour is chosen later, lighter
or darker by a factor; or in a colour that it always has. Sizes are free: an object is scaled to a ball at the
end.
"""

from collections.abc import Sequence
from typing import NamedTuple

import mapbox_earcut
import numpy as np
from skimage.measure import marching_cubes

Vector = tuple[float, float, float] | np.ndarray
RADIUS = 0.75
"""Of the ball around every object [scene units]."""


class Paint(NamedTuple):
    """How a part is painted."""

    role: str
    """Name of the role that gives the colour; "" for the fixed colour `rgb`."""
    shade: float = 1.0
    """Factor on the role's colour."""
    rgb: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """In [0, 1], where there is no role."""


def role(name: str, shade: float = 1.0) -> Paint:
    """Return the paint of a role, `shade` times as bright."""
    return Paint(name, shade)


def fixed(red: float, green: float, blue: float) -> Paint:
    """Return a colour in [0, 1] that does not depend on what is asked for."""
    return Paint("", 1.0, (red, green, blue))


DARK, WHITE, STEEL = fixed(0.05, 0.05, 0.06), fixed(0.96, 0.96, 0.95), fixed(0.62, 0.64, 0.67)
GLASS, TYRE, LAMP = fixed(0.2, 0.25, 0.31), fixed(0.08, 0.08, 0.09), fixed(0.98, 0.95, 0.78)
WOOD, LEAF, GOLD = fixed(0.5, 0.32, 0.17), fixed(0.2, 0.47, 0.16), fixed(0.93, 0.73, 0.22)
RED, PINK, SKIN = fixed(0.82, 0.08, 0.07), fixed(0.95, 0.66, 0.68), fixed(0.94, 0.75, 0.62)


class Part(NamedTuple):
    """A piece of surface in one paint; winding does not matter."""

    vertices: np.ndarray
    """(v, 3) float64"""
    faces: np.ndarray
    """(f, 3) int"""
    paint: Paint


class Shape(NamedTuple):
    """A whole object, centred on its bounding box, its bounding ball of radius `RADIUS`."""

    vertices: np.ndarray
    """(v, 3) float32"""
    faces: np.ndarray
    """(f, 3) int32"""
    paint: np.ndarray
    """(f,) int32, row of `paints`"""
    paints: tuple[Paint, ...]


def assemble(parts: Sequence[Part]) -> Shape:
    """Join parts, centre and scale them."""
    paints = tuple(dict.fromkeys(p.paint for p in parts))
    starts = np.cumsum([0] + [len(p.vertices) for p in parts])
    points = np.concatenate([p.vertices for p in parts])
    points = points - (points.max(0) + points.min(0)) / 2
    points = points * (RADIUS / np.linalg.norm(points, axis=1).max())
    faces = np.concatenate([p.faces + s for p, s in zip(parts, starts, strict=False)])
    paint = np.repeat([paints.index(p.paint) for p in parts], [len(p.faces) for p in parts])
    return Shape(points.astype(np.float32), faces.astype(np.int32), paint.astype(np.int32), paints)


# ---------------------------------------------------------------------------------------------- moving


def moved(part: Part, by: Vector) -> Part:
    """The part moved."""
    return part._replace(vertices=part.vertices + np.asarray(by))


def scaled(part: Part, by: Vector | float) -> Part:
    """The part scaled about the origin, by one factor or one an axis."""
    return part._replace(vertices=part.vertices * np.asarray(by))


def turned(part: Part, axis: int, angle: float, about: Vector = (0.0, 0.0, 0.0)) -> Part:
    """The part turned by `angle` [rad] about an axis (0 x, 1 y, 2 z) through `about`, right-handed."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[i, i] = rotation[j, j] = np.cos(angle)
    rotation[i, j], rotation[j, i] = -np.sin(angle), np.sin(angle)
    return part._replace(vertices=(part.vertices - about) @ rotation.T + about)


def both_sides(*parts: Part) -> list[Part]:
    """The parts and their mirror images at x = 0."""
    return [*parts, *(scaled(p, (-1.0, 1.0, 1.0)) for p in parts)]


# ---------------------------------------------------------------------------------------------- round things


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Triangles of a (rows, columns) vertex grid that closes around its columns."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = a + columns, b + columns
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([b, d, c], -1).reshape(-1, 3)])


def lathe(
    profile: Sequence[tuple[float, float]], paint: Paint, at: Vector = (0.0, 0.0, 0.0), sides: int = 32
) -> Part:
    """Turn a polyline of (radius, height) about the y axis; closed only where the radius is 0."""
    radius, height = np.asarray(profile, np.float64).T
    angle = np.arange(sides) * 2 * np.pi / sides
    x, z = np.outer(radius, np.sin(angle)), np.outer(radius, np.cos(angle))
    y = np.repeat(height[:, None], sides, 1)
    return Part(np.stack([x, y, z], -1).reshape(-1, 3) + at, grid_faces(len(profile), sides), paint)


def ellipsoid(
    radii: Vector | float, paint: Paint, at: Vector = (0.0, 0.0, 0.0), top: float = 0.0, bottom: float = np.pi
) -> Part:
    """An ellipsoid (one radius: a ball), or the zone of it between two polar angles from +y."""
    t = np.linspace(top, bottom, 17)
    ball = lathe(list(zip(np.sin(t), np.cos(t), strict=True)), paint, sides=28)
    return moved(scaled(ball, radii), at)


def cushion(size: Vector, paint: Paint, at: Vector = (0.0, 0.0, 0.0), roundness: float = 6.0) -> Part:
    """A box with rounded edges, `at` its centre: the unit ball of the p-norm, p = `roundness`."""
    ball = ellipsoid(1.0, paint)
    norm = (np.abs(ball.vertices) ** roundness).sum(axis=1, keepdims=True) ** (1 / roundness)
    return Part(ball.vertices / norm * np.asarray(size) / 2 + at, ball.faces, paint)


def torus(
    major: float,
    minor: float,
    paint: Paint,
    at: Vector = (0.0, 0.0, 0.0),
    arc: tuple[float, float] = (0.0, 2 * np.pi),
    squash: float = 1.0,
) -> Part:
    """A ring about the y axis; `arc`: only the part of its tube between two angles (0 outside, pi/2 top)."""
    t = np.linspace(arc[0], arc[1], 20)
    return lathe([(major + minor * np.cos(a), squash * minor * np.sin(a)) for a in t], paint, at, 40)


def bar(start: Vector, end: Vector, radius: float, paint: Paint, taper: float = 1.0, sides: int = 14) -> Part:
    """A round bar between two points, `taper` times as thick at its end; closed, flat ends."""
    return tube([start, end], [radius, radius * taper], paint, sides)


def tube(points: Sequence[Vector], radii: Sequence[float] | float, paint: Paint, sides: int = 14) -> Part:
    """A round tube through points, one radius each (or one for all); closed by flat ends. For legs, tails,
    handles (see `curve` for smooth ones)."""
    path = np.asarray(points, np.float64)
    thick = np.broadcast_to(np.asarray(radii, np.float64), len(path))
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-12
    side = np.cross(along[0], (1.0, 0, 0) if abs(along[0, 0]) < 0.9 else (0, 1.0, 0))
    rows = [np.repeat(path[:1], sides, 0)]
    angle = np.arange(sides) * 2 * np.pi / sides
    for centre, direction, r in zip(path, along, thick, strict=True):
        side = side - direction * (side @ direction)
        side /= np.linalg.norm(side) + 1e-12
        other = np.cross(direction, side)
        rows.append(centre + r * (np.outer(np.cos(angle), side) + np.outer(np.sin(angle), other)))
    rows.append(np.repeat(path[-1:], sides, 0))
    return Part(np.concatenate(rows), grid_faces(len(rows), sides), paint)


def curve(points: Sequence[Vector], count: int = 12) -> np.ndarray:
    """A smooth path (count, 3) through points: Catmull-Rom."""
    p = np.asarray(points, np.float64)
    p = np.concatenate([2 * p[:1] - p[1:2], p, 2 * p[-1:] - p[-2:-1]])
    u = np.linspace(0, len(p) - 3, count)
    i = np.minimum(u.astype(int), len(p) - 4)
    t = (u - i)[:, None]
    a, b, c, d = p[i], p[i + 1], p[i + 2], p[i + 3]
    return 0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)


# ---------------------------------------------------------------------------------------------- flat and
# angular things


def box(size: Vector, paint: Paint, at: Vector = (0.0, 0.0, 0.0)) -> Part:
    """An axis-parallel box, `at` its centre."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
             [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
    return Part(corners * np.asarray(size) + at, np.array(faces), paint)


def frustum(
    lower: tuple[float, float],
    upper: tuple[float, float],
    height: float,
    paint: Paint,
    at: Vector = (0.0, 0.0, 0.0),
    lean: float = 0.0,
) -> Part:
    """A box whose top (width, depth) differs from its bottom, the top moved by `lean` along z; `at` the
    centre of its bottom. A pyramid or a gable roof has 0 in `upper`."""
    block = box((1.0, 1.0, 1.0), paint)
    top = block.vertices[:, 1] > 0
    scale = np.where(top[:, None], np.asarray(upper), np.asarray(lower))
    x, z = block.vertices[:, 0] * scale[:, 0], block.vertices[:, 2] * scale[:, 1]
    return Part(np.stack([x, top * height, z + top * lean], -1) + at, block.faces, paint)


def extrude(outline: Sequence[tuple[float, float]], thickness: float, paint: Paint, axis: int = 2) -> Part:
    """A plate of a polygon (may be concave, either direction), centred in its thickness. The outline's two
    coordinates are x, y for axis 2; z, y for axis 0; x, z for axis 1."""
    flat = np.asarray(outline, np.float64)
    n = len(flat)
    lid = mapbox_earcut.triangulate_float64(flat, np.array([n], np.uint32)).reshape(-1, 3).astype(int)
    points = np.zeros((2 * n, 3))
    first, second = {2: (0, 1), 0: (2, 1), 1: (0, 2)}[axis]
    points[:, first], points[:, second] = np.tile(flat[:, 0], 2), np.tile(flat[:, 1], 2)
    points[:n, axis], points[n:, axis] = -thickness / 2, thickness / 2
    i, j = np.arange(n), (np.arange(n) + 1) % n
    walls = np.concatenate([np.stack([i, j, i + n], -1), np.stack([j, j + n, i + n], -1)])
    return Part(points, np.concatenate([lid, lid[:, ::-1] + n, walls]), paint)


def loft(sections: Sequence[tuple[float, float, float, float, float]], paint: Paint, roundness: float = 2.0,
         axis: int = 2, sides: int = 28) -> Part:  # fmt: skip
    """A hull through superelliptic sections across an axis (2: z): each (position along the axis, centre
    height, half width, half height, centre x). `roundness` 2 is an ellipse, 4 and more a rounded rectangle;
    closed ends. For fish, cars, boats, shoes. With axis 1 the hull stands: (y, centre z, half width in x,
    half depth in z, centre x)."""
    angle = np.arange(sides) * 2 * np.pi / sides
    c, s = np.cos(angle), np.sin(angle)
    p = 2 / roundness
    u, v = np.sign(c) * np.abs(c) ** p, np.sign(s) * np.abs(s) ** p
    rows = []
    for place, centre, width, height, x in sections:
        row = np.zeros((sides, 3))
        row[:, axis] = place
        row[:, 0] = x + width * u
        row[:, 3 - axis] = centre + height * v
        rows.append(row)
    ends = [np.repeat(r.mean(0, keepdims=True), sides, 0) for r in (rows[0], rows[-1])]
    grid = [ends[0], *rows, ends[1]]
    return Part(np.concatenate(grid), grid_faces(len(grid), sides), paint)


# ---------------------------------------------------------------------------------------------- blended
# bodies


class Limb(NamedTuple):
    """A round cone between two points: of radius `first` at `start`, `last` at `end`."""

    start: Vector
    end: Vector
    first: float
    last: float


class Lump(NamedTuple):
    """An ellipsoid; `pitch` [rad] turns it about x (positive lowers its +z end)."""

    at: Vector
    radii: Vector
    pitch: float = 0.0


def blend(pieces: Sequence[Limb | Lump], paint: Paint, softness: float = 0.06, cell: float = 0.025) -> Part:
    """One smooth skin over limbs and lumps that flow into each other: bodies of animals and people.

    `softness`: how far seams are rounded, `cell`: of the grid that the surface is found on; both in the units
    of the pieces (for an object about 1.5 long).
    """
    ends = []
    for p in pieces:
        if isinstance(p, Limb):
            reach = max(p.first, p.last)
            ends += [np.asarray(p.start) - reach, np.asarray(p.start) + reach]
            ends += [np.asarray(p.end) - reach, np.asarray(p.end) + reach]
        else:
            reach = max(p.radii)
            ends += [np.asarray(p.at) - reach, np.asarray(p.at) + reach]
    low, high = np.min(ends, 0) - softness - 2 * cell, np.max(ends, 0) + softness + 2 * cell
    counts = np.ceil((high - low) / cell).astype(int) + 1
    axes = [low[k] + cell * np.arange(counts[k]) for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).astype(np.float32)
    total = np.zeros(points.shape[:3], np.float32)
    for piece in pieces:  # smooth minimum: -k log sum exp(-d / k)
        total += np.exp(np.clip(-_distance(points, piece) / (softness / 3), -60, 60))
    field = -np.log(np.maximum(total, 1e-30)) * (softness / 3)
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(cell,) * 3)
    return Part(vertices.astype(np.float64) + low, faces.astype(int), paint)


def _distance(points: np.ndarray, piece: Limb | Lump) -> np.ndarray:
    if isinstance(piece, Limb):
        start, along = np.asarray(piece.start), np.asarray(piece.end) - np.asarray(piece.start)
        t = np.clip((points - start) @ along / max(float(along @ along), 1e-12), 0, 1)
        return np.linalg.norm(points - start - t[..., None] * along, axis=-1) - (
            piece.first + (piece.last - piece.first) * t
        )
    local = points - np.asarray(piece.at, np.float32)
    if piece.pitch:
        c, s = np.cos(piece.pitch), np.sin(piece.pitch)
        y, z = local[..., 1] * c + local[..., 2] * s, -local[..., 1] * s + local[..., 2] * c
        local = np.stack([local[..., 0], y, z], -1)
    radii = np.asarray(piece.radii, np.float32)
    k0 = np.linalg.norm(local / radii, axis=-1)
    k1 = np.linalg.norm(local / radii**2, axis=-1)
    return np.where(k1 > 1e-9, k0 * (k0 - 1) / np.maximum(k1, 1e-9), -radii.min())


def inside(points: np.ndarray, pieces: Sequence[Limb | Lump]) -> np.ndarray:
    """Which of (n, 3) points lie in one of the pieces, (n,) bool: to paint patches (see `repaint`)."""
    return np.min([_distance(points, p) for p in pieces], axis=0) < 0


def repaint(part: Part, where: Sequence[Limb | Lump], paint: Paint) -> list[Part]:
    """Split a part in two: faces whose centre lies in one of the pieces get another paint (a white belly,
    spots, socks).
    """
    hit = inside(part.vertices[part.faces].mean(1), where)
    return [part._replace(faces=part.faces[~hit]), Part(part.vertices, part.faces[hit], paint)]
