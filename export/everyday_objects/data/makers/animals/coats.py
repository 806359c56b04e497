"""Patches, stripes and plates in other paints on the skin of an animal."""

from collections.abc import Callable

import numpy as np

from export.everyday_objects.data.shapes import Paint, Part, Vector

Field = Callable[[np.ndarray], np.ndarray]
"""Of points (n, 3): (n,), negative where a patch of another paint is."""


def _cut(part: Part, field: Field, paint: Paint) -> list[Part]:
    """Split a skin along the zero line of a field: the rest, and the patch in another paint."""
    value = field(part.vertices)
    value = np.where(np.abs(value) < 1e-6, 1e-6, value)
    hit = value[part.faces] < 0
    count = hit.sum(1)
    mixed = (count == 1) | (count == 2)
    lone = np.where(count == 1, hit.argmax(1), (~hit).argmax(1))[mixed]
    a, b, c = np.take_along_axis(part.faces[mixed], (lone[:, None] + np.arange(3)) % 3, 1).T
    edges = np.concatenate([np.stack([a, b], 1), np.stack([a, c], 1)])
    edges, place = np.unique(np.sort(edges, 1), axis=0, return_inverse=True)
    first, second = value[edges[:, 0]], value[edges[:, 1]]
    share = (first / (first - second))[:, None]
    points = part.vertices[edges[:, 0]] * (1 - share) + part.vertices[edges[:, 1]] * share
    ab, ac = np.split(place.ravel() + len(part.vertices), 2)
    tip = np.stack([a, ab, ac], 1)
    base = np.concatenate([np.stack([ab, b, c], 1), np.stack([ab, c, ac], 1)])
    tip_hit = count[mixed] == 1
    base_hit = np.tile(~tip_hit, 2)
    vertices = np.concatenate([part.vertices, points])
    return [
        Part(vertices, np.concatenate([part.faces[count == 0], tip[~tip_hit], base[~base_hit]]), part.paint),
        Part(vertices, np.concatenate([part.faces[count == 3], tip[tip_hit], base[base_hit]]), paint),
    ]


def patched(skin: Part, *patches: tuple[Field, Paint]) -> list[Part]:
    """The skin with patches; the first one wins where they overlap."""
    parts = []
    for field, paint in patches:
        skin, patch = _cut(skin, field, paint)
        parts.append(patch)
    return [skin, *parts]


def spot(at: Vector, radii: Vector | float, mirrored: bool = True) -> Field:
    """An ellipsoid; with its mirror image at x = 0 unless told otherwise."""

    def field(points: np.ndarray) -> np.ndarray:
        """Negative inside."""
        local = np.where([mirrored, False, False], np.abs(points), points)
        return np.linalg.norm((local - np.asarray(at)) / np.asarray(radii), axis=1) - 1

    return field


def below(height: float) -> Field:
    """Everything below a height: socks, paws."""
    return lambda points: points[:, 1] - height


def any_of(*fields: Field) -> Field:
    """Where at least one of the fields is."""
    return lambda points: np.min([f(points) for f in fields], axis=0)


def all_of(*fields: Field) -> Field:
    """Where all of the fields are."""
    return lambda points: np.max([f(points) for f in fields], axis=0)


def stripes_along(phase: Field, share: float) -> Field:
    """Stripes where the fraction of `phase` is near 0; `share` of the surface."""
    return lambda points: np.cos(np.pi * share) - np.cos(2 * np.pi * phase(points))


def mosaic(skin: Part, size: float, gap: float) -> Field:
    """Plates with gaps between, around points spread over a skin: a giraffe's patches."""
    vertices = skin.vertices[skin.vertices[:, 0] >= 0]
    nearest = np.full(len(vertices), np.inf)
    centres: list[np.ndarray] = []
    place = int(vertices[:, 2].argmin())
    while nearest[place] > size or not centres:
        centres.append(vertices[place])
        nearest = np.minimum(nearest, np.linalg.norm(vertices - vertices[place], axis=1))
        place = int(nearest.argmax())

    def field(points: np.ndarray) -> np.ndarray:
        """Negative away from where two centres are equally near."""
        local = np.abs(points) * (1, 0, 0) + points * (0, 1, 1)
        distance = np.linalg.norm(local[:, None] - np.array(centres), axis=2)
        first, second = np.partition(distance, 1, axis=1)[:, :2].T
        return gap - (second - first)

    return field
