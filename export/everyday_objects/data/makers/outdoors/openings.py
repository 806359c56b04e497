"""Outlines of arches, and windows and doors in a wall."""

import numpy as np

from export.everyday_objects.data.makers.outdoors.palette import STONE
from export.everyday_objects.data.shapes import GLASS, GOLD, Paint, Part, box, ellipsoid, extrude, moved

Outline = list[tuple[float, float]]
"""A polygon in x and y."""


def arch(width: float, height: float, pointed: bool = False, floor: float = 0.0) -> Outline:
    """The outline of a round or pointed arch that stands on y = `floor`."""
    if pointed:
        radius, top, reach = width, width * np.sqrt(3) / 2, np.pi / 3
    else:
        radius, top, reach = width / 2, width / 2, np.pi / 2
    spring, offset = floor + height - top, width / 2 - radius
    t = np.linspace(0, reach, 8)
    right = [(offset + radius * np.cos(a), spring + radius * np.sin(a)) for a in t]
    return [(width / 2, floor), *right, *((-x, y) for x, y in right[-2::-1]), (-width / 2, floor)]


def rectangle(width: float, height: float, floor: float = 0.0) -> Outline:
    """An outline that stands on y = `floor`."""
    w = width / 2
    return [(-w, floor), (w, floor), (w, floor + height), (-w, floor + height)]


def plate(outline: Outline, paint: Paint, front: float, back: float = -0.03) -> Part:
    """A plate in the xy-plane from z = `back` to `front`."""
    return moved(extrude(outline, front - back, paint), (0, 0, (front + back) / 2))


def window(width: float, height: float, frame: Paint, edge: float = 0.035, sill: bool = True) -> list[Part]:
    """A window with a frame, four panes and a sill, facing +z, its wall at z = 0, its foot at y = 0."""
    parts = [
        plate(rectangle(width, height), frame, 0.025),
        plate(rectangle(width - 2 * edge, height - 2 * edge, edge), GLASS, 0.04),
        box((edge * 0.8, height - edge, 0.06), frame, (0, height / 2, 0.025)),
        box((width - edge, edge * 0.8, 0.06), frame, (0, height / 2, 0.027)),
    ]
    if sill:
        parts.append(box((width + 0.05, 0.04, 0.09), frame, (0, 0, 0.02)))
    return parts


def arched_opening(
    width: float, height: float, frame: Paint, glass: Paint, pointed: bool = False, edge: float = 0.03
) -> list[Part]:
    """An arched window or door with a frame, facing +z, its wall at z = 0, its foot at y = 0."""
    inner = arch(width - 2 * edge, height - edge * (2.2 if pointed else 1), pointed)
    return [plate(arch(width, height, pointed), frame, 0.03), plate(inner, glass, 0.047)]


def door(width: float, height: float, paint: Paint, frame: Paint, arched: bool) -> list[Part]:
    """A door with a frame, a knob and a step, facing +z, its wall at z = 0."""
    if arched:
        parts = arched_opening(width, height, frame, paint)
    else:
        parts = [
            plate(rectangle(width, height), frame, 0.03),
            plate(rectangle(width - 0.06, height - 0.03), paint, 0.047),
        ]
    knob = ellipsoid(0.022, GOLD, (width * 0.26, height * 0.45, 0.055))
    return [*parts, knob, box((width + 0.12, 0.06, 0.16), STONE, (0, 0.03, 0.06))]
