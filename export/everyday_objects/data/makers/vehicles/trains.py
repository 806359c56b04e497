"""A steam train."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.vehicles.outlines import Outline, rectangle, ring_piece
from export.everyday_objects.data.makers.vehicles.parts import CHASSIS, OUT, disc, slab, wheel_pairs
from export.everyday_objects.data.shapes import (
    GLASS,
    GOLD,
    LAMP,
    STEEL,
    Paint,
    Part,
    bar,
    both_sides,
    frustum,
    lathe,
    moved,
    role,
    turned,
)


def train(rng: np.random.Generator) -> list[Part]:
    """A chunky steam engine: boiler, chimney, golden dome, cab with a curved roof, cowcatcher, red wheels."""
    body, roof, wheel = role("body"), role("roof"), role("wheels")
    r, fat, top = rng.uniform(0.23, 0.26), rng.uniform(0.34, 0.38), rng.uniform(1.32, 1.42)
    y, big = 0.52 + fat, 0.3

    def lying(profile: Outline, paint: Paint) -> Part:
        """A piece of the boiler, turned about its axis."""
        return moved(turned(lathe(profile, paint), 0, np.pi / 2), (0, y, 0))

    cab = rectangle((-0.92, -0.3), (0.5, top), 0.05)
    arc = np.linspace(0.18 * np.pi, 0.82 * np.pi, 12)
    vault = [(0.78 * float(np.cos(a)), top - 0.42 + 0.6 * float(np.sin(a))) for a in arc]
    wheels = wheel_pairs([(0.62, r), (0.12, r), (-0.58, big)], 0.42, 0.18, wheel, wheel._replace(shade=0.6))
    return [
        lying([(0, -0.4), (fat, -0.4), (fat, 0.66), (0, 0.66)], body),
        lying([(0, 0.6), (fat + 0.04, 0.6), (fat + 0.04, 0.74), (fat - 0.04, 0.8), (0, 0.82)], CHASSIS),
        lying([(0, 0.8), (fat - 0.12, 0.8), (fat - 0.16, 0.86), (0, 0.87)], GOLD),
        lying([(fat - 0.1, 0.18), (fat + OUT, 0.18), (fat + OUT, 0.26), (fat - 0.1, 0.26)], GOLD),
        lathe(
            [(0, 0), (0.12, 0), (0.12, 0.28), (0.2, 0.4), (0.2, 0.5), (0.13, 0.5), (0, 0.46)],
            CHASSIS,
            (0, y + fat - 0.06, 0.6),
            24,
        ),
        lathe(
            [(0.17, 0), (0.17, 0.1), (0.14, 0.19), (0.07, 0.24), (0, 0.25)],
            GOLD,
            (0, y + fat - 0.06, 0.08),
            24,
        ),
        slab(cab, 0.86, body),
        slab(rectangle((-0.78, -0.44), (top - 0.52, top - 0.16)), 0.86 + 2 * OUT, GLASS, edge=0.02),
        *both_sides(
            slab(rectangle((0.08, 0.34), (top - 0.46, top - 0.1), 0.05), 0.7, GLASS, 2, (0, 0, -0.61), 0.02)
        ),
        slab([*vault, (-0.5, top - 0.06), (0.5, top - 0.06)], 0.8, roof, 2, (0, 0, -0.6), 0.05),
        slab(rectangle((-0.96, 0.9), (0.32, 0.54), 0.04), 0.76, CHASSIS),
        *(
            slab(rectangle((-0.44, 0.44), (0.34, 0.56), 0.04), 0.14, wheel, 2, (0, 0, z), 0.04)
            for z in (-0.94, 0.9)
        ),
        frustum((0.86, 0.42), (0.7, 0.08), 0.36, body, (0, 0.03, 0.94), -0.1),
        *(
            bar((x, 0.08, 1.13), (0.85 * x, 0.36, 0.9), 0.05, body._replace(shade=0.6))
            for x in (-0.3, 0, 0.3)
        ),
        *wheels,
        *both_sides(
            bar((0.53, r, 0.66), (0.53, r + 0.02, -0.58), 0.05, STEEL),
            slab(
                ring_piece(-0.58, big, big + 0.03, big + 0.11, 0.05 * np.pi, 0.95 * np.pi),
                0.26,
                body,
                0,
                (0.42, 0, 0),
                0.03,
            ),
            *(disc((0.26, 0.45, z), 0.09, 0.12, STEEL) for z in (-1.03, 1.0)),
        ),
        disc((0, y + fat + 0.02, 0.84), 0.12, 0.16, LAMP),
    ]


KINDS = (
    Kind(
        ("train", "locomotive", "steam train engine"),
        train,
        {"body": ("green", "blue"), "roof": ("black",), "wheels": ("red",)},
        {"roof": "a {} roof", "wheels": "{} wheels"},
    ),
)
