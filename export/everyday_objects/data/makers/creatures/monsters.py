"""Friendly monsters: a dinosaur and a dragon."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.creatures.parts import (
    MOUTH,
    big_eyes,
    curl,
    patch,
    pillow,
    sideways,
    spike,
)
from export.everyday_objects.data.shapes import (
    DARK,
    WHITE,
    Limb,
    Lump,
    Part,
    blend,
    both_sides,
    curve,
    ellipsoid,
    moved,
    role,
    scaled,
    tube,
    turned,
)


def dinosaur(rng: np.random.Generator) -> list[Part]:
    """A friendly tyrannosaur: big head with a row of teeth, tiny arms, thick legs, spikes down its back."""
    head, fat, tail = rng.uniform(0.95, 1.08), rng.uniform(0.95, 1.08), rng.uniform(0.2, 0.3)
    y, z = 1.06, 0.2
    skin = blend(
        [
            Lump((0, 0.5, -0.04), (0.29 * fat, 0.34, 0.31), -0.2),
            Limb((0, 0.6, 0.02), (0, y - 0.02, 0.1), 0.23, 0.18),
            Lump((0, y + 0.05, z), (0.28 * head, 0.24 * head, 0.26 * head)),
            Lump((0, y, z + 0.25), (0.235 * head, 0.14, 0.22 * head)),
            Lump((0, y - 0.22, z + 0.16), (0.2 * head, 0.085, 0.27), -0.1),
            *(Lump((s * 0.15, y + 0.2, z + 0.13), (0.11, 0.11, 0.11)) for s in (-1, 1)),
            *(Lump((s * 0.2, 0.32, -0.04), (0.16, 0.22, 0.21)) for s in (-1, 1)),
            *(Limb((s * 0.22, 0.28, -0.04), (s * 0.23, 0.1, 0.0), 0.15, 0.13) for s in (-1, 1)),
            *(Lump((s * 0.23, 0.075, 0.1), (0.15, 0.08, 0.2)) for s in (-1, 1)),
            *(Limb((s * 0.24, 0.68, 0.16), (s * 0.27, 0.56, 0.36), 0.085, 0.065) for s in (-1, 1)),
            Limb((0, 0.4, -0.2), (0, 0.22, -0.5), 0.23, 0.14),
            Limb((0, 0.22, -0.5), (0, tail, -0.78), 0.14, 0.055),
        ],
        role("body"),
        0.08,
        0.028,
    )
    belly = [Lump((0, 0.5, 0.3), (0.2, 0.34, 0.24)), Lump((0, 0.8, 0.3), (0.15, 0.16, 0.16))]
    path = curve(
        [(0, y + 0.24 * head, 0.16), (0, y + 0.02, -0.1), (0, 0.7, -0.24), (0, 0.46, -0.4), (0, 0.34, -0.6)],
        7,
    )
    spikes = []
    for i, place in enumerate(path):
        along = path[min(i + 1, 6)] - path[max(i - 1, 0)]
        out = np.array((0, -along[2], along[1])) / np.linalg.norm(along) * (-1 if along[2] > 0 else 1)
        out = out if out @ (place - (0, 0.5, 0.2)) > 0 else -out
        size = (0.13, 0.16, 0.18, 0.18, 0.17, 0.14, 0.12)[i]
        spikes.append(spike(place - out * 0.06, place + out * size, 0.1, role("spikes")))
    teeth = []
    for turn in (-1.2, -0.72, -0.24, 0.24, 0.72, 1.2):
        root = np.array((0.2 * head * np.sin(turn), y - 0.08, z + 0.25 + 0.18 * head * np.cos(turn)))
        teeth.append(spike(root, root + (0, -0.09, 0), 0.042, WHITE))
    return [
        *patch(skin, belly, role("belly")),
        *spikes,
        *teeth,
        ellipsoid((0.19 * head, 0.09, 0.25), MOUTH, (0, y - 0.13, z + 0.19)),
        *big_eyes((0.155, y + 0.21, z + 0.175), 0.09, (0.4, 0.0, 1.0)),
        *both_sides(
            ellipsoid((0.03, 0.03, 0.03), DARK, (0.08, y + 0.08, z + 0.25 + 0.185 * head)),
            *(ellipsoid((0.045, 0.04, 0.05), WHITE, (0.23 + d, 0.045, 0.29)) for d in (-0.09, 0.0, 0.09)),
        ),
    ]


def dragon(rng: np.random.Generator) -> list[Part]:
    """A stout dragon on four legs: raised neck, horns, spread wings, spikes, an arrow on its tail."""
    fat, span, horn = rng.uniform(0.95, 1.08), rng.uniform(0.95, 1.08), rng.uniform(0.16, 0.22)
    y, z = 0.98, 0.42
    skin = blend(
        [
            Lump((0, 0.42, -0.06), (0.29 * fat, 0.27, 0.42)),
            Limb((0, 0.5, 0.2), (0, y - 0.08, z - 0.06), 0.21, 0.14),
            Lump((0, y, z), (0.235, 0.21, 0.22)),
            Lump((0, y - 0.06, z + 0.22), (0.185, 0.135, 0.18)),
            *(Limb((s * 0.2, 0.36, 0.2), (s * 0.23, 0.1, 0.22), 0.14, 0.11) for s in (-1, 1)),
            *(Limb((s * 0.22, 0.34, -0.3), (s * 0.26, 0.1, -0.3), 0.17, 0.12) for s in (-1, 1)),
            *(Lump((s * 0.23, 0.07, 0.29), (0.12, 0.07, 0.15)) for s in (-1, 1)),
            *(Lump((s * 0.26, 0.07, -0.23), (0.13, 0.07, 0.15)) for s in (-1, 1)),
            Limb((0, 0.42, -0.36), (0, 0.24, -0.66), 0.19, 0.12),
            Limb((0, 0.24, -0.66), (0, 0.42, -0.88), 0.12, 0.07),
        ],
        role("body"),
        0.08,
        0.03,
    )
    belly: list[Limb | Lump] = [
        Limb((0, 0.4, 0.42), (0, y - 0.14, z + 0.12), 0.16, 0.1),
        Lump((0, 0.26, 0.25), (0.17, 0.2, 0.3)),
    ]
    wing = pillow(
        [
            (0.1, 0.5),
            (0.16, 0.74),
            (0.42, 1.1),
            (0.8, 1.18),
            (0.7, 0.92),
            (0.74, 0.68),
            (0.54, 0.7),
            (0.46, 0.5),
            (0.3, 0.58),
        ],
        0.12,
        role("wings"),
    )
    arm = curl(
        [(0.12, 0.56, 0), (0.24, 0.84, 0), (0.44, 1.08, 0), (0.78, 1.15, 0)],
        (0.08, 0.075, 0.065, 0.04),
        role("body"),
    )
    wings = [moved(turned(scaled(p, (span, 1, 1)), 1, 0.45), (0.06, 0, -0.14)) for p in (wing, arm)]
    back = [
        (y + 0.16, z - 0.14, 0.9),
        (0.8, 0.18, 0.35),
        (0.68, -0.02, 0.1),
        (0.66, -0.26, -0.1),
        (0.5, -0.52, -0.4),
    ]
    spikes = [
        spike((0, h - 0.06, d), (0, h + 0.13, d - 0.1 * t - 0.04), 0.085, role("spikes")) for h, d, t in back
    ]
    smile = [
        (0.18 * np.sin(t), y - 0.09 + 0.05 * np.sin(t) ** 2, z + 0.22 + 0.175 * np.cos(t))
        for t in np.linspace(-1.4, 1.4, 13)
    ]
    tip = sideways(pillow([(-0.8, 0.38), (-0.76, 0.56), (-0.98, 0.66), (-1.0, 0.44)], 0.16, role("spikes")))
    return [
        *patch(skin, belly, role("belly")),
        *spikes,
        tip,
        *both_sides(
            *wings,
            spike((0.13, y + 0.13, z - 0.06), (0.19, y + 0.19 + horn, z - 0.18), 0.085, role("spikes")),
            ellipsoid(0.032, DARK, (0.08, y + 0.005, z + 0.37)),
        ),
        *big_eyes((0.155, y + 0.08, z + 0.13), 0.088, (0.6, 0.1, 1.0)),
        tube(smile, 0.022, MOUTH),
    ]


KINDS = (
    Kind(
        ("dinosaur", "t-rex", "tyrannosaurus"),
        dinosaur,
        {"body": ("green",), "belly": ("beige", "yellow"), "spikes": ("orange", "purple")},
        {"belly": "a {} belly", "spikes": "{} spikes"},
    ),
    Kind(
        ("dragon",),
        dragon,
        {
            "body": ("green", "red"),
            "wings": ("orange", "purple"),
            "belly": ("beige", "yellow"),
            "spikes": ("yellow", "white"),
        },
        {"wings": "{} wings", "belly": "a {} belly", "spikes": "{} spikes and horns"},
    ),
)
