"""Procedural vehicles: each function returns a random one, y up, front to +z."""

from collections.abc import Callable

import numpy as np

from export.everyday_objects.captions import COLOURS
from export.everyday_objects.catalogue import Model
from export.everyday_objects.shapes import Part, assemble, bar, box, cushion, ellipsoid, frustum, pick

GLASS, TYRE, LAMP = np.array([0.16, 0.19, 0.23]), np.array([0.06, 0.06, 0.07]), np.array([0.97, 0.95, 0.8])


def wheels(x: float, z: tuple[float, ...], radius: float, colour: np.ndarray) -> list[Part]:
    """Wheels with hub caps at +-x and every z, standing on the floor."""
    parts = []
    for s in (-1, 1):
        for at in z:
            parts.append(bar((s * (x - 0.07), radius, at), (s * (x + 0.05), radius, at), radius, TYRE))
            parts.append(bar((s * x, radius, at), (s * (x + 0.06), radius, at), radius * 0.55, colour))
    return parts


def car(rng: np.random.Generator) -> Model:
    """A rounded body, a cabin of glass under a roof, four wheels, lamps."""
    colour, hub = pick(rng, *COLOURS), pick(rng, "grey", "white", "black")
    w, length, r = rng.uniform(0.72, 0.82), rng.uniform(1.5, 2.0), rng.uniform(0.15, 0.19)
    body, cabin = rng.uniform(0.3, 0.38), rng.uniform(0.26, 0.36)
    low, shift = r * 0.75, -rng.uniform(0.0, 0.15) * length
    long, roof = length * rng.uniform(0.5, 0.65), length * rng.uniform(0.28, 0.42)
    top = low + body
    parts = [
        cushion((w, body, length), colour, (0, low + body / 2, 0), rng.uniform(5, 9)),
        frustum((w * 0.92, long), (w * 0.74, roof), cabin, GLASS, (0, top - 0.03, shift), 0.0),
        cushion((w * 0.77, 0.06, roof * 1.04), colour, (0, top + cabin - 0.02, shift), 9),
    ]
    for sx in (-1, 1):
        for sz in (-1, 1):  # pillars
            foot = (sx * w * 0.45, top - 0.03, shift + sz * long / 2)
            parts.append(bar(foot, (sx * w * 0.37, top + cabin, shift + sz * roof / 2), 0.022, colour))
        parts.append(ellipsoid((0.09, 0.06, 0.05), LAMP, (sx * w * 0.34, low + body * 0.58, length * 0.475)))
        parts.append(
            box(
                (0.12, 0.08, 0.03),
                np.array([0.8, 0.05, 0.05]),
                (sx * w * 0.34, low + body * 0.6, -length * 0.485),
            )
        )
    parts.append(box((w * 0.4, 0.07, 0.02), TYRE, (0, low + body * 0.35, length * 0.492)))
    return assemble(parts + wheels(w / 2, (-length * 0.31, length * 0.31), r, hub))


def bus(rng: np.random.Generator) -> Model:
    """A long box with a band of windows."""
    colour, roof = pick(rng, *COLOURS), pick(rng, "white", *COLOURS)
    w, h, length, r = rng.uniform(0.7, 0.8), rng.uniform(0.75, 0.95), rng.uniform(1.9, 2.6), 0.16
    parts = [
        cushion((w, h, length), colour, (0, r + h / 2, 0), 14),
        cushion((w * 0.96, 0.06, length * 0.97), roof, (0, r + h, 0), 12),
    ]
    panes = int(rng.integers(4, 7))
    for s in (-1, 1):
        for i in range(panes):
            z = (i - (panes - 1) / 2) * length * 0.92 / panes
            parts.append(
                box((0.03, h * 0.33, length * 0.78 / panes), GLASS, (s * w * 0.495, r + h * 0.68, z))
            )
        parts.append(box((w * 0.82, h * 0.38, 0.03), GLASS, (0, r + h * 0.66, s * length * 0.495)))
        parts.append(box((0.1, 0.07, 0.03), LAMP, (s * w * 0.33, r + h * 0.2, length * 0.495)))
    return assemble(parts + wheels(w / 2, (-length * 0.3, length * 0.3), r, pick(rng, "grey", "white")))


