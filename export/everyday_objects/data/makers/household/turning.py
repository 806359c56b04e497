"""Things turned about the y axis: their profiles, bands, waves, sectors."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.shapes import Paint, Part, curve, lathe


def disc_profile(radius: float, low: float, high: float, edge: float) -> list[tuple[float, float]]:
    """Profile for `lathe` of a disc with round edges."""
    t = np.linspace(0, np.pi / 2, 6)
    arc = [(radius - edge + edge * np.sin(a), edge - edge * np.cos(a)) for a in t]
    return [(0, low), *((r, low + y) for r, y in arc), *((r, high - y) for r, y in arc[::-1]), (0, high)]


def smooth_profile(points: Sequence[tuple[float, float]], count: int = 32) -> list[tuple[float, float]]:
    """A smooth profile through points."""
    return [(max(float(r), 0.0), float(y)) for r, y in curve([np.array(p) for p in points], count)]


def band(
    profile: Sequence[tuple[float, float]], low: float, high: float, paint: Paint, thick: float = 0.02
) -> Part:
    """A band around a turned thing whose outside has the profile (rising), between two heights."""
    radius, height = np.array(profile).T
    y = np.linspace(low, high, 8)
    r = np.interp(y, height, radius)
    ring = [(r[0] - 0.03, low), *zip(r + thick, y, strict=True), (r[-1] - 0.03, high)]
    return lathe(ring, paint, sides=48)


def waved(part: Part, count: int, amount: float, phase: float = 0.0) -> Part:
    """The part with its distance from the y axis swelling `count` times around it."""
    angle = np.arctan2(part.vertices[:, 0], part.vertices[:, 2])
    factor = 1 + amount * np.cos(count * angle + phase)
    return part._replace(vertices=part.vertices * np.stack([factor, np.ones(len(factor)), factor], -1))


def angles_around(part: Part) -> np.ndarray:
    """Angles about the y axis of the centres of a part's faces, from +z towards +x."""
    centre = part.vertices[part.faces].mean(1)
    return np.arctan2(centre[:, 0], centre[:, 2])


def split_faces(part: Part, mask: np.ndarray, paint: Paint) -> list[Part]:
    """The part in two: faces of the (f,) mask get another paint."""
    return [part._replace(faces=part.faces[~mask]), Part(part.vertices, part.faces[mask], paint)]
