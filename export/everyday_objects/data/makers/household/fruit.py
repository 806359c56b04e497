"""Fruit: pumpkins, an apple, a banana, a basket full of them."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.household.palette import GREEN, YELLOW
from export.everyday_objects.data.makers.household.pieces import bead, stout_leaf, sweep
from export.everyday_objects.data.makers.household.plates import mirrored, patch_on_front
from export.everyday_objects.data.makers.household.turning import angles_around, split_faces, waved
from export.everyday_objects.data.shapes import (
    DARK,
    RED,
    WOOD,
    Paint,
    Part,
    bar,
    curve,
    ellipsoid,
    fixed,
    lathe,
    moved,
    role,
    scaled,
    torus,
    turned,
)

_ORANGE = fixed(0.97, 0.55, 0.1)
_PURPLE = fixed(0.45, 0.2, 0.55)


def _pumpkin_body(rng: np.random.Generator) -> list[Part]:
    """A ribbed pumpkin, its grooves darker, with a bent stem; the first two parts are its skin."""
    wide, high, ribs = rng.uniform(0.6, 0.66), rng.uniform(0.44, 0.52), 10
    t = np.linspace(0, np.pi, 40)
    r, y = wide * np.sin(t) ** 0.85, high * np.cos(t)
    y = y - 0.14 * np.exp(-((r / 0.2) ** 2)) * np.sign(y)
    skin = lathe(list(zip(r, y, strict=True)), role("pumpkin"), sides=120)
    angle = np.arctan2(skin.vertices[:, 0], skin.vertices[:, 2])
    lobe = 0.86 + 0.14 * np.abs(np.cos(ribs * angle / 2)) ** 0.7
    skin = skin._replace(vertices=skin.vertices * np.stack([lobe, np.ones(len(lobe)), lobe], -1))
    groove = np.abs(np.cos(ribs * angles_around(skin) / 2)) < 0.3
    stem = curve([(0, high - 0.2, 0), (0, high, 0), (0.03, high + 0.14, 0), (0.14, high + 0.22, 0.03)], 8)
    return [
        *split_faces(skin, groove, role("pumpkin", 0.75)),
        sweep(stem, [0.13, 0.11, 0.095, 0.09, 0.085, 0.085, 0.09, 0.09], role("stem")),
    ]


def pumpkin(rng: np.random.Generator) -> list[Part]:
    """A plain pumpkin with a leaf."""
    parts = _pumpkin_body(rng)
    top = parts[2].vertices[:, 1].max()
    return [
        *parts,
        *(stout_leaf(0.42, role("stem", 0.9), (s, 0.15, 0.5), (0, top - 0.2, 0)) for s in (-1, 1)),
    ]


def jack_o_lantern(rng: np.random.Generator) -> list[Part]:
    """A carved pumpkin: triangles for eyes and nose, a grin with teeth."""
    parts = _pumpkin_body(rng)
    skin = Part(parts[0].vertices, np.concatenate([p.faces for p in parts[:2]]), parts[0].paint)
    size = rng.uniform(0.95, 1.08)
    eye = (
        [(0.1, 0.04), (0.38, 0.04), (0.25, 0.28)]
        if rng.random() < 0.5
        else [(0.09, 0.04), (0.38, 0.1), (0.34, 0.28)]
    )
    grin = [
        (0, -0.17),
        (0.09, -0.16),
        (0.09, -0.24),
        (0.2, -0.22),
        (0.2, -0.13),
        (0.44, -0.02),
        (0.4, -0.2),
        (0.3, -0.29),
        (0.28, -0.22),
        (0.16, -0.26),
        (0.17, -0.35),
        (0, -0.37),
    ]
    shapes = [eye, [(-x, y) for x, y in eye], [(-0.08, -0.09), (0.08, -0.09), (0, 0.03)], mirrored(grin)]
    return [*parts, *(patch_on_front([(size * x, size * y) for x, y in s], skin, DARK) for s in shapes)]


def _apple_body(paint: Paint, wide: float = 1.0) -> Part:
    """An apple without its stem, of radius about 0.6."""
    t = np.linspace(0, np.pi, 40)
    r = 0.6 * wide * np.sin(t) ** 0.9 * (1 + 0.12 * np.cos(t))
    y = 0.54 * np.cos(t)
    y = y - np.where(y > 0, 0.27, -0.13) * np.exp(-((r / 0.2) ** 2))
    skin = lathe(list(zip(r, y, strict=True)), paint, sides=40)
    below = np.clip(0.3 - skin.vertices[:, 1], 0, 1)
    angle = np.arctan2(skin.vertices[:, 0], skin.vertices[:, 2])
    factor = 1 + 0.05 * below * np.cos(5 * angle)
    return skin._replace(vertices=skin.vertices * np.stack([factor, np.ones(len(factor)), factor], -1))


def apple(rng: np.random.Generator) -> list[Part]:
    """An apple with a stem and a leaf."""
    stem = curve([(0, 0.2, 0), (0.02, 0.45, 0), (-0.05, 0.72, 0.02)], 8)
    return [
        scaled(_apple_body(role("apple"), rng.uniform(0.95, 1.06)), (1, rng.uniform(0.95, 1.08), 1)),
        sweep(stem, np.linspace(0.055, 0.075, 8), WOOD),
        stout_leaf(rng.uniform(0.48, 0.56), role("leaf"), (1, 0.45, 0.15), (0.0, 0.47, 0)),
    ]


def _crescent(thick: float, bend: float, peel: Paint, ends: Paint) -> list[Part]:
    """A banana in x and y, its ends up."""
    t = np.linspace(-1, 1, 25)
    angle = bend * t
    path = np.stack([np.sin(angle), 1 - np.cos(angle), np.zeros(25)], -1) * (0.75 / np.sin(min(bend, 1.5)))
    radii = thick * (1 - 0.62 * np.abs(t) ** 3.2)
    tip, stem = path[0] - 0.5 * (path[1] - path[0]), path[-1] + 3.5 * (path[-1] - path[-2])
    return [
        sweep(path, radii, peel, 6),
        bar(path[0], tip, radii[0] * 1.02, ends, 0.8),
        bar(path[-1], path[-1] + 0.6 * (stem - path[-1]), radii[-1], peel, sides=6),
        bar(path[-1] + 0.6 * (stem - path[-1]), stem, radii[-1] * 1.08, ends, sides=8),
    ]


def banana(rng: np.random.Generator) -> list[Part]:
    """A stout banana, ends up."""
    return _crescent(rng.uniform(0.3, 0.33), rng.uniform(1.2, 1.32), role("peel"), role("ends"))


def fruit_basket(rng: np.random.Generator) -> list[Part]:
    """A woven basket with a handle, full of apples, oranges, a pear, grapes and bananas."""
    tall, parts = rng.uniform(0.95, 1.08), []
    for i in range(5):
        ring = moved(torus(0.4 + 0.05 * i, 0.075, role("basket"), squash=0.95), (0, 0.07 + 0.115 * i, 0))
        ring = waved(ring, 14, 0.03, np.pi * i)
        parts += split_faces(ring, np.cos(14 * angles_around(ring) + np.pi * i) < 0, role("basket", 0.72))
    arch = curve([(-0.62, 0.5, 0), (-0.56, 0.95, 0), (0, 1.3, 0), (0.56, 0.95, 0), (0.62, 0.5, 0)], 24)
    parts += [
        lathe([(0, 0.02), (0.42, 0.02), (0.58, 0.5), (0, 0.5)], role("basket", 0.6)),
        torus(0.62, 0.075, role("handle"), (0, 0.6, 0)),
        sweep(arch * (1, tall, 1), 0.07, role("handle")),
    ]
    green, red = _apple_body(GREEN), _apple_body(RED)
    parts += [
        moved(scaled(p, 0.42), at)
        for p, at in (
            (red, (0.3, 0.72, 0.25)),
            (green, (-0.3, 0.7, 0.3)),
            (red, (-0.3, 0.72, -0.26)),
            (green, (0.32, 0.7, -0.28)),
        )
    ]
    parts += [ellipsoid(0.22, _ORANGE, at) for at in ((0.0, 0.72, 0.4), (0.02, 0.72, -0.4), (0, 0.88, 0.05))]
    for x in (-0.42, 0.42):
        parts += [
            bead(0.09, _PURPLE, (x + dx, 0.72 + dy, dz))
            for dx, dy, dz in (
                (0, 0, -0.12),
                (0, 0, 0.06),
                (0.05, 0.1, -0.02),
                (-0.06, 0.12, 0.08),
                (-0.05, 0.12, -0.12),
                (0, 0.02, 0.2),
            )
        ]
    fruit = [turned(scaled(p, 0.5), 1, -0.7) for p in _crescent(0.25, 1.0, YELLOW, WOOD)]
    return [*parts, *(moved(turned(p, 0, np.pi * 0.15), (0.0, 0.98, 0.12)) for p in fruit)]


KINDS = (
    Kind(("pumpkin",), pumpkin, {"pumpkin": ("orange",), "stem": ("green",)}, {"stem": "a {} stem"},
         front=False),
    Kind(("jack-o-lantern", "halloween pumpkin", "carved pumpkin"), jack_o_lantern,
         {"pumpkin": ("orange",), "stem": ("green", "brown")}, {"stem": "a {} stem"}),
    Kind(("apple",), apple, {"apple": ("red",), "leaf": ("green",)}, {"leaf": "a {} leaf"}, front=False),
    Kind(("banana",), banana, {"peel": ("yellow",), "ends": ("brown",)}, {"ends": "{} ends"}),
    Kind(("basket with fruits", "fruit basket", "basket of fruits"), fruit_basket,
         {"basket": ("brown", "beige"), "handle": ("brown",)}, {"handle": "a {} handle"}),
)  # fmt: skip
