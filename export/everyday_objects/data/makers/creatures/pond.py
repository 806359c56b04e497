"""Animals of the pond: a turtle and a frog."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.creatures.parts import MOUTH, big_eyes, patch
from export.everyday_objects.data.shapes import (
    Limb,
    Lump,
    Part,
    blend,
    ellipsoid,
    grid_faces,
    moved,
    role,
    scaled,
    torus,
    tube,
)


def turtle(rng: np.random.Generator) -> list[Part]:
    """A turtle on four stout legs: a domed shell of big scutes with a rim, a friendly head held up."""
    wide, tall, neck = rng.uniform(0.46, 0.5), rng.uniform(0.52, 0.58), rng.uniform(0.0, 0.06)
    long, y = 0.52, 0.24
    skin = blend(
        [
            Limb((0, 0.28, 0.4), (0, 0.46 + neck, 0.66), 0.16, 0.14),
            Lump((0, 0.55 + neck, 0.72), (0.22, 0.21, 0.22)),
            Lump((0, 0.5 + neck, 0.84), (0.17, 0.13, 0.15)),
            *(
                Limb((s * 0.3, 0.26, z), (s * 0.37, 0.09, z * 1.15), 0.16, 0.135)
                for s in (-1, 1)
                for z in (0.32, -0.32)
            ),
            Limb((0, 0.22, -0.42), (0, 0.15, -0.66), 0.12, 0.06),
            Lump((0, 0.2, 0), (0.38, 0.12, 0.46)),
        ],
        role("body"),
    )

    def scute(x: float, z: float, size: float) -> Part:
        """A plate on the dome around the direction that looks down on (x, z)."""
        up = np.sqrt(max(1 - x * x - z * z, 0.0))
        angle = np.arange(6) * np.pi / 3 + (np.pi / 6 + np.arctan2(z, x))
        rows = []
        for reach, lift in ((1.0, 0.97), (0.93, 1.05), (0.7, 1.075), (0.0, 1.09)):
            ring = (x, up, z) + reach * size * np.stack([np.cos(angle), np.zeros(6), np.sin(angle)], -1)
            ring[:, 1] = np.sqrt(np.maximum(1 - ring[:, 0] ** 2 - ring[:, 2] ** 2, 0.02))
            ring /= np.linalg.norm(ring, axis=1, keepdims=True)
            rows.append(ring * lift)
        points = np.concatenate(rows) * (wide, tall, long) + (0, y, 0)
        return Part(points, grid_faces(4, 6), role("shell"))

    smile = [
        (0.165 * np.sin(t), 0.47 + neck + 0.03 * np.sin(t) ** 2, 0.845 + 0.14 * np.cos(t))
        for t in np.linspace(-1.2, 1.2, 11)
    ]
    around = np.arange(6) * np.pi / 3 + np.pi / 6
    scutes = [scute(0, 0, 0.36)] + [scute(0.64 * np.cos(a), 0.64 * np.sin(a), 0.29) for a in around]
    rim = scaled(torus(1.0, 0.12, role("body", 0.6), squash=1.4), (wide, 0.5, long))
    return [
        skin,
        *scutes,
        ellipsoid((wide, tall, long), role("body", 0.6), (0, y, 0), bottom=np.pi * 0.55),
        moved(rim, (0, y + 0.02, 0)),
        *big_eyes((0.145, 0.63 + neck, 0.83), 0.085, (0.5, 0.1, 1.0)),
        tube(smile, 0.022, MOUTH),
    ]


def frog(rng: np.random.Generator) -> list[Part]:
    """A sitting frog: eyes on top of its head, a mouth from side to side, folded hind legs, a pale belly."""
    fat, eye, high = rng.uniform(0.95, 1.08), rng.uniform(0.135, 0.155), rng.uniform(0.6, 0.66)
    skin = blend(
        [
            Lump((0, 0.36, -0.06), (0.36 * fat, 0.3, 0.4), -0.35),
            Lump((0, high, 0.16), (0.37, 0.22, 0.31)),
            *(Lump((s * 0.21, high + 0.19, 0.17), (eye, eye, eye)) for s in (-1, 1)),
            *(Limb((s * 0.34, 0.2, -0.28), (s * 0.46, 0.34, 0.06), 0.17, 0.13) for s in (-1, 1)),
            *(Limb((s * 0.46, 0.3, 0.04), (s * 0.45, 0.09, -0.12), 0.12, 0.09) for s in (-1, 1)),
            *(Limb((s * 0.45, 0.08, -0.12), (s * 0.5, 0.06, 0.22), 0.08, 0.08) for s in (-1, 1)),
            *(Limb((s * 0.24, 0.4, 0.24), (s * 0.21, 0.08, 0.36), 0.105, 0.085) for s in (-1, 1)),
            *(
                Lump((s * (0.21 + d), 0.055, 0.43), (0.055, 0.05, 0.1))
                for s in (-1, 1)
                for d in (-0.07, 0.05)
            ),
            *(Lump((s * (0.5 + d), 0.055, 0.28), (0.055, 0.05, 0.1)) for s in (-1, 1) for d in (-0.06, 0.06)),
        ],
        role("body"),
        0.06,
        0.027,
    )
    belly = [Lump((0, 0.3, 0.3), (0.2, 0.3, 0.2)), Lump((0, high - 0.16, 0.34), (0.3, 0.13, 0.24))]
    smile = [
        (0.375 * np.sin(t), high - 0.03 + 0.05 * np.sin(t) ** 2, 0.155 + 0.315 * np.cos(t))
        for t in np.linspace(-1.3, 1.3, 15)
    ]
    return [
        *patch(skin, belly, role("belly")),
        tube(smile, 0.026, MOUTH),
        *big_eyes((0.215, high + 0.205, 0.215), eye * 0.86, (0.3, 0.1, 1.0)),
    ]


KINDS = (
    Kind(("turtle", "tortoise"), turtle, {"body": ("green",), "shell": ("brown",)}, {"shell": "a {} shell"}),
    Kind(("frog",), frog, {"body": ("green",), "belly": ("yellow", "beige")}, {"belly": "a {} belly"}),
)
