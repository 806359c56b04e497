"""What people wear on their heads: a top hat, a helmet, a crown."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.household.palette import BLUE, GREEN
from export.everyday_objects.data.makers.household.pieces import aimed, bead, sweep
from export.everyday_objects.data.makers.household.plates import mirrored, patch_on_front
from export.everyday_objects.data.makers.household.turning import band, disc_profile, smooth_profile
from export.everyday_objects.data.shapes import (
    DARK,
    Part,
    both_sides,
    curve,
    ellipsoid,
    grid_faces,
    lathe,
    moved,
    role,
    scaled,
    torus,
    turned,
)


def hat(rng: np.random.Generator) -> list[Part]:
    """A top hat with a ribbon around and a curled brim."""
    wide, high, flare = rng.uniform(0.44, 0.48), rng.uniform(0.72, 0.85), rng.uniform(1.02, 1.14)
    crown = smooth_profile(
        [(wide, 0.0), (wide * 0.97, 0.15), (wide * 0.97, high * 0.5), (wide * flare, high - 0.03)], 24
    )
    brim = lathe(
        [(0, 0), (0.66, 0), (0.76, 0.05), (0.8, 0.1), (0.77, 0.13), (0.7, 0.1), (0.6, 0.075), (0, 0.075)],
        role("hat"),
        (0, -0.05, 0),
        48,
    )
    x, y, z = brim.vertices.T
    curl = rng.uniform(0.1, 0.2) * np.clip((np.abs(x) - 0.4) / 0.4, 0, 1) ** 2
    return [
        lathe([(0, 0), *crown, (wide * flare - 0.04, high), (0, high)], role("hat"), sides=48),
        brim._replace(vertices=np.stack([x * 0.97, y + curl, z], -1)),
        band(crown, 0.03, 0.24, role("band"), 0.022),
    ]


def helmet(rng: np.random.Generator) -> list[Part]:
    """A knight's helmet: a dome with a crest, a pointed visor with slits, a flaring neck, a plume."""
    high, nose = rng.uniform(0.95, 1.06), rng.uniform(0.7, 0.8)
    profile = smooth_profile(
        [(0.6, 0.0), (0.52, 0.1), (0.46, 0.26), (0.49, 0.5), (0.52, 0.75), (0.46, 1.02), (0.28, 1.22)], 28
    )
    skull = lathe([(0, 0), *profile, (0.14, 1.28), (0, 1.3)], role("helmet"), sides=48)
    ring = [(0.0, 0.24), (0.47, 0.3), (0.53, 0.45), (0.555, 0.6), (0.56, 0.78), (0.54, 0.9), (0.0, 0.94)]
    visor = lathe(ring, role("helmet", 0.82), sides=64)
    x, y, z = visor.vertices.T
    beak = 1 + np.clip(z, 0, None) / 0.56 * (nose / 0.56 - 1) * np.exp(-(((y - 0.62) / 0.3) ** 2))
    visor = visor._replace(vertices=np.stack([x, y, np.where(z > 0, z * beak, z * 0.7)], -1))
    plume = curve(
        [(0, 1.26, 0.16), (0, 1.44, 0.02), (0, 1.46, -0.26), (0, 1.22, -0.52), (0, 0.85, -0.68)], 16
    )
    hinge = lathe(disc_profile(0.12, 0, 0.07, 0.025), role("trim"), sides=24)
    parts = [
        skull,
        visor,
        band([(0.6, 0.0), (0.52, 0.1), (0.46, 0.26)], 0.0, 0.11, role("trim"), 0.04),
        band(profile, 0.93, 1.01, role("trim"), 0.03),
        patch_on_front(mirrored([(0, 0.71), (0.4, 0.74), (0.4, 0.85), (0, 0.84)]), visor, DARK),
        sweep(
            plume,
            [0.1, 0.16, 0.19, 0.2, 0.205, 0.21, 0.21, 0.21, 0.2, 0.195, 0.19, 0.18, 0.16, 0.13, 0.1, 0.05],
            role("plume"),
        ),
        *both_sides(moved(turned(hinge, 2, -np.pi / 2), (0.53, 0.78, 0.0))),
    ]
    for x0 in (0.05, 0.2):
        parts += both_sides(
            patch_on_front([(x0, 0.38), (x0 + 0.085, 0.38), (x0 + 0.085, 0.6), (x0, 0.6)], visor, DARK)
        )
    return [scaled(p, (1, high, 1.04)) for p in parts]


def crown(rng: np.random.Generator) -> list[Part]:
    """A crown: a ring with gems, points with balls on them, a lining that bulges inside."""
    count, high, low = 6, rng.uniform(0.72, 0.85), rng.uniform(0.34, 0.4)
    sides, wide = 24 * count, rng.uniform(0.56, 0.6)
    angle = np.arange(sides) * 2 * np.pi / sides
    edge = low + (high - low) * (1 - 2 * np.abs((angle * count / (2 * np.pi)) % 1 - 0.5)) * -1 + (high - low)
    rows = [
        (1.0, 0.0),
        (1.0, 0.3),
        (1.06, 0.7),
        (1.16, 1.0),
        (1.04, 1.0),
        (0.94, 0.6),
        (0.88, 0.0),
        (1.0, 0.0),
    ]
    grid = np.stack(
        [np.stack([wide * r * np.sin(angle), t * edge, wide * r * np.cos(angle)], -1) for r, t in rows]
    )
    parts = [
        Part(grid.reshape(-1, 3), grid_faces(len(rows), sides), role("crown")),
        band([(wide, 0.0), (wide, 1.0)], -0.02, 0.26, role("crown", 0.9), 0.035),
        torus(wide + 0.03, 0.05, role("crown"), (0, 0.27, 0)),
        torus(wide + 0.03, 0.05, role("crown"), (0, 0.0, 0)),
        ellipsoid((wide * 0.92, 0.36, wide * 0.92), role("lining"), (0, 0.2, 0)),
    ]
    for i in range(count):
        a = 2 * np.pi * i / count
        x, z = np.sin(a), np.cos(a)
        parts.append(ellipsoid(0.095, role("crown"), (1.12 * wide * x, high + 0.04, 1.12 * wide * z)))
        gem = aimed(bead((0.1, 0.06, 0.1), role("gems")), (x, 0, z))
        parts.append(moved(gem, ((wide + 0.04) * x, 0.135, (wide + 0.04) * z)))
        x, z = np.sin(a + np.pi / count), np.cos(a + np.pi / count)
        gem = aimed(bead((0.065, 0.045, 0.065), (BLUE, GREEN)[i % 2]), (x, 0, z))
        parts.append(moved(gem, ((wide + 0.04) * x, 0.135, (wide + 0.04) * z)))
    return parts


KINDS = (
    Kind(("hat", "top hat"), hat, {"hat": ("black",), "band": ("red", "white")}, {"band": "a {} band"},
         front=False),
    Kind(("helmet", "knight's helmet"), helmet,
         {"helmet": ("grey",), "plume": ("red", "blue"), "trim": ("yellow",)},
         {"plume": "a {} plume"}),
    Kind(("crown",), crown, {"crown": ("yellow",), "lining": ("red", "purple"), "gems": ("red",)},
         {"lining": "a {} lining", "gems": "{} gems"}, front=False),
)  # fmt: skip
