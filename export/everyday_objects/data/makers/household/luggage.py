"""What people carry: a suitcase, a backpack, an umbrella."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.household.pieces import sweep
from export.everyday_objects.data.makers.household.turning import angles_around
from export.everyday_objects.data.shapes import (
    GOLD,
    STEEL,
    Part,
    bar,
    both_sides,
    curve,
    cushion,
    ellipsoid,
    lathe,
    loft,
    role,
)


def suitcase(rng: np.random.Generator) -> list[Part]:
    """An upright travel case: straps with buckles, corner caps, a handle on top."""
    w, h, d = rng.uniform(1.2, 1.32), rng.uniform(0.82, 0.92), rng.uniform(0.38, 0.44)
    grip = curve(
        [(-0.22, h / 2 - 0.02, 0), (-0.2, h / 2 + 0.16, 0), (0.2, h / 2 + 0.16, 0), (0.22, h / 2 - 0.02, 0)],
        18,
    )
    parts = [
        cushion((w, h, d), role("case"), roundness=9),
        cushion((w * 1.012, h * 1.016, 0.07), role("case", 0.6), roundness=9),
        sweep(grip, 0.062, role("straps")),
    ]
    for x in (-w * 0.27, w * 0.27):
        parts += [
            cushion((0.15, h + 0.05, d + 0.06), role("straps"), (x, 0, 0), 14),
            cushion((0.22, 0.15, 0.06), GOLD, (x, h * 0.22, d / 2 + 0.03), 8),
        ]
    for y in (-h / 2 + 0.085, h / 2 - 0.085):
        parts += both_sides(cushion((0.22, 0.22, d + 0.05), role("corners"), (w / 2 - 0.085, y, 0), 7))
    parts += [cushion((0.2, 0.14, 0.05), GOLD, (0, h * 0.3, d / 2 + 0.005), 8)]
    return parts


def backpack(rng: np.random.Generator) -> list[Part]:
    """A rounded backpack: a flap with a buckle, a front pocket, side pockets, two shoulder straps behind."""
    w, h, d = rng.uniform(0.92, 1.02), rng.uniform(1.15, 1.25), rng.uniform(0.48, 0.54)
    strap = curve(
        [
            (0.24, h * 0.92, -d * 0.4),
            (0.27, h * 0.9, -d * 0.75),
            (0.29, h * 0.55, -d * 0.85),
            (0.3, h * 0.2, -d * 0.7),
            (0.3, 0.08, -d * 0.4),
        ],
        20,
    )
    loop = curve(
        [(-0.15, h * 0.96, -0.12), (-0.13, h * 1.1, -0.12), (0.13, h * 1.1, -0.12), (0.15, h * 0.96, -0.12)],
        16,
    )
    return [
        loft(
            [
                (0, 0, w * 0.42, d * 0.4, 0),
                (0.04, 0, w * 0.47, d * 0.47, 0),
                (h * 0.3, 0, w * 0.5, d * 0.5, 0),
                (h * 0.7, 0, w * 0.49, d * 0.48, 0),
                (h * 0.88, 0, w * 0.42, d * 0.42, 0),
                (h * 0.97, 0, w * 0.3, d * 0.3, 0),
                (h, 0, w * 0.15, d * 0.15, 0),
            ],
            role("pack"),
            3.2,
            1,
            40,
        ),
        cushion((w * 0.76, h * 0.38, 0.26), role("pocket"), (0, h * 0.24, d * 0.5), 5),
        cushion((w * 0.8, h * 0.1, 0.3), role("pocket", 0.75), (0, h * 0.4, d * 0.5), 6),
        cushion((w * 0.92, h * 0.42, d * 1.06), role("pocket"), (0, h * 0.82, 0.02), 4),
        cushion((0.13, h * 0.5, 0.07), role("straps"), (0, h * 0.62, d * 0.55), 6),
        cushion((0.2, 0.16, 0.1), GOLD, (0, h * 0.5, d * 0.57), 6),
        *both_sides(
            cushion((0.2, h * 0.34, d * 0.66), role("pack", 0.78), (w * 0.5, h * 0.22, 0), 5),
            sweep(strap, 0.075, role("straps")),
        ),
        sweep(loop, 0.055, role("straps")),
    ]


def umbrella(rng: np.random.Generator) -> list[Part]:
    """An open umbrella: eight panels with a scalloped, coloured hem, a stout stick with a hook to +x."""
    high, long = rng.uniform(0.52, 0.6), rng.uniform(0.54, 0.62)
    t = np.linspace(0, 1, 14)
    r, y = 0.8 * np.sin(t * 1.5), high * np.cos(t * 1.5)
    profile = [*zip(r, y, strict=True), *zip(r[::-1] * 0.97, y[::-1] - 0.05, strict=True)]
    cloth = lathe(profile, role("canopy"), sides=96)
    x, y, z = cloth.vertices.T
    rib = np.abs(np.cos(4 * np.arctan2(x, z)))
    far = np.hypot(x, z) / 0.8
    cloth = cloth._replace(
        vertices=np.stack([x * (0.9 + 0.1 * rib), y + 0.11 * (1 - rib) * far**3, z * (0.9 + 0.1 * rib)], -1)
    )
    row = np.arange(len(cloth.faces)) % (len(cloth.faces) // 2) // 96
    hem, odd = (row >= 11) & (row <= 15), np.sin(4 * angles_around(cloth)) < 0
    stick = curve(
        [
            (0, -long, 0),
            (0.01, -long - 0.12, 0),
            (0.1, -long - 0.2, 0),
            (0.2, -long - 0.14, 0),
            (0.22, -long, 0),
        ],
        14,
    )
    return [
        cloth._replace(faces=cloth.faces[~hem & ~odd]),
        Part(cloth.vertices, cloth.faces[~hem & odd], role("canopy", 0.82)),
        Part(cloth.vertices, cloth.faces[hem], role("hem")),
        bar((0, high + 0.02, 0), (0, -long * 0.5, 0), 0.052, STEEL),
        bar((0, -long * 0.45, 0), (0, -long, 0), 0.075, role("handle")),
        sweep(stick, 0.075, role("handle")),
        ellipsoid((0.07, 0.1, 0.07), role("handle"), (0, high + 0.05, 0)),
    ]


KINDS = (
    Kind(("suitcase",), suitcase,
         {"case": ("red", "blue"), "straps": ("brown", "beige"), "corners": ("brown",)},
         {"straps": "{} straps", "corners": "{} corners"}),
    Kind(("backpack",), backpack,
         {"pack": ("blue", "green"), "pocket": ("orange", "yellow"), "straps": ("brown",)},
         {"pocket": "a {} pocket", "straps": "{} straps"}),
    Kind(("umbrella",), umbrella, {"canopy": ("red", "blue"), "hem": ("white",), "handle": ("brown",)},
         {"hem": "a {} hem", "handle": "a {} handle"}, front=False),
)  # fmt: skip
