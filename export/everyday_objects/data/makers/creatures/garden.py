"""Figures in the garden: a snowman and a gnome."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.creatures.parts import beady_eyes, curl, spike
from export.everyday_objects.data.shapes import (
    DARK,
    GOLD,
    SKIN,
    WOOD,
    Limb,
    Lump,
    Part,
    bar,
    blend,
    both_sides,
    cushion,
    ellipsoid,
    fixed,
    lathe,
    moved,
    role,
    scaled,
    torus,
    tube,
    turned,
)


def snowman(rng: np.random.Generator) -> list[Part]:
    """Three balls of snow with a top hat, a carrot, coal eyes and buttons, a scarf and twig arms."""
    low, middle, head = rng.uniform(0.42, 0.46), rng.uniform(0.31, 0.34), rng.uniform(0.25, 0.27)
    y1, y2 = low * 0.86 + 0.54, low * 0.86 + 0.96
    coal = [
        ellipsoid((0.045, 0.045, 0.03), DARK, (0, y1 + middle * np.sin(a), middle * np.cos(a)))
        for a in (0.3, -0.12)
    ]
    coal.append(ellipsoid((0.05, 0.05, 0.03), DARK, (0, low * 0.86 + low * 0.34, low * 0.9)))
    smile = [(0.13 * np.sin(t), y2 - 0.05 - 0.06 * np.cos(t), head * 0.93) for t in np.linspace(-1.2, 1.2, 9)]
    hat = [
        (0, 0),
        (0.3, 0),
        (0.32, 0.025),
        (0.3, 0.055),
        (0.2, 0.06),
        (0.19, 0.1),
        (0.205, 0.32),
        (0.19, 0.345),
        (0, 0.345),
    ]
    band = [(0.202, 0.07), (0.218, 0.08), (0.222, 0.14), (0.2, 0.15)]
    top = y2 + head * 0.72
    arm = [
        bar((0.24, y1 + 0.04, 0), (0.55, y1 + 0.2, 0.04), 0.06, WOOD, 0.8),
        bar((0.47, y1 + 0.155, 0.03), (0.58, y1 + 0.08, 0.08), 0.04, WOOD, 0.8),
    ]
    return [
        ellipsoid((low, low * 0.94, low), role("snow"), (0, low * 0.86, 0)),
        ellipsoid(middle, role("snow"), (0, y1, 0)),
        ellipsoid(head, role("snow"), (0, y2, 0)),
        lathe(hat, role("hat"), (0, top, -0.01)),
        lathe(band, role("scarf"), (0, top, -0.01)),
        torus(0.2, 0.07, role("scarf"), (0, (y1 + y2) / 2 + 0.03, 0), squash=0.9),
        curl(
            [(0.12, y1 + 0.2, 0.2), (0.14, y1 + 0.06, 0.31), (0.15, y1 - 0.14, 0.33)],
            (0.07, 0.075, 0.08),
            role("scarf", 0.9),
        ),
        spike((0, y2 + 0.01, head * 0.85), (0, y2 - 0.01, head + 0.24), 0.068, fixed(0.95, 0.45, 0.08)),
        tube(smile, 0.025, DARK),
        *beady_eyes((0.1, y2 + 0.09, head * 0.85), 0.043),
        *coal,
        *both_sides(*arm),
    ]


def gnome(rng: np.random.Generator) -> list[Part]:
    """A garden gnome: a tall pointed hat, a great white beard, a round nose, a belted coat, boots."""
    hat, fat, beard = rng.uniform(0.6, 0.72), rng.uniform(0.95, 1.08), rng.uniform(0.3, 0.38)
    y = 0.86
    coat = [
        (0, 0.16),
        (0.36, 0.16),
        (0.385, 0.2),
        (0.36, 0.32),
        (0.335, 0.42),
        (0.31, 0.55),
        (0.25, 0.7),
        (0.14, 0.8),
        (0, 0.82),
    ]
    white = blend(
        [
            Lump((0, y - 0.16, 0.16), (0.245, 0.2, 0.14)),
            Limb((0, y - 0.18, 0.2), (0, y - 0.22 - beard, 0.27 * fat), 0.18, 0.05),
            *(Limb((s * 0.2, y + 0.04, 0.06), (s * 0.13, y - 0.2, 0.2), 0.07, 0.12) for s in (-1, 1)),
            *(Limb((s * 0.03, y - 0.055, 0.26), (s * 0.17, y - 0.1, 0.22), 0.06, 0.045) for s in (-1, 1)),
        ],
        role("beard"),
    )
    cone = [
        (0.0, 0.0),
        (0.25, 0.0),
        (0.285, 0.03),
        (0.28, 0.09),
        (0.235, 0.13),
        (0.2, 0.24),
        (0.145, 0.45 * hat + 0.1),
        (0.075, 0.85 * hat),
        (0.04, 0.97 * hat),
        (0.0, hat),
    ]
    arm = [
        curl(
            [(0.22, 0.68, 0), (0.37 * fat, 0.54, 0.03), (0.36 * fat, 0.38, 0.16)],
            (0.11, 0.11, 0.1),
            role("coat"),
        ),
        torus(0.085, 0.035, role("beard"), (0.36 * fat, 0.38, 0.165)),
        ellipsoid((0.085, 0.09, 0.085), SKIN, (0.355 * fat, 0.31, 0.2)),
    ]
    boot = blend(
        [
            Limb((0.16, 0.2, 0), (0.16, 0.09, 0), 0.12, 0.12),
            Limb((0.16, 0.08, 0), (0.17, 0.08, 0.2), 0.12, 0.11),
        ],
        fixed(0.2, 0.12, 0.08),
    )
    return [
        scaled(lathe(coat, role("coat")), (fat, 1, 0.9 * fat)),
        scaled(lathe([(0.325, 0.35), (0.37, 0.36), (0.358, 0.45), (0.31, 0.46)], DARK), (fat, 1, 0.9 * fat)),
        cushion((0.16, 0.14, 0.06), GOLD, (0, 0.4, 0.335 * fat)),
        ellipsoid((0.23, 0.23, 0.21), SKIN, (0, y + 0.02, 0.02)),
        white,
        ellipsoid((0.085, 0.075, 0.08), fixed(0.93, 0.62, 0.5), (0, y + 0.015, 0.25)),
        moved(turned(lathe(cone, role("hat")), 0, -0.1), (0, y + 0.1, 0.02)),
        *beady_eyes((0.1, y + 0.075, 0.2), 0.038),
        ellipsoid((0.25, 0.23, 0.2), role("beard"), (0, y - 0.01, -0.045)),
        *both_sides(*arm, boot),
    ]


KINDS = (
    Kind(
        ("snowman",),
        snowman,
        {"snow": ("white",), "scarf": ("red", "green"), "hat": ("black",)},
        {"scarf": "a {} scarf", "hat": "a {} hat"},
    ),
    Kind(
        ("garden gnome", "gnome"),
        gnome,
        {"coat": ("blue", "green"), "hat": ("red",), "beard": ("white",)},
        {"hat": "a {} hat", "beard": "a {} beard"},
        weight=1.2,
    ),
)
