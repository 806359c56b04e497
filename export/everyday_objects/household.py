"""Procedural instruments and things of the house: each function returns a random one, y up, front to +z."""

from collections.abc import Callable

import numpy as np

from export.everyday_objects.captions import COLOURS
from export.everyday_objects.catalogue import Model
from export.everyday_objects.shapes import (
    Part,
    assemble,
    bar,
    box,
    cushion,
    ellipsoid,
    frustum,
    lathe,
    pick,
    tilt,
    torus,
)

DARK, IVORY = np.array([0.05, 0.05, 0.06]), np.array([0.95, 0.94, 0.9])


def slab(outline: np.ndarray, bottom: float, top: float, colour: np.ndarray) -> Part:
    """A flat body between two heights over an outline (n, 2) in x and z, star-shaped about its mean."""
    n = len(outline)
    rings = [np.insert(outline, 1, y, axis=1) for y in (bottom, top)]
    middle = outline.mean(axis=0)
    centres = np.array([[middle[0], bottom, middle[1]], [middle[0], top, middle[1]]])
    i = np.arange(n)
    j = (i + 1) % n
    low, high = np.full(n, 2 * n), np.full(n, 2 * n + 1)
    faces = np.concatenate(
        [np.stack(f, -1) for f in ((i, j, n + i), (j, n + j, n + i), (low, j, i), (high, n + i, n + j))]
    )
    return np.concatenate([*rings, centres]), faces, colour


def keyboard(width: float, height: float, front: float) -> list[Part]:
    """White keys with black ones on them, the near edge at z = `front`."""
    parts = [box((width, 0.03, 0.16), IVORY, (0, height, front - 0.08))]
    count = 12
    pitch = width / count
    parts += [
        box((pitch * 0.55, 0.04, 0.1), DARK, ((i - count / 2 + 0.5) * pitch, height, front - 0.11))
        for i in range(count)
        if i % 7 not in (2, 6)
    ]
    return parts


def piano(rng: np.random.Generator) -> Model:
    """A grand piano with its lid up, or an upright one."""
    colour = pick(rng, "black", "brown", *COLOURS)
    if rng.random() < 0.25:
        w, h, d = rng.uniform(1.2, 1.4), rng.uniform(1.0, 1.2), rng.uniform(0.28, 0.36)
        parts = [box((w, h, d), colour, (0, h / 2, -0.1))]
        parts.append(box((w, 0.16, 0.34), colour, (0, 0.56, d / 2 + 0.03)))
        parts += [box((0.08, 0.5, 0.1), colour, (s * (w / 2 - 0.04), 0.25, d / 2 + 0.12)) for s in (-1, 1)]
        return assemble(parts + keyboard(w * 0.88, 0.65, d / 2 + 0.2))
    w, length, leg = rng.uniform(1.2, 1.4), rng.uniform(1.3, 1.7), rng.uniform(0.5, 0.6)
    t = np.linspace(0, 1, 12)
    bent = np.stack([w / 2 - w * 0.6 * (0.5 - 0.5 * np.cos(np.pi * t)), -length * t], -1)
    outline = np.concatenate([[[w / 2, 0.3]], bent, [[-w / 2, -length], [-w / 2, 0.3]]])
    body = slab(outline, leg, leg + 0.26, colour)
    parts = [body, *(bar(at, (at[0], leg, at[2]), 0.045, colour, 1.5) for at in (
        (-w / 2 + 0.1, 0, 0.15), (w / 2 - 0.1, 0, 0.15), (-w * 0.25, 0, -length + 0.15)))]  # fmt: skip
    parts.append(box((w * 1.0, 0.1, 0.22), colour, (0, leg + 0.07, 0.38)))
    parts += keyboard(w * 0.88, leg + 0.14, 0.48)
    lid = slab(outline * (1.0, 0.96) + (w / 2, 0), 0, 0.03, colour)
    hinged = tilt(lid, 2, rng.uniform(0.5, 0.75))
    parts.append((hinged[0] + (-w / 2, leg + 0.27, 0), hinged[1], hinged[2]))
    return assemble(parts)


