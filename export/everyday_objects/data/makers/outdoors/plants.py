"""Plants: a cactus, a potted plant, a flower, a mushroom."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.outdoors.foliage import folded_leaf
from export.everyday_objects.data.makers.outdoors.placing import ring_of
from export.everyday_objects.data.shapes import (
    GOLD,
    LEAF,
    Paint,
    Part,
    Vector,
    box,
    curve,
    ellipsoid,
    fixed,
    lathe,
    moved,
    role,
    tube,
    turned,
)

_SOIL = fixed(0.27, 0.17, 0.1)


def _pot(radius: float, height: float, paint: Paint, rim: Paint) -> list[Part]:
    """A flower pot with a thick rim, full of soil, standing on y = 0."""
    r, lip = radius, 0.3 * height
    return [
        lathe([(0, 0), (0.66 * r, 0), (0.7 * r, 0.02), (0.9 * r, height - lip), (0, height - lip)], paint),
        lathe(
            [(0.8 * r, height - lip), (0.97 * r, height - lip), (r, height - lip + 0.02), (r, height - 0.02)]
            + [(0.97 * r, height), (0.84 * r, height), (0.82 * r, height - 0.05), (0.8 * r, height - lip)],
            rim,
        ),
        lathe([(0.83 * r, height - 0.05), (0, height - 0.025)], _SOIL),
    ]


def _ribbed(points: np.ndarray, radii: Sequence[float] | np.ndarray, ribs: int, name: str) -> list[Part]:
    """A tube with ribs along it, the grooves between them darker."""
    sides = 6 * ribs
    angle = np.arange(sides) * 2 * np.pi / sides
    plain = tube(list(points), list(radii), role(name), sides)
    rows = plain.vertices.reshape(-1, sides, 3)
    middle = rows.mean(1, keepdims=True)
    vertices = (middle + (rows - middle) * (1 + 0.08 * np.cos(ribs * angle))[:, None]).reshape(-1, 3)
    groove = np.cos(ribs * (angle + np.pi / sides))[np.arange(len(plain.faces)) % sides] < -0.6
    return [
        Part(vertices, plain.faces[~groove], role(name)),
        Part(vertices, plain.faces[groove], role(name, 0.66)),
    ]


def cactus(rng: np.random.Generator) -> list[Part]:
    """A ribbed saguaro with two arms in a flower pot, flowers on its tips."""
    tall, r, low = rng.uniform(0.8, 0.88), rng.uniform(0.145, 0.16), rng.uniform(0.22, 0.27)
    foot = 0.32

    def column(path: np.ndarray, radius: float) -> list[Part]:
        """A ribbed tube with a round end."""
        length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        left = np.clip((length[-1] - length) / radius, 0.0, 1.0)
        return _ribbed(path, radius * np.sqrt(np.maximum(1 - (1 - left) ** 2, 0.001)), 8, "cactus")

    y = np.concatenate(
        [[0.0], np.linspace(0.1, tall - r, 4), tall - r + r * np.sin(np.linspace(0.2, np.pi / 2, 7))]
    )
    parts = column(np.stack([0 * y, foot - 0.05 + y, 0 * y], -1), r)
    tips = [(0.0, foot - 0.05 + tall)]
    for s, start, up in ((1, low, rng.uniform(0.32, 0.38)), (-1, low + 0.12, rng.uniform(0.26, 0.32))):
        out, base = r + 0.18, foot + start
        bend = curve(
            [
                (0, base, 0),
                (s * out * 0.7, base, 0),
                (s * out, base + 0.13, 0),
                (s * out, base + up - 0.1, 0),
            ],
            12,
        )
        end = [(s * out, base + up - 0.1 + 0.1 * np.sin(a), 0) for a in np.linspace(0.2, np.pi / 2, 6)]
        parts += column(np.concatenate([bend, end]), 0.1)
        tips.append((s * out, base + up))
    for x, top in tips:
        petal = ellipsoid((0.045, 0.035, 0.07), role("flowers"), (0, 0.025, 0.06))
        bloom = [*ring_of([petal], 5), ellipsoid(0.045, GOLD, (0, 0.04, 0))]
        parts += [moved(p, (x, top - 0.02, 0)) for p in bloom]
    return [*parts, *_pot(0.29, 0.34, role("pot"), role("pot", 0.88))]


def plant(rng: np.random.Generator) -> list[Part]:
    """A potted plant: broad leaves with pale ribs, a drooping ring, a rising one and three upright."""
    reach, tall = rng.uniform(0.42, 0.47), rng.uniform(0.34, 0.4)
    u = np.linspace(0, 1, 18)
    blade = np.sin(np.pi * np.clip((u - 0.22) / 0.79, 0, 1) ** 0.85)
    widths = np.where(u < 0.97, 0.03, 0.012) + rng.uniform(0.15, 0.165) * np.maximum(blade, 0) ** 0.8

    def leaf(points: Sequence[Vector], size: float, shade: float) -> list[Part]:
        """A leaf with its rib."""
        path = curve(points, 18)
        rib = tube(list(path[2:-1] + (0, 0.012, 0)), 0.024, role("leaves", 1.35), 8)
        return [folded_leaf(path, size * widths, role("leaves", shade), 0.026, 0.18), rib]

    low = [
        (0, 0, 0.04),
        (0, 0.55 * tall, 0.35 * reach),
        (0, 0.6 * tall, 0.8 * reach),
        (0, 0.12 * tall, 1.15 * reach),
    ]
    high = [
        (0, 0, 0.03),
        (0, 0.95 * tall, 0.16 * reach),
        (0, 1.5 * tall, 0.5 * reach),
        (0, 1.38 * tall, 0.98 * reach),
    ]
    inner = [(0, 0, 0.0), (0, 1.1 * tall, 0.04), (0, 1.9 * tall, 0.14), (0, 2.35 * tall, 0.34)]
    leaves = [
        *ring_of(leaf(low, 1.0, 0.82), 6, 0.2),
        *ring_of(leaf(high, 1.0, 1.0), 5, 0.5),
        *ring_of(leaf(inner, 0.95, 1.15), 3, 0.1),
    ]
    return [*(moved(p, (0, 0.36, 0)) for p in leaves), *_pot(0.29, 0.4, role("pot"), role("pot", 0.88))]


def flower(rng: np.random.Generator) -> list[Part]:
    """A big single blossom that looks to the front, on a stout stem with two leaves, in a pot."""
    count, size, tall = 10, rng.uniform(0.36, 0.4), rng.uniform(0.78, 0.86)
    heart, stem, tilt = rng.uniform(0.17, 0.19), fixed(0.22, 0.52, 0.18), -0.18
    u = np.linspace(0, 1, 12)
    broad = 2.6 / count * size * np.sin(np.pi * np.clip(0.12 + 0.86 * u, 0, 1)) ** 0.7
    path = curve([(0, 0.05, 0), (0, size * 0.55, 0.05), (0, size, 0.02)], 12)
    petals = ring_of([folded_leaf(path, broad, role("petals"), 0.03, 0.1)], count, axis=2)
    behind = ring_of(
        [moved(folded_leaf(path, broad, role("petals", 0.92), 0.03, 0.1), (0, 0.01, -0.045))],
        count,
        np.pi / count,
        axis=2,
    )
    head = [
        *petals,
        *behind,
        ellipsoid((heart, heart, 0.09), role("center"), (0, 0, 0.04)),
        *ring_of([ellipsoid((0.03, 0.03, 0.02), role("center", 0.6), (0, heart * 0.55, 0.12))], 6, axis=2),
        ellipsoid((0.15, 0.15, 0.08), stem, (0, 0, -0.07)),
    ]
    parts = [moved(turned(p, 0, tilt), (0, tall + 0.1, 0.06)) for p in head]
    parts.append(
        tube(list(curve([(0, 0.2, 0), (0, tall * 0.6, -0.03), (0, tall + 0.08, -0.02)], 8)), 0.055, stem)
    )
    blade = curve([(0, 0, 0), (0, 0.1, 0.14), (0, 0.1, 0.26), (0, 0.03, 0.36)], 12)
    leaf = folded_leaf(blade, 0.12 * np.sin(np.pi * np.clip(0.08 + 0.9 * u, 0, 1)) ** 0.7, LEAF, 0.03, 0.25)
    parts += ring_of([moved(leaf, (0, 0.32, 0.02))], 2, np.pi / 2)
    return [*parts, *_pot(0.24, 0.28, role("pot"), role("pot", 0.88))]


def mushroom(rng: np.random.Generator) -> list[Part]:
    """A fat toadstool: domed cap with raised spots, gills, a ring around a bulging stem."""
    wide, high, tall = rng.uniform(0.5, 0.55), rng.uniform(0.4, 0.46), rng.uniform(0.5, 0.56)
    stem, t = role("stem"), np.linspace(0, np.pi / 2, 14)
    dome = [(wide * np.sin(a), high * np.cos(a) ** 0.9) for a in t]
    cap = lathe(
        [*dome, (wide * 0.985, -0.04), (wide * 0.93, -0.06), (wide * 0.85, -0.045)],
        role("cap"),
        (0, tall, 0),
        40,
    )
    gills = lathe([(wide * 0.86, -0.045), (wide * 0.5, 0.0), (0, 0.03)], role("stem", 0.82), (0, tall, 0), 40)
    blades = ring_of([box((0.025, 0.05, wide * 0.55), role("stem", 0.95), (0, tall - 0.03, wide * 0.52))], 16)
    foot = [(0, 0), (0.22, 0), (0.265, 0.06), (0.26, 0.14), (0.21, 0.3), (0.18, tall), (0, tall + 0.02)]
    skirt = [(0.17, tall - 0.1), (0.29, tall - 0.17), (0.29, tall - 0.2), (0.18, tall - 0.15)]
    parts = [cap, gills, *blades, lathe(foot, stem), lathe(skirt, role("stem", 0.93))]
    phase = rng.uniform(0, 0.2)
    spots = [
        (0.08, 0.0, 0.13),
        *((0.72, phase + k * 2 * np.pi / 5, 0.105) for k in range(5)),
        *((1.22, phase + 0.63 + k * 2 * np.pi / 5, 0.09) for k in range(5)),
    ]
    for polar, azimuth, size in spots:
        size *= rng.uniform(0.9, 1.1)
        steep = np.arctan2(np.sin(polar) / wide, np.cos(polar) / high)
        spot = turned(ellipsoid((size, 0.035, size), role("spots")), 0, steep)
        spot = moved(spot, (0, tall + high * np.cos(polar) ** 0.9, wide * np.sin(polar)))
        parts.append(turned(spot, 1, azimuth))
    return parts


KINDS = (
    Kind(
        ("cactus",),
        cactus,
        {"cactus": ("green",), "pot": ("orange",), "flowers": ("pink",)},
        {"pot": "a {} pot", "flowers": "{} flowers"},
    ),
    Kind(
        ("plant", "potted plant"),
        plant,
        {"leaves": ("green",), "pot": ("white", "orange")},
        {"pot": "a {} pot"},
        front=False,
    ),
    Kind(
        ("flower", "sunflower"),
        flower,
        {"petals": ("yellow", "pink"), "center": ("brown",), "pot": ("orange", "blue")},
        {"pot": "a {} pot"},
    ),
    Kind(
        ("mushroom", "toadstool"),
        mushroom,
        {"cap": ("red",), "spots": ("white",), "stem": ("beige",)},
        {"spots": "{} spots", "stem": "a {} stem"},
        front=False,
    ),
)
