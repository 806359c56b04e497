"""Birds: a bath duck, a songbird, an owl, a penguin, a chicken."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.creatures.parts import beady_eyes, patch, pillow, spike
from export.everyday_objects.data.shapes import (
    DARK,
    Limb,
    Lump,
    Part,
    bar,
    blend,
    both_sides,
    ellipsoid,
    fixed,
    moved,
    role,
    turned,
)


def duck(rng: np.random.Generator) -> list[Part]:
    """A bath duck: boat-shaped body with a perky tail, a big round head, a broad bill."""
    fat, head, tail = rng.uniform(0.95, 1.08), rng.uniform(0.29, 0.33), rng.uniform(0.5, 0.6)
    y, z = 0.52 + head * 0.75, 0.2
    skin = blend(
        [
            Lump((0, 0.3, 0), (0.4 * fat, 0.29, 0.48)),
            Lump((0, 0.3, 0.2), (0.34 * fat, 0.28, 0.32)),
            Limb((0, 0.38, -0.3), (0, tail, -0.56), 0.2, 0.06),
            Limb((0, 0.4, z), (0, y, z), 0.22, 0.2),
            Lump((0, y, z), (head, head * 0.96, head)),
        ],
        role("body"),
        0.1,
    )
    wing = blend(
        [
            Lump((0.36 * fat, 0.36, 0.02), (0.09, 0.16, 0.25)),
            Limb((0.38 * fat, 0.4, -0.1), (0.37 * fat, 0.5, -0.34), 0.08, 0.045),
        ],
        role("body", 0.86),
    )
    bill = [
        ellipsoid((0.15, 0.055, 0.17), role("bill"), (0, y - 0.045, z + head)),
        ellipsoid((0.12, 0.045, 0.13), role("bill", 0.82), (0, y - 0.105, z + head - 0.01)),
        ellipsoid((0.09, 0.07, 0.08), role("bill"), (0, y - 0.01, z + head - 0.02)),
    ]
    eyes = beady_eyes((head * 0.52, y + head * 0.28, z + head * 0.76), 0.06)
    return [skin, *both_sides(wing), *bill, *eyes]


def bird(rng: np.random.Generator) -> list[Part]:
    """A plump songbird on two feet: round head, short beak, pale breast, folded wings, a short tail."""
    fat, head, tilt = rng.uniform(0.95, 1.08), rng.uniform(0.24, 0.27), rng.uniform(0.0, 0.1)
    body: list[Limb | Lump] = [
        Lump((0, 0.5, 0), (0.31 * fat, 0.32, 0.37), -0.4),
        Lump((0, 0.8, 0.16), (head, head * 0.95, head)),
        *(Limb((s * 0.05, 0.46, -0.2), (s * 0.09, 0.42 + tilt, -0.64), 0.12, 0.065) for s in (-1, 1)),
    ]
    skin = blend(body, role("body"), 0.09)
    breast = [Lump((0, 0.42, 0.22), (0.26, 0.34, 0.3)), Lump((0, 0.2, 0.0), (0.2, 0.1, 0.3))]
    wing = blend(
        [
            Lump((0.29 * fat, 0.52, 0.0), (0.08, 0.19, 0.21), 0.3),
            Limb((0.3 * fat, 0.52, -0.05), (0.2 * fat, 0.5, -0.42), 0.08, 0.05),
        ],
        role("body", 0.68),
    )
    leg = [
        bar((0.12, 0.06, 0.02), (0.12, 0.3, 0), 0.05, role("beak")),
        ellipsoid((0.09, 0.05, 0.14), role("beak"), (0.12, 0.05, 0.07)),
    ]
    return [
        *patch(skin, breast, role("belly")),
        *both_sides(wing, *leg),
        spike((0, 0.79, 0.34), (0, 0.77, 0.34 + 0.22), 0.1, role("beak")),
        *beady_eyes((head * 0.62, 0.86, 0.16 + head * 0.74), 0.055),
    ]


def owl(rng: np.random.Generator) -> list[Part]:
    """An egg-shaped owl: two great eyes in pale discs, ear tufts, folded wings, a speckled belly."""
    fat, tall, tuft = rng.uniform(0.95, 1.06), rng.uniform(0.95, 1.05), rng.uniform(0.12, 0.18)
    y = 0.86 * tall
    skin = blend(
        [
            Lump((0, 0.45 * tall, 0), (0.37 * fat, 0.44 * tall, 0.33)),
            Lump((0, y, 0.02), (0.36, 0.28, 0.29)),
            *(
                Limb((s * 0.22, y + 0.16, 0.04), (s * 0.3, y + 0.24 + tuft, 0.06), 0.12, 0.045)
                for s in (-1, 1)
            ),
            Limb((0, 0.22, -0.2), (0, 0.13, -0.32), 0.16, 0.1),
        ],
        role("body"),
        0.1,
    )
    wing = blend(
        [
            Lump((0.36 * fat, 0.52 * tall, -0.02), (0.09, 0.27, 0.22)),
            Limb((0.37 * fat, 0.45 * tall, -0.06), (0.29 * fat, 0.14, -0.16), 0.1, 0.05),
        ],
        role("body", 0.68),
    )
    chevron = pillow([(-0.095, 0.04), (0, -0.075), (0.095, 0.04), (0, 0.0)], 0.1, role("body", 0.85))
    feathers = [
        moved(chevron, (x, h * tall, 0.33 * np.sqrt(1 - (x / 0.37) ** 2 - ((h - 0.45) / 0.44) ** 2)))
        for x, h in ((-0.125, 0.5), (0.125, 0.5), (0.0, 0.38), (-0.125, 0.26), (0.125, 0.26))
    ]
    face = both_sides(ellipsoid((0.19, 0.2, 0.08), role("belly"), (0.16, y + 0.01, 0.25)))
    eyes = both_sides(
        ellipsoid((0.125, 0.13, 0.06), role("eyes"), (0.155, y + 0.02, 0.31)),
        ellipsoid((0.075, 0.08, 0.04), DARK, (0.15, y + 0.02, 0.35)),
    )
    feet = both_sides(
        *(
            ellipsoid((0.055, 0.05, 0.11), fixed(0.9, 0.55, 0.12), (0.14 + d, 0.04, 0.3))
            for d in (-0.05, 0.05)
        )
    )
    return [
        *patch(skin, [Lump((0, 0.4 * tall, 0.3), (0.27, 0.36, 0.2))], role("belly")),
        *both_sides(wing),
        *feathers,
        *face,
        *eyes,
        *feet,
        spike((0, y - 0.02, 0.3), (0, y - 0.15, 0.4), 0.075, fixed(0.9, 0.55, 0.12)),
    ]


def penguin(rng: np.random.Generator) -> list[Part]:
    """A standing penguin: dark coat, white belly and face, flippers off the body, broad feet."""
    fat, head, out = rng.uniform(0.95, 1.08), rng.uniform(0.27, 0.3), rng.uniform(0.5, 0.58)
    skin = blend(
        [
            Lump((0, 0.45, 0), (0.36 * fat, 0.43, 0.32 * fat)),
            Lump((0, 0.92, 0.02), (head, head * 0.95, head)),
            *(Limb((s * 0.29, 0.68, 0), (s * out, 0.36, 0.03), 0.1, 0.055) for s in (-1, 1)),
            Limb((0, 0.2, -0.2), (0, 0.15, -0.31), 0.13, 0.075),
        ],
        role("body"),
        0.09,
    )
    patches = [
        Lump((0, 0.42, 0.3 * fat), (0.27 * fat, 0.38, 0.27)),
        *(Lump((s * 0.105, 0.93, head), (0.135, 0.15, 0.16)) for s in (-1, 1)),
        Lump((0, 0.84, head), (0.16, 0.11, 0.15)),
    ]
    return [
        *patch(skin, patches, role("belly")),
        *beady_eyes((0.11, 0.96, 0.02 + head * 0.88), 0.05),
        spike((0, 0.87, head - 0.04), (0, 0.85, head + 0.2), 0.095, role("beak")),
        *both_sides(
            ellipsoid((0.14, 0.06, 0.2), role("beak"), (0.17, 0.05, 0.16)),
            ellipsoid((0.05, 0.045, 0.09), role("beak"), (0.1, 0.045, 0.32)),
            ellipsoid((0.05, 0.045, 0.09), role("beak"), (0.22, 0.045, 0.32)),
        ),
    ]


def chicken(rng: np.random.Generator) -> list[Part]:
    """A round hen or rooster: upright neck, red comb and wattles, a fan of tail feathers, two stout legs."""
    fat, comb, tail = rng.uniform(0.95, 1.08), rng.uniform(0.95, 1.2), rng.uniform(0.9, 1.15)
    y, z = 1.02, 0.3
    skin = blend(
        [
            Lump((0, 0.52, -0.02), (0.31 * fat, 0.29, 0.4)),
            Lump((0, 0.5, 0.17), (0.27 * fat, 0.28, 0.27)),
            Limb((0, 0.6, 0.2), (0, y - 0.05, z), 0.23, 0.15),
            Lump((0, y, z), (0.17, 0.175, 0.18)),
            Limb((0, 0.6, -0.28), (0, 0.78, -0.44), 0.17, 0.12),
        ],
        role("body"),
        0.1,
        0.028,
    )
    wing = blend(
        [
            Lump((0.29 * fat, 0.55, 0.02), (0.09, 0.17, 0.21)),
            Limb((0.31 * fat, 0.55, 0), (0.27 * fat, 0.52, -0.28), 0.09, 0.05),
        ],
        role("tail"),
    )
    feathers = blend(
        [
            Limb((s * 0.04, 0.72, -0.36), (s * x, y1, z1), 0.1, 0.085)
            for s in (-1, 1)
            for x, y1, z1 in (
                (0.05, 0.74 + 0.36 * tail, -0.46),
                (0.1, 0.72 + 0.28 * tail, -0.64),
                (0.13, 0.68 + 0.1 * tail, -0.74),
            )
        ],
        role("tail"),
        0.03,
    )
    crest = [
        ellipsoid((0.06, 0.11 * comb, 0.085), role("comb"), (0, y + 0.19, z + d)) for d in (-0.11, 0.0, 0.1)
    ]
    wattles = both_sides(ellipsoid((0.05, 0.09, 0.05), role("comb"), (0.055, y - 0.14, z + 0.17)))
    gold = fixed(0.95, 0.66, 0.12)
    legs = both_sides(
        bar((0.14, 0.05, 0.02), (0.14, 0.32, 0.02), 0.055, gold),
        *(
            moved(turned(ellipsoid((0.055, 0.045, 0.13), gold, (0, 0.045, 0.07)), 1, a), (0.14, 0, 0.02))
            for a in (-0.5, 0.5, np.pi)
        ),
    )
    return [
        skin,
        *both_sides(wing),
        feathers,
        *crest,
        *wattles,
        *legs,
        spike((0, y - 0.01, z + 0.13), (0, y - 0.05, z + 0.32), 0.085, gold),
        *beady_eyes((0.125, y + 0.04, z + 0.115), 0.048),
    ]


KINDS = (
    Kind(("duck", "rubber duck"), duck, {"body": ("yellow",), "bill": ("orange",)}, {"bill": "a {} bill"}),
    Kind(
        ("bird", "songbird"),
        bird,
        {"body": ("blue", "red"), "belly": ("white", "beige"), "beak": ("orange", "yellow")},
        {"belly": "a {} belly", "beak": "a {} beak"},
    ),
    Kind(
        ("owl",),
        owl,
        {"body": ("brown",), "belly": ("beige", "white"), "eyes": ("yellow",)},
        {"belly": "a {} belly", "eyes": "{} eyes"},
    ),
    Kind(
        ("penguin",),
        penguin,
        {"body": ("black",), "belly": ("white",), "beak": ("orange",)},
        {"belly": "a {} belly", "beak": "a {} beak and feet"},
    ),
    Kind(
        ("chicken", "rooster", "hen"),
        chicken,
        {"body": ("white", "brown"), "tail": ("black",), "comb": ("red",)},
        {"tail": "{} wings and tail", "comb": "a {} comb"},
    ),
)