def guitar(rng: np.random.Generator) -> Model:
    """An upright guitar: a waisted body with a hole or pickups, a neck, a head."""
    colour, neck = pick(rng, "brown", "red", "black", *COLOURS), pick(rng, "brown", "beige", "black")
    lower, upper, waist = rng.uniform(0.3, 0.36), rng.uniform(0.22, 0.27), rng.uniform(0.17, 0.21)
    y = np.array([-0.34, -0.25, 0.0, 0.2, 0.36, 0.44])
    half = np.array([0.12, lower * 0.85, lower, waist, upper, 0.1])
    fine = np.linspace(-0.34, 0.44, 24)
    side = np.interp(fine, y, half)
    outline = np.concatenate([np.stack([side, -fine], -1), np.stack([-side, -fine], -1)[::-1]])
    body = tilt(slab(outline, -0.06, 0.06, colour), 0, np.pi / 2)
    parts = [body, box((0.1, 0.7, 0.06), neck, (0, 0.74, 0.05))]
    parts.append(box((0.16, 0.2, 0.06), neck, (0, 1.14, 0.05)))
    if rng.random() < 0.6:
        parts.append(tilt(lathe([(0, 0.062), (0.1, 0.062)], DARK, (0, 0, -0.16)), 0, np.pi / 2))
    else:
        parts += [box((0.2, 0.05, 0.03), DARK, (0, q, 0.07)) for q in (0.05, 0.2)]
    parts.append(box((0.2, 0.04, 0.04), DARK, (0, -0.16, 0.07)))
    low = min(p[0][:, 1].min() for p in parts)
    return assemble([(p[0] - (0, low, 0), p[1], p[2]) for p in parts])


def suitcase(rng: np.random.Generator) -> Model:
    """A rounded case that stands upright, with a handle, bands and small wheels."""
    colour, trim = pick(rng, *COLOURS), pick(rng, "black", "grey", "brown")
    w, h, d = rng.uniform(0.6, 0.85), rng.uniform(0.55, 0.95), rng.uniform(0.22, 0.32)
    floor = 0.07
    parts = [cushion((w, h, d), colour, (0, floor + h / 2, 0), rng.uniform(8, 14))]
    parts += [box((0.05, h * 0.99, d * 1.03), trim, (s * w * 0.28, floor + h / 2, 0)) for s in (-1, 1)]
    top = floor + h
    parts += [bar((s * w * 0.16, top - 0.02, 0), (s * w * 0.16, top + 0.12, 0), 0.025, trim) for s in (-1, 1)]
    parts.append(bar((-w * 0.19, top + 0.12, 0), (w * 0.19, top + 0.12, 0), 0.03, trim))
    parts += [
        bar((x - 0.03, 0.05, z), (x + 0.03, 0.05, z), 0.05, DARK)
        for x in (-w * 0.38, w * 0.38)
        for z in (-d * 0.3, d * 0.3)
    ]
    return assemble(parts)


def backpack(rng: np.random.Generator) -> Model:
    """A bag that narrows upwards, a flap, a pocket in front, two straps behind."""
    colour, trim = pick(rng, *COLOURS), pick(rng, "black", "brown", "grey", "beige")
    w, h, d = rng.uniform(0.5, 0.6), rng.uniform(0.7, 0.85), rng.uniform(0.28, 0.36)
    flap = colour * 0.8
    parts = [
        cushion((w, h, d), colour, (0, h / 2, 0), 5),
        cushion((w * 1.04, h * 0.3, d * 1.08), flap, (0, h * 0.86, 0.01), 4),
        cushion((w * 0.7, h * 0.38, d * 0.5), trim, (0, h * 0.27, d * 0.42), 5),
        box((0.06, h * 0.25, 0.03), trim, (0, h * 0.62, d * 0.52)),
    ]
    parts += [cushion((0.12, h * 0.35, d * 0.6), flap, (s * w * 0.52, h * 0.25, 0), 4) for s in (-1, 1)]
    for s in (-1, 1):
        top, bow, foot = (s * w * np.array([0.22, 0.26, 0.3])).tolist()
        bend = (bow, h * 0.65, -d * 0.85)
        parts += [bar((top, h * 0.95, -d * 0.4), bend, 0.045, trim)]
        parts += [bar(bend, (foot, h * 0.12, -d * 0.42), 0.045, trim)]
    handle = tilt(torus(0.08, 0.02, trim), 0, np.pi / 2)
    parts.append((handle[0] + (0, h + 0.02, -d * 0.2), handle[1], handle[2]))
    return assemble(parts)


