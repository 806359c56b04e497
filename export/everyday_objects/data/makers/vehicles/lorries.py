"""Lorries: a truck, a bus, a fire truck."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.vehicles.outlines import polygon, rectangle, wheel_arch
from export.everyday_objects.data.makers.vehicles.parts import CHASSIS, OUT, disc, narrowed, slab, wheel_pairs
from export.everyday_objects.data.shapes import (
    DARK,
    GLASS,
    LAMP,
    RED,
    STEEL,
    Part,
    bar,
    both_sides,
    box,
    cushion,
    ellipsoid,
    fixed,
    moved,
    role,
)

_SIREN = fixed(0.1, 0.35, 0.9)


def truck(rng: np.random.Generator) -> list[Part]:
    """A lorry: a rounded cab with big windows in front, behind it a box, or the bed of a dump truck."""
    body, load, tyre = role("body"), role("box"), role("wheels")
    r, top, tall = rng.uniform(0.25, 0.28), rng.uniform(1.14, 1.24), rng.uniform(1.24, 1.36)
    cab = [
        *polygon(
            (0.26, 0.26),
            (0.26, top, 0.1),
            (0.8, top, 0.14),
            (0.94, 0.72, 0.06),
            (1.0, 0.64, 0.08),
            (1.0, 0.26, 0.06),
        ),
        *wheel_arch(0.58, r, r + 0.06, 0.26),
    ]
    screen = polygon((0.5, 0.74), (0.94 + OUT, 0.74), (0.83 + OUT, top - 0.13), (0.5, top - 0.13))
    pane = polygon((0.42, 0.74, 0.05), (0.78, 0.74, 0.05), (0.7, top - 0.14, 0.05), (0.42, top - 0.14, 0.05))
    parts = [
        *narrowed(
            [
                slab(cab, 1.0, body, edge=0.1),
                slab(screen, 0.8, GLASS),
                slab(pane, 1.0 + 2 * OUT, GLASS, edge=0.02),
            ],
            0.7,
            top,
            0.9,
        ),
        box((0.8, 0.2, 1.84), CHASSIS, (0, 0.36, -0.02)),
        *wheel_pairs([(0.58, r), (-0.24, r), (-0.74, r)], 0.42, 0.26, tyre),
        cushion((1.06, 0.16, 0.16), STEEL, (0, 0.28, 1.0)),
        cushion((0.46, 0.18, 0.1), DARK, (0, 0.52, 1.0)),
        cushion((0.9, 0.12, 0.12), STEEL, (0, 0.36, -0.98)),
        *both_sides(
            disc((0.36, 0.52, 1.0), 0.11, 0.12, LAMP),
            ellipsoid((0.07, 0.12, 0.07), body, (0.56, 0.86, 0.8)),
            cushion((0.2, 0.12, 0.08), RED, (0.34, 0.36, -1.04)),
        ),
    ]
    if rng.random() < 0.6:
        back = rectangle((-1.0, 0.2), (0.54, tall), 0.08)
        parts += [
            slab(back, 1.1, load, edge=0.07),
            slab(rectangle((-1.0 - OUT, 0.2 + OUT), (0.5, 0.66), 0.04), 1.1 + 2 * OUT, body, edge=0.03),
            *both_sides(
                cushion((0.42, tall - 0.86, 0.08), load._replace(shade=0.82), (0.25, tall / 2 + 0.34, -1.0))
            ),
        ]
        return parts
    bed = polygon((-0.86, 0.52, 0.08), (0.12, 0.52, 0.08), (0.2, 1.06, 0.04), (-1.04, 1.06, 0.04))
    heap = ellipsoid((0.44, 0.22, 0.5), fixed(0.5, 0.36, 0.22), (0, 1.0, -0.42))
    ribs = (
        slab(rectangle((z - 0.07, z + 0.07), (0.56, 1.0), 0.02), 1.16, load._replace(shade=0.8))
        for z in (-0.66, -0.16)
    )
    return [
        *parts,
        *narrowed([slab(bed, 1.04, load, edge=0.05), *ribs], 0.5, 1.06, 1.1),
        slab(
            rectangle((-0.6, 0.6), (-1.06, 0.22), 0.06), 0.1, load._replace(shade=0.8), 1, (0, 1.05, 0), 0.03
        ),
        heap,
        slab(rectangle((-0.5, 0.5), (0.1, 0.66), 0.06), 0.12, load, 1, (0, top + 0.08, 0), 0.04),
    ]


def bus(rng: np.random.Generator) -> list[Part]:
    """A city bus: one long rounded box, a row of big windows, a roof of its own colour, a stripe."""
    body, roof, tyre = role("body"), role("roof"), role("wheels")
    r, top, half = rng.uniform(0.24, 0.27), rng.uniform(1.22, 1.32), rng.uniform(1.02, 1.1)
    panes = int(rng.choice([3, 4]))
    z = 0.62
    side = [
        *polygon(
            (-half, 0.18, 0.06),
            (-half, top, 0.12),
            (half - 0.02, top, 0.14),
            (half + 0.02, 0.6),
            (half + 0.02, 0.18, 0.06),
        ),
        *wheel_arch(z, r, r + 0.06, 0.18),
        *wheel_arch(-z, r, r + 0.06, 0.18),
    ]
    low, high = 0.66, top - 0.2
    step = (2 * half - 0.2) / panes
    windows = [
        slab(
            rectangle((-half + 0.1 + i * step + 0.06, -half + 0.1 + (i + 1) * step - 0.06), (low, high)),
            0.96 + 2 * OUT,
            GLASS,
            edge=0.02,
        )
        for i in range(panes)
    ]
    return [
        slab(side, 0.96, body, edge=0.1),
        box((0.7, 0.3, 2 * half - 0.2), CHASSIS, (0, 0.34, 0)),
        slab(rectangle((-half - 0.02, half + 0.02), (top - 0.04, top + 0.08), 0.1), 0.98, roof, edge=0.08),
        *(
            slab(
                rectangle((-0.26, 0.26), (z - 0.2, z + 0.2), 0.08),
                0.14,
                roof._replace(shade=0.84),
                1,
                (0, top + 0.1, 0),
            )
            for z in (-0.5, 0.42)
        ),
        slab(rectangle((-half - OUT, half + 0.02 + OUT), (0.5, 0.6), 0.02), 0.96 + 2 * OUT, roof, edge=0.03),
        *windows,
        slab(rectangle((-0.4, 0.4), (0.68, top - 0.16)), 2 * half + 0.1, GLASS, 2, (0, 0, 0.01), 0.02),
        *wheel_pairs([(z, r), (-z, r)], 0.4, 0.24, tyre),
        cushion((1.0, 0.16, 0.14), CHASSIS, (0, 0.24, half)),
        cushion((1.0, 0.16, 0.14), CHASSIS, (0, 0.24, -half)),
        *both_sides(
            disc((0.34, 0.41, half + 0.02), 0.1, 0.14, LAMP),
            cushion((0.18, 0.14, 0.1), RED, (0.34, 0.4, -half)),
        ),
    ]


def fire_truck(rng: np.random.Generator) -> list[Part]:
    """A fire engine: cab with blue lights, a long body with shutters and a stripe, a thick ladder on top."""
    body, trim, tyre = role("body"), role("ladder"), role("wheels")
    r, top, rise = rng.uniform(0.25, 0.28), rng.uniform(1.08, 1.16), rng.uniform(0.08, 0.16)
    side = [
        *polygon(
            (-1.0, 0.22, 0.06),
            (-1.0, 0.98, 0.08),
            (0.2, 0.98, 0.04),
            (0.24, top, 0.04),
            (0.9, top, 0.14),
            (1.0, 0.66, 0.06),
            (1.02, 0.22, 0.06),
        ),
        *wheel_arch(0.6, r, r + 0.06, 0.22),
        *wheel_arch(-0.56, r, r + 0.06, 0.22),
    ]
    screen = polygon((0.7, 0.66), (1.0 + OUT, 0.66), (0.92 + OUT, top - 0.12), (0.7, top - 0.12))
    rails = (bar((x, 1.1, 0.5), (x, 1.1 + rise, -1.0), 0.065, trim) for x in (-0.2, 0.2))
    rungs = [
        bar((-0.2, 1.1 + rise * t, 0.5 - 1.5 * t), (0.2, 1.1 + rise * t, 0.5 - 1.5 * t), 0.055, trim)
        for t in np.linspace(0.42, 0.95, 4)
    ]
    shift = top + 0.08 - 1.1
    ladder = [moved(p, (0, shift, 0)) for p in [*rails, *rungs]]
    return [
        slab(side, 1.0, body, edge=0.07),
        box((0.7, 0.3, 1.8), CHASSIS, (0, 0.36, 0)),
        slab(screen, 0.82, GLASS),
        slab(rectangle((0.34, 0.54), (0.68, top - 0.13), 0.05), 1.0 + 2 * OUT, GLASS, edge=0.02),
        slab(
            polygon(
                (0.63, 0.68, 0.05), (0.88, 0.68, 0.05), (0.82, top - 0.13, 0.05), (0.63, top - 0.13, 0.05)
            ),
            1.0 + 2 * OUT,
            GLASS,
            edge=0.02,
        ),
        slab(rectangle((-1.0 - OUT, 1.02 + OUT), (0.5, 0.61), 0.02), 1.0 + 2 * OUT, trim, edge=0.03),
        *(
            slab(rectangle((z - 0.25, z + 0.25), (0.66, 0.9), 0.04), 1.0 + 2 * OUT, STEEL, edge=0.02)
            for z in (-0.66, -0.1)
        ),
        *ladder,
        *wheel_pairs([(0.6, r), (-0.56, r)], 0.42, 0.26, tyre),
        cushion((1.06, 0.18, 0.16), trim, (0, 0.28, 1.02)),
        cushion((0.9, 0.14, 0.12), STEEL, (0, 0.28, -1.0)),
        cushion((0.5, 0.12, 0.08), RED, (0, 0.78, -1.0)),
        *both_sides(
            cushion((0.26, 0.16, 0.2), _SIREN, (0.31, top + 0.06, 0.72), 4.0),
            disc((0.36, 0.43, 1.02), 0.09, 0.12, LAMP),
        ),
    ]


KINDS = (
    Kind(
        ("truck", "lorry"),
        truck,
        {"body": ("red", "blue"), "box": ("white",), "wheels": ("black",)},
        {"box": "a {} box", "wheels": "{} wheels"},
        weight=1.4,
    ),
    Kind(
        ("bus",),
        bus,
        {"body": ("yellow", "red"), "roof": ("white",), "wheels": ("black",)},
        {"roof": "a {} roof", "wheels": "{} wheels"},
        weight=1.4,
    ),
    Kind(
        ("fire truck", "fire engine"),
        fire_truck,
        {"body": ("red",), "ladder": ("white",), "wheels": ("black",)},
        {"ladder": "a {} ladder", "wheels": "{} wheels"},
    ),
)