def truck(rng: np.random.Generator) -> Model:
    """A cab at the front, a box body or an open bed behind."""
    colour, load = pick(rng, *COLOURS), pick(rng, "white", "grey", *COLOURS)
    w, r, cab, length = 0.75, 0.17, rng.uniform(0.5, 0.65), rng.uniform(1.2, 1.7)
    tall = rng.uniform(0.75, 0.9)
    front = (length + cab) / 2 - cab / 2
    parts = [
        box((w * 0.7, 0.1, length + cab), TYRE, (0, r + 0.03, 0)),
        cushion((w, tall, cab), colour, (0, r + tall / 2, front), 10),
        box((w * 0.86, tall * 0.35, 0.03), GLASS, (0, r + tall * 0.68, front + cab * 0.49)),
    ]
    for s in (-1, 1):
        parts.append(box((0.03, tall * 0.3, cab * 0.5), GLASS, (s * w * 0.495, r + tall * 0.7, front)))
        parts.append(box((0.1, 0.08, 0.03), LAMP, (s * w * 0.34, r + tall * 0.22, front + cab * 0.49)))
    high = rng.choice([rng.uniform(0.7, 1.05), 0.28])
    parts.append(box((w * 1.02, high, length * 0.97), load, (0, r + 0.08 + high / 2, -cab / 2 - 0.02)))
    return assemble(parts + wheels(w / 2, (front, -length * 0.25, -length * 0.5), r, pick(rng, "grey")))


def airplane(rng: np.random.Generator) -> Model:
    """A fuselage, two wings, a tail."""
    colour, trim = pick(rng, "white", "grey", *COLOURS), pick(rng, *COLOURS)
    r, length, span = rng.uniform(0.12, 0.17), rng.uniform(1.6, 2.0), rng.uniform(1.7, 2.1)
    sweep = rng.uniform(0.0, 0.4)
    parts = [
        ellipsoid((r, r, length / 2), colour),
        ellipsoid((r * 0.6, r * 0.5, r * 1.4), GLASS, (0, r * 0.65, length * 0.3)),
    ]
    wing_colour = colour if rng.random() < 0.5 else trim
    for s in (-1, 1):
        for root, tip, size, at in ((0.36, 0.18, span / 2, 0.1), (0.2, 0.12, span / 5, -0.44 * length)):
            plan = np.array(
                [
                    [0, root / 2],
                    [0, -root / 2],
                    [size, -tip / 2 - sweep * size],
                    [size, tip / 2 - sweep * size],
                ]
            )
            vertices = np.array([[s * x, y, z + at] for y in (-0.02, 0.02) for x, z in plan])
            faces = [
                [0, 1, 2],
                [0, 2, 3],
                [4, 6, 5],
                [4, 7, 6],
                [0, 4, 5],
                [0, 5, 1],
                [1, 5, 6],
                [1, 6, 2],
                [2, 6, 7],
                [2, 7, 3],
                [3, 7, 4],
                [3, 4, 0],
            ]
            parts.append((vertices, np.array(faces), wing_colour))
    parts.append(frustum((0.03, 0.3), (0.03, 0.16), 0.36, trim, (0, 0.04, -length * 0.43), -0.1))
    return assemble(parts)


def boat(rng: np.random.Generator) -> Model:
    """An open rowing boat with two benches."""
    colour, inside = pick(rng, *COLOURS), pick(rng, "brown", "beige", "white")
    length, width, depth = rng.uniform(1.6, 2.1), rng.uniform(0.6, 0.8), rng.uniform(0.3, 0.4)
    t = np.linspace(-1, 1, 21)
    half = width / 2 * (1 - np.abs(t) ** 2.5)
    rim = depth + 0.14 * t**2
    z = t * length / 2
    rows = [
        np.stack([s * half * f, rim * g + 0.05 * t**2 * (1 - g), z], -1)
        for s, f, g in ((-1, 1, 1), (-1, 0.75, 0.35), (-1, 0.25, 0), (1, 0.25, 0), (1, 0.75, 0.35), (1, 1, 1))
    ]
    vertices = np.concatenate(rows)
    i, j = np.meshgrid(np.arange(5), np.arange(20), indexing="ij")
    a = (i * 21 + j).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + 21], -1), np.stack([a + 1, a + 22, a + 21], -1)])
    inner = vertices * (0.93, 1, 0.96) + (0, 0.03, 0)
    parts: list[Part] = [(vertices, faces, colour), (inner, faces, inside)]
    parts += [box((width * 0.85, 0.03, 0.18), inside, (0, depth * 0.7, s * length * 0.18)) for s in (-1, 1)]
    return assemble(parts)


MAKERS: dict[str, Callable[[np.random.Generator], Model]] = {
    "car": car, "bus": bus, "truck": truck, "airplane": airplane, "boat": boat,
}  # fmt: skip