def fireplace(rng: np.random.Generator) -> Model:
    """A surround with a dark opening, flames over logs, a mantelpiece and a chimney breast."""
    stone, shelf = pick(rng, "white", "grey", "brown", "red", *COLOURS), pick(rng, "white", "brown", "black")
    w, h, d = rng.uniform(1.0, 1.3), rng.uniform(0.8, 0.95), 0.4
    hole = w * rng.uniform(0.5, 0.6)
    pillar, fire = (w - hole) / 2, h * 0.62
    parts = [box((pillar, h, d), stone, (s * (hole + pillar) / 2, h / 2, 0)) for s in (-1, 1)]
    parts += [
        box((hole, h - fire, d), stone, (0, (h + fire) / 2, 0)),
        box((hole, fire, 0.04), DARK, (0, fire / 2, -d / 2 + 0.03)),
        box((w * 1.14, 0.07, d * 1.25), shelf, (0, h + 0.03, 0.03)),
        box((w * 1.1, 0.06, d * 1.3), shelf, (0, 0.03, 0.05)),
    ]
    if rng.random() < 0.6:
        tall = rng.uniform(0.4, 0.7)
        parts.append(frustum((w * 0.8, d * 0.8), (w * 0.6, d * 0.6), tall, stone, (0, h + 0.06, -0.03)))
    for x in (-0.3, 0.0, 0.3):
        tip = rng.uniform(0.5, 0.8) * fire
        flame = pick(rng, "orange", "yellow", "orange")
        parts.append(lathe([(0.0, 0.1), (hole * 0.15, 0.18), (0.0, tip)], flame, (x * hole, 0, -0.02), 12))
    log = pick(rng, "brown")
    parts += [bar((-hole * 0.4, 0.1, z), (hole * 0.4, 0.1, z), 0.05, log) for z in (-0.08, 0.06)]
    return assemble(parts)


def teapot(rng: np.random.Generator) -> Model:
    """A round pot with a spout to +x, a handle to -x, a lid with a knob."""
    colour = pick(rng, "white", *COLOURS)
    trim = colour if rng.random() < 0.6 else pick(rng, *COLOURS)
    r, h = rng.uniform(0.36, 0.44), rng.uniform(0.3, 0.38)
    parts = [
        ellipsoid((r, h, r), colour, (0, h, 0)),
        lathe([(0.6 * r, 0), (0.55 * r, 0.08)], colour),
        ellipsoid((0.55 * r, 0.09, 0.55 * r), trim, (0, 1.9 * h, 0)),
        ellipsoid((0.07, 0.07, 0.07), trim, (0, 1.9 * h + 0.13, 0)),
        bar((r * 0.7, h * 0.75, 0), (r + 0.18, h * 1.35, 0), 0.1, colour, 0.55),
        bar((r + 0.18, h * 1.35, 0), (r + 0.27, h * 1.8, 0), 0.055, colour, 0.8),
    ]
    handle = tilt(torus(h * 0.62, 0.045, trim), 0, np.pi / 2)
    parts.append((handle[0] + (-r * 1.05, h * 1.05, 0), handle[1], handle[2]))
    return assemble(parts)


MAKERS: dict[str, Callable[[np.random.Generator], Model]] = {
    "piano": piano, "guitar": guitar, "suitcase": suitcase, "backpack": backpack, "fireplace": fireplace,
    "teapot": teapot,
}  # fmt: skip
