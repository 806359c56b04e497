"""Containers: a barrel, and boxes of cardboard and of wood."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.furniture.joinery import block, evenly
from export.everyday_objects.data.shapes import (
    DARK,
    GOLD,
    Paint,
    Part,
    both_sides,
    box,
    ellipsoid,
    extrude,
    lathe,
    moved,
    role,
    scaled,
    turned,
)


def _striped(part: Part, stripes: int, paints: Sequence[Paint]) -> list[Part]:
    """Split a part about the y axis into `stripes` sectors that take the paints in turn."""
    centre = part.vertices[part.faces].mean(1)
    sector = np.floor((np.arctan2(centre[:, 0], centre[:, 2]) / (2 * np.pi) + 0.5) * stripes).astype(int)
    return [part._replace(faces=part.faces[sector % len(paints) == k], paint=p) for k, p in enumerate(paints)]


def barrel(rng: np.random.Generator) -> list[Part]:
    """A barrel: bulging staves, iron hoops, a lid sunk into the rim."""
    r, belly, tall = rng.uniform(0.36, 0.42), rng.uniform(0.08, 0.12), rng.uniform(1.0, 1.12)
    hoops = (0.08, 0.3, 0.7, 0.92) if rng.random() < 0.6 else (0.1, 0.5, 0.9)

    def radius(h: float) -> float:
        """Of the staves at a part of the height."""
        return r + belly * (1 - (2 * h - 1) ** 2)

    levels = np.linspace(0, 1, 13)
    wall = [(radius(h), h * tall) for h in levels]
    skin = lathe([(0, 0), *wall, (r - 0.06, tall), (r - 0.06, tall - 0.05)], role("body"), sides=48)
    parts = _striped(skin, 12, (role("body"), role("body", 0.82)))
    parts.append(lathe([(0, 0), (r - 0.05, 0)], role("body", 0.72), (0, tall - 0.05, 0), 40))
    for h in hoops:
        a, b = h - 0.045, h + 0.045
        out = 0.025
        band = [
            (radius(a) - 0.02, a * tall),
            (radius(a) + out, a * tall),
            (radius(b) + out, b * tall),
            (radius(b) - 0.02, b * tall),
        ]
        parts.append(lathe(band, role("hoops"), sides=40))
    return parts


def _cardboard_box(rng: np.random.Generator) -> list[Part]:
    """An open cardboard box: four flaps turned out, tape down its front and its back."""
    w, d, tall = rng.uniform(0.85, 1.0), rng.uniform(0.78, 0.86), rng.uniform(0.68, 0.76)
    wall, flap = 0.05, 0.28
    parts = [
        box((w - 0.04, 0.05, d - 0.04), role("body", 0.7), (0, 0.03, 0)),
        box((w - 0.1, 0.02, d - 0.1), role("body", 0.55), (0, 0.07, 0)),
    ]
    for axis, reach, along in ((0, d / 2, w), (1, w / 2, d)):
        for sign in (1, -1):
            side = [
                box((along, tall, wall), role("body", 1.02), (0, tall / 2, reach - wall / 2)),
                box(
                    (along - 2 * wall, tall - 0.08, 0.02),
                    role("body", 0.62),
                    (0, tall / 2 + 0.03, reach - wall - 0.002),
                ),
                turned(
                    box((along - 0.05, wall, flap), role("body", 1.14), (0, 0, flap / 2)),
                    0,
                    0.45 + 0.12 * axis,
                ),
            ]
            side[2] = moved(side[2], (0, tall, reach - 0.03))
            if axis == 0:
                side.append(box((0.17, tall - 0.02, 0.04), role("trim"), (0, tall / 2, reach)))
                tape = turned(box((0.17, 0.03, flap), role("trim"), (0, 0.025, flap / 2 + 0.005)), 0, 0.45)
                side.append(moved(tape, (0, tall, reach - 0.03)))
            parts += [turned(p, 1, axis * np.pi / 2 + (np.pi if sign < 0 else 0)) for p in side]
    return parts


def _wooden_crate(rng: np.random.Generator) -> list[Part]:
    """A closed wooden crate: planks in a frame of thick beams, one across every side, caps on its corners."""
    w, tall = rng.uniform(0.92, 1.0), rng.uniform(0.86, 1.0)
    parts = [box((w - 0.1, tall - 0.06, w - 0.1), role("body", 0.5), (0, tall / 2, 0))]
    for x in evenly(4, w - 0.12):
        parts.append(
            block(((w - 0.12) / 4 - 0.025, tall - 0.02, w - 0.2), role("body", 0.8), (x, tall / 2, 0), 0.015)
        )
    for y in evenly(4, tall - 0.12) + tall / 2:
        parts.append(
            block((w - 0.04, (tall - 0.12) / 4 - 0.025, w - 0.04), role("body", 0.8), (0, y, 0), 0.015)
        )
    b, frame = 0.13, role("body", 1.08)
    for sx in (1, -1):
        for s in (1, -1):
            at = w / 2 - b / 2 + 0.02
            parts += [
                block((b, tall, b), frame, (sx * at, tall / 2, s * at), 0.015),
                block((w, b, b), frame, (0, tall / 2 + sx * (tall / 2 - b / 2 + 0.02), s * at), 0.015),
                block((b, b, w), frame, (sx * at, tall / 2 + s * (tall / 2 - b / 2 + 0.02), 0), 0.015),
            ]
    corner = block((0.21, 0.21, 0.21), role("trim"), (w / 2 - 0.06, 0.06, w / 2 - 0.06), 0.02)
    for up in (corner, moved(corner, (0, tall - 0.12, 0))):
        parts += both_sides(up, scaled(up, (1.0, 1.0, -1.0)))
    slant = np.arctan2(tall - 2 * b, w - 2 * b)
    long = np.hypot(tall - 2 * b, w - 2 * b) + 0.04
    for k in range(4):
        beam = turned(box((long, b, 0.06), role("body")), 2, slant)
        parts.append(turned(moved(beam, (0, tall / 2, w / 2 - 0.015)), 1, k * np.pi / 2))
    return parts


def _treasure_chest(rng: np.random.Generator) -> list[Part]:
    """A treasure chest: a box with a vaulted lid, straps around it, a big lock."""
    w, d, tall = rng.uniform(1.05, 1.2), rng.uniform(0.66, 0.74), rng.uniform(0.42, 0.5)
    t = np.linspace(0, np.pi, 17)
    rise = 0.36

    def vault(width: float, grow: float, paint: Paint, x: float = 0.0) -> Part:
        """The lid, or a strap over it that is thicker by `grow`."""
        outline = [((d / 2 + grow) * np.cos(a), tall + (rise + grow) * np.sin(a)) for a in t]
        return moved(extrude(outline, width, paint, 0), (x, 0, 0))

    parts = [
        block((w, tall, d), role("body"), (0, tall / 2, 0), 0.015),
        vault(w, 0.0, role("body", 1.08)),
        block((w + 0.05, 0.09, d + 0.05), role("trim"), (0, tall - 0.01, 0), 0.02),
        block((w + 0.05, 0.09, d + 0.05), role("trim"), (0, 0.045, 0), 0.02),
        block((0.2, 0.24, 0.1), GOLD, (0, tall, d / 2 + 0.03), 0.03),
        ellipsoid((0.035, 0.05, 0.03), DARK, (0, tall - 0.02, d / 2 + 0.075)),
    ]
    parts += [
        vault(w + 0.06, -0.1, role("body")),
        box((w + 0.06, tall - 0.12, d - 0.2), role("body"), (0, tall / 2, 0)),
    ]
    for x in (-w / 2 + 0.04, -0.22 * w, 0.22 * w, w / 2 - 0.04):
        parts += [
            vault(0.12, 0.03, role("trim"), x),
            box((0.12, tall, d + 0.06), role("trim"), (x, tall / 2, 0)),
        ]
    return parts


def any_box(rng: np.random.Generator) -> list[Part]:
    """A cardboard box, a wooden crate or a treasure chest."""
    return (_cardboard_box, _wooden_crate, _treasure_chest)[int(3 * rng.random())](rng)


KINDS = (
    Kind(
        ("barrel",),
        barrel,
        {"body": ("brown",), "hoops": ("grey", "black")},
        {"hoops": "{} hoops"},
        front=False,
    ),
    Kind(
        ("box", "crate", "chest"),
        any_box,
        {"body": ("brown",), "trim": ("beige", "grey")},
        {"trim": "{} trim"},
    ),
)
