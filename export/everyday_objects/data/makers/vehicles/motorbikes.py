"""A motorbike."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.vehicles.outlines import ring_piece
from export.everyday_objects.data.makers.vehicles.parts import CHASSIS, disc, one_wheel, slab
from export.everyday_objects.data.shapes import (
    DARK,
    LAMP,
    RED,
    STEEL,
    Lump,
    Part,
    bar,
    blend,
    both_sides,
    curve,
    cushion,
    ellipsoid,
    role,
    tube,
)


def motorbike(rng: np.random.Generator) -> list[Part]:
    """A stout motorbike: fat wheels under mudguards, a round tank, a seat, an engine, handlebars, a lamp."""
    body, seat, tyre = role("body"), role("seat"), role("wheels")
    r, fat, z = rng.uniform(0.36, 0.39), rng.uniform(0.95, 1.08), rng.uniform(0.6, 0.64)
    frame = blend(
        [
            Lump((0, 0.86, 0.16), (0.28 * fat, 0.2, 0.34), -0.15),
            Lump((0, 0.66, -0.2), (0.25 * fat, 0.17, 0.3)),
            Lump((0, 0.76, -0.58), (0.23 * fat, 0.12, 0.26), 0.25),
        ],
        body,
        0.1,
        0.03,
    )
    cushioned = tube(
        list(curve([(0, 0.86, -0.1), (0, 0.84, -0.32), (0, 0.93, -0.62)], 8)),
        [0.11, 0.14, 0.15, 0.14, 0.13, 0.13, 0.13, 0.1],
        seat,
    )
    cushioned.vertices[:, 0] *= 1.5 * fat
    return [
        frame,
        cushioned,
        *one_wheel((0, r, z), r, 0.32, tyre),
        *one_wheel((0, r, -z), r, 0.36, tyre),
        slab(ring_piece(z, r, r + 0.03, r + 0.12, 0.12 * np.pi, 0.95 * np.pi), 0.4, body, edge=0.05),
        slab(ring_piece(-z, r, r + 0.03, r + 0.12, 0.28 * np.pi, 0.98 * np.pi), 0.44, body, edge=0.05),
        cushion((0.5, 0.32, 0.46), STEEL, (0, 0.4, 0.02), 4.0),
        *(cushion((0.54, 0.07, 0.4), CHASSIS, (0, 0.36 + d, 0.04)) for d in (0.0, 0.14)),
        ellipsoid((0.2, 0.2, 0.18), body, (0, 1.0, 0.56)),
        disc((0, 0.99, 0.69), 0.165, 0.14, LAMP),
        bar((-0.42, 1.14, 0.32), (0.42, 1.14, 0.32), 0.055, STEEL),
        cushion((0.2, 0.12, 0.1), RED, (0, 0.82, -0.84)),
        *both_sides(
            bar((0.24, r, z), (0.2, 1.12, 0.38), 0.07, STEEL),
            bar((0.3, 1.14, 0.32), (0.5, 1.12, 0.26), 0.085, DARK),
            tube(
                list(curve([(0.2, 0.36, 0.2), (0.28, 0.24, 0.0), (0.3, 0.26, -0.4), (0.3, 0.36, -0.86)], 10)),
                list(np.linspace(0.07, 0.105, 10)),
                STEEL,
            ),
        ),
    ]


KINDS = (
    Kind(
        ("motorbike", "motorcycle"),
        motorbike,
        {"body": ("red", "blue"), "seat": ("black", "brown"), "wheels": ("black",)},
        {"seat": "a {} seat", "wheels": "{} wheels"},
        weight=1.3,
    ),
)
