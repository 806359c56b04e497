"""Vessels: vases, a teapot, a mug, a bottle."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.household.palette import YELLOW
from export.everyday_objects.data.makers.household.pieces import aimed, bead, stout_leaf, sweep
from export.everyday_objects.data.makers.household.turning import band, disc_profile, smooth_profile, waved
from export.everyday_objects.data.shapes import (
    DARK,
    LEAF,
    Paint,
    Part,
    Vector,
    curve,
    ellipsoid,
    fixed,
    lathe,
    role,
    scaled,
    torus,
)

_COFFEE = fixed(0.27, 0.15, 0.08)


def _pot(
    profile: Sequence[tuple[float, float]], paint: Paint, wall: float = 0.07, depth: float = 0.6
) -> Part:
    """A vessel with a thick wall whose outside has the profile (rising), `depth` of it hollow."""
    top, bottom = profile[-1][1], profile[0][1]
    inner = [(max(r - wall, 0.02), y) for r, y in profile[::-1] if y > bottom + (1 - depth) * (top - bottom)]
    lip = [(profile[-1][0] - wall / 2, top + 0.03)]
    return lathe([(0, bottom), *profile, *lip, *inner, (0, inner[-1][1])], paint, sides=48)


def _vase_profile(rng: np.random.Generator) -> list[tuple[float, float]]:
    """The outside of a vase: round below with a flaring neck, or high-shouldered."""
    neck, belly = rng.uniform(0.19, 0.24), rng.uniform(0.44, 0.5)
    if rng.random() < 0.5:
        return smooth_profile(
            [
                (0.27, 0),
                (belly * 0.93, 0.28),
                (belly, 0.5),
                (belly * 0.75, 0.8),
                (neck, 1.03),
                (neck * 1.02, 1.16),
                (neck + 0.11, 1.32),
            ]
        )
    return smooth_profile(
        [
            (0.26, 0),
            (0.29, 0.1),
            (belly * 0.86, 0.5),
            (belly, 0.8),
            (belly * 0.8, 1.0),
            (neck, 1.12),
            (neck + 0.03, 1.22),
            (neck + 0.1, 1.3),
        ]
    )


def vase(rng: np.random.Generator) -> list[Part]:
    """A bulging vase with bands around."""
    profile = _vase_profile(rng)
    widest = max(profile)[1]
    return [
        _pot(profile, role("vase"), depth=0.3),
        band(profile, widest - 0.11, widest + 0.11, role("bands"), 0.025),
        band(profile, 0.0, 0.1, role("bands"), 0.03),
        band(profile, profile[-1][1] - 0.09, profile[-1][1] + 0.01, role("bands"), 0.03),
        lathe([(0, 0), (profile[-1][0] - 0.09, 0)], DARK, (0, profile[-1][1] - 0.12, 0)),
    ]


def _blossom(size: float, direction: Vector, at: Vector) -> list[Part]:
    """A flower of six petals with a yellow heart, facing a direction."""
    head = lathe(
        [(0, -0.3), (0.5, -0.22), (0.85, 0.1), (0.9, 0.22), (0.8, 0.24), (0.4, 0.0), (0, -0.05)],
        role("flowers"),
        sides=48,
    )
    head = scaled(waved(head, 6, 0.16), size)
    return [aimed(p, direction, at) for p in (head, bead((0.36 * size, 0.26 * size, 0.36 * size), YELLOW))]


def flowers(rng: np.random.Generator) -> list[Part]:
    """A stout vase with a dense dome of large blossoms among leaves."""
    belly, neck = rng.uniform(0.36, 0.42), rng.uniform(0.24, 0.28)
    profile = smooth_profile(
        [(0.24, 0), (belly, 0.28), (belly * 0.9, 0.48), (neck, 0.68), (neck + 0.08, 0.8)]
    )
    parts = [
        _pot(profile, role("vase"), depth=0.3),
        band(profile, 0.24, 0.38, role("vase", 0.75), 0.02),
        ellipsoid((0.48, 0.4, 0.48), LEAF, (0, 1.05, 0)),
    ]
    rings = [(1, 0.0, 0.0), (5, 0.85, rng.uniform(0, 1)), (7, 1.58, rng.uniform(0, 1))]
    for count, polar, start in rings:
        for i in range(count):
            a = start + 2 * np.pi * i / count
            out = np.array([np.sin(polar) * np.sin(a), np.cos(polar), np.sin(polar) * np.cos(a)])
            at = out * (0.52, 0.46, 0.52) + (0, 1.05, 0)
            parts += _blossom(rng.uniform(0.25, 0.29), out, at)
    for i in range(7):
        a = 2 * np.pi * (i + 0.5) / 7 + rings[2][2]
        parts.append(
            stout_leaf(
                0.42,
                fixed(0.28, 0.58, 0.2),
                (np.sin(a), -0.15, np.cos(a)),
                (0.28 * np.sin(a), 0.84, 0.28 * np.cos(a)),
            )
        )
    return parts


def teapot(rng: np.random.Generator) -> list[Part]:
    """A round teapot: spout to +x, handle to -x, a lid with a knob."""
    wide, high = rng.uniform(0.54, 0.6), rng.uniform(1.04, 1.18)
    profile = smooth_profile(
        [(0.28, 0), (wide * 0.87, 0.14), (wide, 0.38), (wide * 0.86, 0.62), (0.3, 0.78)], 24
    )
    spout = curve(
        [(wide - 0.14, 0.22, 0), (wide + 0.1, 0.34, 0), (wide + 0.17, 0.54, 0), (wide + 0.29, 0.7, 0)], 14
    )
    grip = curve(
        [
            (-wide * 0.8, 0.64, 0),
            (-wide - 0.08, 0.71, 0),
            (-wide - 0.24, 0.54, 0),
            (-wide - 0.18, 0.3, 0),
            (-wide * 0.88, 0.18, 0),
        ],
        24,
    )
    lid = smooth_profile([(0.34, 0.76), (0.33, 0.82), (0.22, 0.9), (0.06, 0.94), (0, 0.94)], 14)
    parts = [
        lathe([(0, 0), *profile, (0, 0.8)], role("pot"), sides=48),
        lathe([(0, -0.05), (0.32, -0.05), (0.33, 0.0), (0.27, 0.05)], role("lid")),
        band(profile, 0.31, 0.46, role("lid"), 0.018),
        sweep(spout, np.linspace(0.2, 0.1, 14), role("pot"), 18),
        aimed(bead((0.075, 0.02, 0.075), DARK), spout[-1] - spout[-2], spout[-1]),
        sweep(grip, 0.075, role("handle")),
        lathe([(0, 0.74), *lid], role("lid")),
        ellipsoid((0.11, 0.1, 0.11), role("handle"), (0, 1.02, 0)),
    ]
    return [scaled(p, (1, high, 1)) for p in parts]


def mug(rng: np.random.Generator) -> list[Part]:
    """A stout mug of coffee, its handle to +x, a broad stripe around it."""
    wide, high = rng.uniform(0.44, 0.5), rng.uniform(0.88, 1.0)
    belly = 0.05 if rng.random() < 0.5 else 0.0
    profile = smooth_profile(
        [(wide - 0.06, 0), (wide, 0.06), (wide + belly, high * 0.4), (wide, high - 0.05), (wide, high)]
    )
    grip = curve(
        [
            (wide - 0.05, high * 0.82, 0),
            (wide + 0.2, high * 0.84, 0),
            (wide + 0.36, high * 0.66, 0),
            (wide + 0.34, high * 0.38, 0),
            (wide + 0.16, high * 0.2, 0),
            (wide - 0.05, high * 0.2, 0),
        ],
        26,
    )
    return [
        _pot(profile, role("mug"), 0.075, 0.5),
        band(profile, high * 0.36, high * 0.64, role("stripe"), 0.018),
        sweep(grip, 0.085, role("handle")),
        lathe([(0, 0), (wide - 0.06, 0)], _COFFEE, (0, high - 0.1, 0)),
    ]


def bottle(rng: np.random.Generator) -> list[Part]:
    """A stout bottle with a label around and a cap."""
    wide, high = rng.uniform(0.32, 0.36), rng.uniform(0.98, 1.06)
    shoulder = rng.uniform(0.86, 0.96)
    profile = smooth_profile(
        [
            (wide - 0.05, 0),
            (wide, 0.05),
            (wide, 0.4),
            (wide, shoulder - 0.12),
            (wide * 0.82, shoulder),
            (0.16, shoulder + 0.2),
            (0.14, high + 0.3),
        ],
        48,
    )
    return [
        lathe([(0, 0), *profile, (0, high + 0.3)], role("bottle"), sides=40),
        band(profile, 0.2, shoulder - 0.22, role("label"), 0.018),
        torus(0.14, 0.045, role("bottle", 0.85), (0, high + 0.24, 0)),
        lathe(disc_profile(0.17, high + 0.26, high + 0.44, 0.04), role("cap")),
    ]


KINDS = (
    Kind(("vase",), vase, {"vase": ("blue", "white"), "bands": ("yellow", "orange")},
         {"bands": "{} bands"}, front=False),
    Kind(("vase with flowers", "flowers in a vase"), flowers,
         {"vase": ("blue", "white"), "flowers": ("pink", "red", "purple")}, {"flowers": "{} flowers"},
         front=False),
    Kind(("teapot",), teapot, {"pot": ("blue", "red"), "lid": ("white",), "handle": ("brown", "yellow")},
         {"lid": "a {} lid", "handle": "a {} handle"}, weight=1.2),
    Kind(("mug", "cup"), mug, {"mug": ("red", "blue"), "stripe": ("white",), "handle": ("white", "yellow")},
         {"stripe": "a {} stripe", "handle": "a {} handle"}, weight=1.2),
    Kind(("bottle",), bottle,
         {"bottle": ("green", "brown"), "label": ("white", "beige"), "cap": ("red", "yellow")},
         {"label": "a {} label", "cap": "a {} cap"}, front=False),
)  # fmt: skip
