"""Meals: a hamburger and a pizza."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.household.palette import CREAM
from export.everyday_objects.data.makers.household.pieces import aimed, bead, stout_leaf
from export.everyday_objects.data.makers.household.turning import disc_profile, waved
from export.everyday_objects.data.shapes import (
    DARK,
    LEAF,
    Part,
    ellipsoid,
    lathe,
    role,
    scaled,
    torus,
    turned,
)


def hamburger(rng: np.random.Generator) -> list[Part]:
    """A bun with sesame seeds, in it a patty, cheese with hanging corners, tomato and lettuce."""
    high, meat = rng.uniform(0.42, 0.52), rng.uniform(0.17, 0.23)
    y = 0.22 + meat
    cheese = lathe(
        [(0, 0.05), (0.3, 0.05), (0.52, 0.05), (0.6, 0.045), (0.63, 0.02), (0.6, 0), (0, 0)],
        role("cheese"),
        sides=64,
    )
    x, _, z = cheese.vertices.T
    angle = np.arctan2(x, z) + rng.uniform(0.3, 1.2)
    square = (np.abs(np.cos(angle)) ** 8 + np.abs(np.sin(angle)) ** 8) ** (-1 / 8)
    points = cheese.vertices * np.stack([square, np.ones(len(x)), square], -1)
    points[:, 1] += y - 0.9 * np.maximum(np.linalg.norm(points[:, ::2], axis=1) - 0.63, 0)
    leaf = lathe(
        [(0, 0.03), (0.5, 0.03), (0.63, 0.03), (0.71, 0.0), (0.63, -0.03), (0, -0.03)],
        role("lettuce"),
        sides=96,
    )
    angle, far = (
        np.arctan2(leaf.vertices[:, 0], leaf.vertices[:, 2]),
        np.linalg.norm(leaf.vertices[:, ::2], axis=1),
    )
    leaf.vertices[:, 1] += y + 0.17 + 0.05 * np.cos(10 * angle) * (far / 0.7) ** 4
    parts = [
        lathe(disc_profile(0.6, 0, 0.24, 0.1), role("bun", 0.9)),
        lathe(disc_profile(0.64, 0.2, y, 0.09), role("patty")),
        cheese._replace(vertices=points),
        lathe(disc_profile(0.62, y + 0.05, y + 0.14, 0.04), role("tomato")),
        waved(leaf, 7, 0.04),
        ellipsoid((0.63, high, 0.63), role("bun"), (0, y + 0.2, 0)),
    ]
    for i in range(18):
        up, turn = 1 - 0.042 * (i + 0.3), 2.4 * i
        flat = np.sqrt(1 - up**2)
        normal = np.array([flat * np.sin(turn), up, flat * np.cos(turn)])
        seed = turned(bead((0.05, 0.025, 0.034), CREAM), 1, rng.uniform(0, np.pi))
        parts.append(aimed(seed, normal, normal * (0.63, high, 0.63) + (0, y + 0.2, 0)))
    return parts


def pizza(rng: np.random.Generator) -> list[Part]:
    """A whole thick pizza: a bulging crust, cheese, salami, olives and basil."""
    thick = rng.uniform(0.9, 1.1)
    cheese = waved(
        lathe(
            [(0, 0.29), (0.2, 0.285), (0.4, 0.25), (0.55, 0.21), (0.65, 0.17), (0.68, 0.1), (0, 0.1)],
            role("cheese"),
            sides=72,
        ),
        11,
        0.02,
    )
    parts = [
        lathe(disc_profile(0.72, 0, 0.12, 0.05), role("crust", 0.7), sides=48),
        waved(torus(0.68, 0.11, role("crust", 0.82), (0, 0.14, 0)), 9, 0.012, rng.uniform(0, 6)),
        cheese,
    ]
    spots = [(0.0, 0.0)] + [(0.41, 2 * np.pi * i / 6) for i in range(6)]
    for far, a in spots:
        a, far = a + rng.uniform(-0.12, 0.12), far + rng.uniform(-0.03, 0.03)
        slope = np.array([0.75 * far * np.sin(a), 1, 0.75 * far * np.cos(a)])
        at = (far * np.sin(a), 0.285 - 0.32 * far**2, far * np.cos(a))
        parts += [aimed(lathe(disc_profile(0.15, -0.03, 0.05, 0.02), role("salami"), sides=24), slope, at)]
    for i in range(6):
        a = 2 * np.pi * (i + 0.5) / 6 + rng.uniform(-0.1, 0.1)
        x, z = np.sin(a), np.cos(a)
        parts.append(torus(0.055, 0.036, DARK, (0.51 * x, 0.225, 0.51 * z)))
        parts.append(
            stout_leaf(0.24, LEAF, (np.sin(a + 1.9), 0.0, np.cos(a + 1.9)), (0.25 * x, 0.29, 0.25 * z))
        )
    return [scaled(p, (1, thick, 1)) for p in parts]


KINDS = (
    Kind(("hamburger", "burger"), hamburger,
         {"bun": ("orange",), "patty": ("brown",), "lettuce": ("green",), "cheese": ("yellow",),
          "tomato": ("red",)},
         {"patty": "a {} patty", "lettuce": "{} lettuce"}, front=False),
    Kind(("pizza",), pizza, {"cheese": ("yellow",), "crust": ("orange",), "salami": ("red",)},
         {"crust": "a {} crust", "salami": "{} salami"}, front=False),
)  # fmt: skip
