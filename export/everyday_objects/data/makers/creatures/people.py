"""People: a man, a woman, an astronaut."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.creatures.parts import beady_eyes
from export.everyday_objects.data.shapes import (
    GOLD,
    RED,
    SKIN,
    WHITE,
    Limb,
    Lump,
    Paint,
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

_SKINS = (SKIN, fixed(0.87, 0.65, 0.5), fixed(0.6, 0.4, 0.28))


def _face(y: float, size: float, skin: Paint) -> list[Part]:
    """Eyes, nose, smile and ears on a head of that size at that height."""
    smile = [
        (size * 0.42 * np.sin(t), y - size * (0.24 + 0.26 * np.cos(t)), size * 0.84)
        for t in np.linspace(-1.1, 1.1, 9)
    ]
    nose = Paint("", 1.0, (skin.rgb[0] * 0.94, skin.rgb[1] * 0.86, skin.rgb[2] * 0.82))
    return [
        *beady_eyes((size * 0.4, y + size * 0.08, size * 0.87), size * 0.18),
        ellipsoid((size * 0.15, size * 0.15, size * 0.15), nose, (0, y - size * 0.12, size * 0.98)),
        tube(smile, size * 0.085, fixed(0.45, 0.12, 0.1)),
        *both_sides(
            ellipsoid((size * 0.16, size * 0.24, size * 0.2), skin, (size * 0.97, y - size * 0.02, 0))
        ),
    ]


def _shoes(x: float, paint: Paint) -> list[Part]:
    """A pair of round-toed shoes on the ground."""
    shoe = blend(
        [
            Limb((x, 0.09, -0.02), (x * 1.05, 0.075, 0.12), 0.105, 0.095),
            Lump((x, 0.05, 0.06), (0.11, 0.05, 0.19)),
        ],
        paint,
    )
    return both_sides(shoe)


def person(rng: np.random.Generator) -> list[Part]:
    """A standing man: short hair, a shirt, arms a little off the body, trousers, shoes."""
    size, broad, leg = rng.uniform(0.265, 0.29), rng.uniform(0.95, 1.08), rng.uniform(0.46, 0.54)
    skin, hair, sleeve = _SKINS[rng.integers(3)], rng.random(), rng.uniform(0.5, 1.0)
    waist, shoulder = leg + 0.05, leg + 0.4
    y = shoulder + 0.04 + size
    start, end = np.array((0.2 * broad, shoulder - 0.02, 0)), np.array((0.4 * broad, leg + 0.06, 0.05))
    cuff = start + (0.45 + 0.4 * sleeve) * (end - start)
    sides = (np.array((-1.0, 1.0, 1.0)), np.ones(3))
    shirt = blend(
        [
            Limb((0, waist + 0.08, 0), (0, shoulder - 0.1, 0), 0.2 * broad, 0.19 * broad),
            *(Limb((0, shoulder - 0.08, 0), start * m, 0.13, 0.11) for m in sides),
            *(Limb(start * m, cuff * m, 0.11, 0.105) for m in sides),
        ],
        role("shirt"),
    )
    trousers = blend(
        [
            Lump((0, leg - 0.01, 0), (0.225 * broad, 0.13, 0.2)),
            *(Limb((s * 0.115, leg - 0.03, 0), (s * 0.135, 0.14, 0), 0.125, 0.11) for s in (-1, 1)),
        ],
        role("trousers"),
        0.03,
    )
    top = [
        Lump((0, y + size * 0.34, -size * 0.14), (size * 1.1, size * 0.92, size * 1.02)),
        Lump((0, y - size * 0.05, -size * 0.45), (size * 0.98, size * 0.82, size * 0.7)),
    ]
    if hair < 0.5:
        top.append(Lump((size * 0.25, y + size * 0.85, size * 0.45), (size * 0.62, size * 0.3, size * 0.42)))
    else:
        top += [
            Lump((s * size * 0.42, y + size * 0.78, size * 0.5), (size * 0.48, size * 0.3, size * 0.36))
            for s in (-1, 0, 1)
        ]
    return [
        shirt,
        trousers,
        blend(top, role("hair"), 0.05),
        ellipsoid((size, size * 1.02, size * 0.97), skin, (0, y, 0)),
        bar((0, shoulder - 0.06, 0), (0, y, 0), 0.11, skin),
        *_face(y, size, skin),
        torus(0.125, 0.04, role("shirt", 0.75), (0, shoulder + 0.015, 0)),
        *both_sides(
            bar(start, end, 0.085, skin, 0.9),
            ellipsoid((0.095, 0.105, 0.1), skin, end + (0.015, -0.04, 0.01)),
        ),
        *_shoes(0.14, role("shoes")),
    ]


def woman(rng: np.random.Generator) -> list[Part]:
    """A standing girl: long hair, a flared dress with puffed sleeves and a sash, shoes."""
    size, flare, hem = rng.uniform(0.265, 0.29), rng.uniform(0.33, 0.39), rng.uniform(0.26, 0.34)
    skin, length = _SKINS[rng.integers(3)], rng.uniform(0.3, 0.42)
    waist, shoulder = 0.66, 0.9
    y = shoulder + 0.03 + size
    skirt = [
        (0, hem),
        (flare, hem),
        (flare + 0.025, hem + 0.03),
        (flare * 0.88, hem + 0.14),
        (0.2, waist - 0.06),
        (0.155, waist),
        (0.17, waist + 0.1),
        (0.185, shoulder - 0.06),
        (0.13, shoulder + 0.01),
        (0, shoulder + 0.02),
    ]
    start, end = np.array((0.18, shoulder - 0.05, 0)), np.array((0.39, 0.52, 0.05))
    locks = blend(
        [
            Lump((0, y + size * 0.28, -size * 0.16), (size * 1.1, size * 0.9, size * 1.02)),
            Lump((0, y - size * 0.1, -size * 0.5), (size * 1.05, size * 0.95, size * 0.7)),
            *(
                Limb(
                    (s * 0.09, y - size * 0.4, -size * 0.66),
                    (s * 0.11, y - size * 0.4 - length, -size * 0.72),
                    0.14,
                    0.12,
                )
                for s in (-1, 1)
            ),
            *(
                Limb(
                    (s * size * 0.9, y, size * 0.05),
                    (s * size * 0.95, y - size * 0.95, -size * 0.15),
                    size * 0.3,
                    size * 0.28,
                )
                for s in (-1, 1)
            ),
            *(
                Limb(
                    (s * size * 0.06, y + size * 0.98, size * 0.4),
                    (s * size * 0.78, y + size * 0.4, size * 0.6),
                    size * 0.3,
                    size * 0.24,
                )
                for s in (-1, 1)
            ),
        ],
        role("hair"),
        0.05,
    )
    return [
        scaled(lathe(skirt, role("dress")), (1, 1, 0.9)),
        scaled(torus(0.16, 0.045, role("dress", 0.7), (0, waist, 0), squash=1.3), (1, 1, 0.93)),
        scaled(
            lathe(
                [
                    (flare - 0.01, hem + 0.01),
                    (flare + 0.045, hem + 0.02),
                    (flare + 0.03, hem + 0.08),
                    (flare - 0.03, hem + 0.09),
                ],
                role("dress", 0.7),
            ),
            (1, 1, 0.9),
        ),
        locks,
        ellipsoid((size, size, size * 0.97), skin, (0, y, 0)),
        bar((0, shoulder - 0.06, 0), (0, y, 0), 0.09, skin),
        *_face(y, size, skin),
        *both_sides(
            ellipsoid((0.12, 0.12, 0.12), role("dress"), start + (0.02, -0.01, 0)),
            bar(start, end, 0.075, skin, 0.9),
            ellipsoid((0.085, 0.095, 0.09), skin, end + (0.015, -0.04, 0.01)),
            bar((0.12, 0.1, 0), (0.11, 0.5, 0), 0.085, skin, 1.1),
        ),
        *_shoes(0.12, role("shoes")),
    ]


def astronaut(rng: np.random.Generator) -> list[Part]:
    """A chunky space suit: a ball helmet with a dark visor, a backpack, coloured boots and gloves."""
    helmet, fat, out = rng.uniform(0.32, 0.35), rng.uniform(0.95, 1.06), rng.uniform(0.42, 0.48)
    y = 0.82 + helmet
    sides = (np.array((-1.0, 1.0, 1.0)), np.ones(3))
    start, end = np.array((0.24 * fat, 0.74, 0)), np.array((out, 0.42, 0.08))
    suit = blend(
        [
            Limb((0, 0.45, 0), (0, 0.72, 0), 0.26 * fat, 0.25 * fat),
            *(Limb(start * m, end * m, 0.135, 0.12) for m in sides),
            *(Limb((s * 0.15, 0.38, 0), (s * 0.18, 0.16, 0), 0.155, 0.145) for s in (-1, 1)),
        ],
        role("suit"),
    )
    along = end - start
    lean = np.arctan2(along[0], -along[1])
    band = moved(turned(torus(0.125, 0.035, role("trim"), squash=1.5), 2, lean), start + 0.55 * along)
    boot = blend(
        [
            Limb((0.18, 0.15, 0), (0.18, 0.1, 0), 0.15, 0.14),
            Limb((0.18, 0.09, 0), (0.19, 0.085, 0.16), 0.13, 0.115),
        ],
        role("trim"),
    )
    visor = ellipsoid((helmet * 0.8, helmet * 0.64, helmet * 0.42), role("visor"), (0, y, helmet * 0.66))
    rim = turned(torus(helmet * 0.74, 0.045, role("suit", 0.8)), 0, np.pi / 2)
    return [
        suit,
        visor,
        ellipsoid((helmet * 1.05, helmet, helmet), role("suit"), (0, y, 0)),
        moved(scaled(rim, (1.0, 0.8, 1.0)), (0, y, helmet * 0.68)),
        moved(
            turned(ellipsoid((0.035, 0.1, 0.02), WHITE), 2, -0.7),
            (-helmet * 0.38, y + helmet * 0.28, helmet * 0.975),
        ),
        torus(0.2, 0.06, role("trim"), (0, 0.86, 0)),
        cushion((0.5, 0.5, 0.24), role("suit", 0.72), (0, 0.68, -0.33), 7),
        cushion((0.26, 0.18, 0.1), role("suit", 0.6), (0, 0.64, 0.25 * fat), 8),
        *(
            ellipsoid((0.035, 0.035, 0.025), c, (x, 0.64, 0.25 * fat + 0.05))
            for c, x in ((RED, -0.065), (GOLD, 0.065))
        ),
        *both_sides(
            boot,
            band,
            ellipsoid((0.125, 0.13, 0.13), role("trim"), end + (0.03, -0.07, 0.02)),
            moved(
                turned(lathe([(0, 0), (0.12, 0), (0.1, 0.06), (0, 0.06)], role("trim")), 2, -np.pi / 2),
                (helmet * 1.02, y, 0),
            ),
        ),
    ]


KINDS = (
    Kind(
        ("person", "man", "boy"),
        person,
        {
            "shirt": ("red", "green"),
            "trousers": ("blue", "black"),
            "hair": ("brown", "black"),
            "shoes": ("black", "brown"),
        },
        {"trousers": "{} trousers", "hair": "{} hair", "shoes": "{} shoes"},
        weight=1.3,
    ),
    Kind(
        ("woman", "girl"),
        woman,
        {"dress": ("red", "pink"), "hair": ("brown", "yellow"), "shoes": ("black", "red")},
        {"hair": "{} hair", "shoes": "{} shoes"},
    ),
    Kind(
        ("astronaut", "spaceman"),
        astronaut,
        {"suit": ("white",), "trim": ("orange", "blue"), "visor": ("black",)},
        {"trim": "{} boots and gloves", "visor": "a {} visor"},
    ),
)
