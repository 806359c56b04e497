"""What flies: an airplane, a helicopter, a rocket."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.vehicles.outlines import polygon, rectangle
from export.everyday_objects.data.makers.vehicles.parts import CHASSIS, OUT, disc, slab
from export.everyday_objects.data.shapes import (
    DARK,
    GLASS,
    STEEL,
    Limb,
    Lump,
    Part,
    bar,
    blend,
    both_sides,
    curve,
    cushion,
    ellipsoid,
    fixed,
    lathe,
    loft,
    moved,
    role,
    torus,
    tube,
    turned,
)


def airplane(rng: np.random.Generator) -> list[Part]:
    """A toy airliner: a fat short fuselage, thick swept wings, two engines, a tall tail."""
    body, wing = role("body"), role("wings")
    fat, span, tail = rng.uniform(0.32, 0.36), rng.uniform(0.9, 1.0), rng.uniform(0.5, 0.58)
    hull = [
        (0.98, -0.05, 0.02, 0.02),
        (0.95, -0.04, 0.1, 0.1),
        (0.86, -0.03, 0.19, 0.18),
        (0.7, 0, 0.27, 0.26),
        (0.46, 0, 0.31, 0.31),
        (0.0, 0, 0.31, 0.31),
        (-0.35, 0.01, 0.29, 0.29),
        (-0.65, 0.06, 0.2, 0.2),
        (-0.9, 0.11, 0.11, 0.11),
        (-0.98, 0.13, 0.04, 0.05),
    ]
    k = fat / 0.31
    fuselage = loft([(z, y, w * k, h * k, 0) for z, y, w, h in hull], body)
    main = polygon((0.1, 0.36), (span, -0.22, 0.08), (span, -0.5, 0.12), (0.1, -0.22))
    small = polygon((0.0, -0.58), (0.46, -0.84, 0.06), (0.46, -1.04, 0.08), (0.0, -0.94))
    fin = polygon((-0.4, 0.14), (-0.76, tail + 0.16, 0.06), (-1.06, tail + 0.16, 0.08), (-0.94, 0.1))
    windows = [disc((0, 0.1, z), 0.075, 2 * fat + 0.03, GLASS, 0) for z in (-0.32, -0.1, 0.12, 0.34)]
    return [
        fuselage,
        slab(fin, 0.12, wing, edge=0.05),
        *windows,
        ellipsoid((0.25 * k, 0.13 * k, 0.22), GLASS, (0, 0.15 * k, 0.66)),
        *both_sides(
            turned(slab(main, 0.12, wing, 1, (0, -0.14, 0), 0.05), 2, 0.07),
            slab(small, 0.1, wing, 1, (0, 0.12, 0), 0.04),
            moved(
                turned(
                    lathe(
                        [(0, -0.24), (0.08, -0.24), (0.14, -0.05), (0.15, 0.16), (0.12, 0.2), (0, 0.14)], body
                    ),
                    0,
                    np.pi / 2,
                ),
                (0.5, -0.22, 0.14),
            ),
            disc((0.5, -0.22, 0.33), 0.11, 0.06, DARK),
        ),
    ]


def helicopter(rng: np.random.Generator) -> list[Part]:
    """A stout helicopter: an egg with a big glass nose, a short boom, four broad blades, thick skids."""
    body, blade = role("body"), role("blades")
    fat, boom, reach = rng.uniform(0.46, 0.5), rng.uniform(0.84, 0.92), rng.uniform(0.78, 0.86)
    shell = blend(
        [
            Lump((0, 0.6, 0.16), (fat, 0.44, 0.58)),
            Lump((0, 0.92, 0.0), (0.22, 0.18, 0.36)),
            Limb((0, 0.7, -0.3), (0, 0.78, -boom), 0.2, 0.11),
        ],
        body,
        0.12,
        0.032,
    )
    fin = polygon(
        (-boom + 0.24, 0.76), (-boom - 0.04, 1.14, 0.06), (-boom - 0.2, 1.14, 0.06), (-boom - 0.06, 0.7, 0.05)
    )
    paddle = polygon(
        (0.02, -0.05),
        (0.2, -0.11, 0.06),
        (reach, -0.11, 0.06),
        (reach, 0.11, 0.06),
        (0.2, 0.11, 0.06),
        (0.02, 0.05),
    )
    blades = [
        turned(slab(paddle, 0.1, blade, 1, (0, 1.2, 0.05), 0.03), 1, a, (0, 0, 0.05))
        for a in np.pi / 4 + np.arange(4) * np.pi / 2
    ]
    rotor = [
        turned(
            cushion((0.08, 0.5, 0.13), blade, (0.13, 0.86, -boom - 0.02), 4.0), 0, a, (0, 0.86, -boom - 0.02)
        )
        for a in (np.pi / 4, 3 * np.pi / 4)
    ]
    return [
        shell,
        ellipsoid((fat - 0.05, 0.32, 0.38), GLASS, (0, 0.68, 0.42)),
        cushion((0.1, 0.6, 0.8), body, (0, 0.74, 0.4), 2.5),
        slab(fin, 0.1, body),
        slab(rectangle((-0.3, 0.3), (-boom + 0.08, -boom + 0.26), 0.05), 0.09, body, 1, (0, 0.78, 0), 0.03),
        bar((0, 0.95, 0.05), (0, 1.2, 0.05), 0.08, CHASSIS),
        lathe([(0, 0.09), (0.1, 0.07), (0.14, 0), (0.14, -0.07), (0, -0.07)], CHASSIS, (0, 1.2, 0.05), 20),
        *blades,
        *rotor,
        disc((0.13, 0.86, -boom - 0.02), 0.07, 0.16, CHASSIS, 0),
        *both_sides(
            tube(
                list(
                    curve([(0.38, 0.14, 0.74), (0.38, 0.06, 0.6), (0.38, 0.06, 0.0), (0.38, 0.06, -0.44)], 10)
                ),
                0.06,
                CHASSIS,
            ),
            *(bar((0.38, 0.06, z), (0.24, 0.36, z), 0.055, CHASSIS) for z in (-0.12, 0.42)),
            disc((fat - 0.06, 0.56, -0.12), 0.12, 0.16, GLASS, 0),
        ),
    ]


def rocket(rng: np.random.Generator) -> list[Part]:
    """A fat cartoon rocket: pointed nose, round portholes, four swept fins, a nozzle."""
    body, fin = role("body"), role("fins")
    fat, tall = rng.uniform(0.38, 0.43), rng.uniform(0.94, 1.06)
    profile = [
        (0.0, 0.1),
        (0.24, 0.1),
        (0.29, 0.2),
        (0.37, 0.46),
        (0.4, 0.75),
        (0.38, 1.02),
        (0.34, 1.18),
        (0.29, 1.32),
    ]
    nose = [
        (0.3, 1.29),
        (0.33, 1.3),
        (0.32, 1.34),
        (0.25, 1.48),
        (0.16, 1.62),
        (0.07, 1.72),
        (0.03, 1.745),
        (0, 1.75),
    ]
    k, s = fat / 0.4, tall
    blade = polygon(
        (0.2, 0.66), (0.44, 0.58, 0.1), (0.72, 0.24, 0.12), (0.74, -0.06, 0.08), (0.5, 0.14, 0.12), (0.2, 0.2)
    )
    parts = [
        lathe([(r * k, y * s) for r, y in profile], body, sides=36),
        lathe([(r * k, y * s) for r, y in nose], fin, sides=36),
        lathe([(0, 0.12), (0.2, 0.12), (0.26, -0.04), (0.2, -0.04), (0, 0.05)], STEEL),
        lathe(
            [
                ((r + d) * k, y * s)
                for r, y, d in ((0.35, 0.4, -0.05), (0.35, 0.4, OUT), (0.39, 0.5, 0.03), (0.39, 0.5, -0.05))
            ],
            fin,
        ),
    ]
    for a in np.arange(4) * np.pi / 2:
        around = [
            turned(slab(blade, 0.12, fin, 2), 1, np.pi / 4),
            moved(turned(torus(0.15, 0.055, STEEL), 0, np.pi / 2), (0, 0.88 * s, 0.38 * k)),
            disc((0, 0.88 * s, 0.37 * k), 0.15, 0.1, fixed(0.3, 0.6, 0.85)),
        ]
        parts += [turned(p, 1, a) for p in around]
    return parts


KINDS = (
    Kind(
        ("airplane", "plane"),
        airplane,
        {"body": ("red", "blue"), "wings": ("white",)},
        {"wings": "{} wings"},
        weight=1.5,
    ),
    Kind(
        ("helicopter",),
        helicopter,
        {"body": ("blue", "red"), "blades": ("grey", "white")},
        {"blades": "{} blades"},
    ),
    Kind(
        ("rocket", "spaceship"),
        rocket,
        {"body": ("white",), "fins": ("red",)},
        {"fins": "{} fins"},
        front=False,
    ),
)
