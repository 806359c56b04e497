"""Sweets: a cake, a cupcake, a donut, an ice cream, pancakes."""

from collections.abc import Sequence

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.household.palette import BLUE, GREEN, YELLOW
from export.everyday_objects.data.makers.household.pieces import aimed, bead, sweep
from export.everyday_objects.data.makers.household.turning import (
    angles_around,
    disc_profile,
    split_faces,
    waved,
)
from export.everyday_objects.data.shapes import (
    RED,
    STEEL,
    WHITE,
    Paint,
    Part,
    Vector,
    bar,
    cushion,
    ellipsoid,
    fixed,
    grid_faces,
    lathe,
    moved,
    role,
    scaled,
    torus,
    turned,
)

_WAFFLE = fixed(0.88, 0.62, 0.3)
_FLAME = fixed(1.0, 0.75, 0.15)
_SPRINKLES = (YELLOW, BLUE, WHITE, GREEN, RED)


def _drops(
    rng: np.random.Generator, count: int, shortest: float, longest: float, narrow: float = 0.7
) -> np.ndarray:
    """How far something runs down, an array over the angles around: drops of uneven lengths."""
    place = np.arange(96) * count / 96
    length = rng.uniform(0.55, 1.0, count)[np.round(place).astype(int) % count]
    return shortest + (longest - shortest) * length * ((1 + np.cos(2 * np.pi * place)) / 2) ** narrow


def _running(
    profile: Sequence[tuple[float, float]], ends: np.ndarray, paint: Paint, starts: np.ndarray | float = 0.0
) -> Part:
    """A sheet along a profile of (radius, height), from the axis outwards and down, turned about the y axis.

    It goes from the part `starts` to the part `ends` of its length, arrays over the angles; its edges are
    folded in.
    """
    points = np.array(profile)
    length = np.append(0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    t = (starts + (ends - starts) * np.linspace(0, 1, 20)[:, None]) * length[-1]
    r, y = np.interp(t, length, points[:, 0]), np.interp(t, length, points[:, 1])
    inwards = np.stack([np.gradient(y, axis=0), -np.gradient(r, axis=0)])
    inwards *= 0.06 / (np.linalg.norm(inwards, axis=0) + 1e-9)
    r = np.concatenate([r[:1] + inwards[0, :1], r, r[-1:] + inwards[0, -1:]])
    y = np.concatenate([y[:1] + inwards[1, :1], y, y[-1:] + inwards[1, -1:]])
    angle = np.arange(len(ends)) * 2 * np.pi / len(ends)
    grid = np.stack([r * np.sin(angle), y, r * np.cos(angle)], -1)
    return Part(grid.reshape(-1, 3), grid_faces(len(grid), len(ends)), paint)


def _sprinkle(rng: np.random.Generator, at: Vector, normal: Vector, size: float = 0.075) -> Part:
    """A sugar sprinkle lying on a surface, any way round."""
    paint = _SPRINKLES[rng.integers(len(_SPRINKLES))]
    part = turned(bead((size, size * 0.45, size * 0.45), paint), 1, rng.uniform(0, np.pi))
    return aimed(part, normal, at)


def _tier(rng: np.random.Generator, radius: float, low: float, high: float) -> list[Part]:
    """A round cake with icing that runs down its side, and cream around its top and foot."""
    count = int(np.round(radius * 17))
    profile = [
        (0, high + 0.05),
        (radius - 0.04, high + 0.05),
        (radius + 0.02, high + 0.03),
        (radius + 0.04, high - 0.03),
        (radius + 0.04, low),
    ]
    total = radius + 0.05 + high - low
    ends = (radius + _drops(rng, count, 0.2 * (high - low), 0.8 * (high - low))) / total
    parts = [
        lathe(disc_profile(radius, low, high + 0.02, 0.02), role("cake"), sides=48),
        _running(profile, ends, role("icing")),
    ]
    for i in range(count):
        a = 2 * np.pi * (i + 0.5) / count
        x, z = np.sin(a), np.cos(a)
        parts.append(
            bead(
                (0.085, 0.085, 0.085), role("cream"), ((radius - 0.07) * x, high + 0.08, (radius - 0.07) * z)
            )
        )
        parts.append(
            bead((0.085, 0.075, 0.085), role("cream"), ((radius + 0.03) * x, low + 0.05, (radius + 0.03) * z))
        )
    return parts


def cake(rng: np.random.Generator) -> list[Part]:
    """A birthday cake on a plate, of one or two tiers, icing in drops, cream blobs, burning candles."""
    high, wide = rng.uniform(0.4, 0.46), rng.uniform(0.6, 0.66)
    parts = [lathe(disc_profile(wide + 0.14, -0.06, 0.01, 0.03), STEEL, sides=48), *_tier(rng, wide, 0, high)]
    count, ring, top = int(rng.integers(4, 7)), wide * 0.52, high
    if rng.random() < 0.5:
        top += 0.34
        parts += _tier(rng, wide * 0.62, high + 0.04, top)
        count, ring = 3, wide * 0.26
    for i in range(count):
        a = 2 * np.pi * i / count
        x, z = ring * np.sin(a), ring * np.cos(a)
        parts += [
            bar((x, top, z), (x, top + 0.27, z), 0.052, role("candles")),
            bead((0.055, 0.095, 0.055), _FLAME, (x, top + 0.35, z)),
        ]
    return parts


def cupcake(rng: np.random.Generator) -> list[Part]:
    """A pleated paper cup, a swirl of frosting, sprinkles and a cherry."""
    wide, high = rng.uniform(0.94, 1.06), rng.uniform(0.94, 1.08)
    cup = waved(
        lathe([(0, 0), (0.36, 0), (0.5, 0.48), (0.5, 0.52), (0, 0.52)], role("cup"), sides=96), 16, 0.045
    )
    parts = split_faces(cup, np.cos(16 * angles_around(cup)) < 0, role("cup", 0.8))
    t = np.linspace(0, 1, 90)
    turn, far = 2 * np.pi * 3.2 * t, 0.4 * (1 - t) ** 0.85
    path = np.stack([far * np.sin(turn), 0.56 + 0.52 * t, far * np.cos(turn)], -1)
    thick = (0.19 - 0.08 * t) * (1 - np.exp(-t * 14))
    parts += [
        sweep(path, thick, role("frosting")),
        ellipsoid((0.5, 0.2, 0.5), role("frosting"), (0, 0.56, 0)),
        lathe([(0.4, 0.5), (0.2, 0.9), (0, 1.1)], role("frosting")),
        bead(0.135, role("cherry"), (0, 1.22, 0)),
    ]
    for i in range(14):
        k = int(14 + i * 4.8)
        out = np.array([np.sin(turn[k]), 0.55, np.cos(turn[k])]) / np.hypot(1, 0.55)
        parts.append(_sprinkle(rng, path[k] + out * thick[k], out, 0.065))
    return [scaled(p, (wide, high, wide)) for p in parts]


def donut(rng: np.random.Generator) -> list[Part]:
    """A ring of dough with icing over its upper side and sprinkles."""
    ring, thick, squash = rng.uniform(0.41, 0.45), rng.uniform(0.26, 0.29), rng.uniform(0.92, 1.02)
    t = np.linspace(1.35 * np.pi, -0.4 * np.pi, 60)
    over = [(ring + (thick + 0.03) * np.cos(a), squash * (thick + 0.03) * np.sin(a)) for a in t]
    angle = np.arange(96) * 2 * np.pi / 96
    ends = 0.77 + 0.06 * np.cos(7 * angle + rng.uniform(0, 6)) + 0.04 * np.cos(4 * angle + rng.uniform(0, 6))
    parts = [
        torus(ring, thick, role("dough", 0.85), squash=squash),
        _running(over, ends, role("icing"), 0.1 + 0.03 * np.cos(5 * angle)),
    ]
    for i in range(34):
        a, b = 2.4 * i, np.pi / 2 + (-0.95, 0.1, 0.8, -0.4)[i % 4] + rng.uniform(-0.15, 0.15)
        out = np.array([np.cos(b) * np.sin(a), np.sin(b), np.cos(b) * np.cos(a)])
        at = (thick + 0.035) * out * (1, squash, 1) + ring * np.array([np.sin(a), 0, np.cos(a)])
        parts.append(_sprinkle(rng, at, out))
    return parts


def _scoop(rng: np.random.Generator, radius: float, y: float) -> list[Part]:
    """A ball of ice cream with a frayed edge below."""
    frill = waved(torus(radius * 0.86, radius * 0.2, role("scoops")), 9, 0.06, rng.uniform(0, 6))
    return [ellipsoid(radius, role("scoops"), (0, y, 0)), moved(frill, (0, y - radius * 0.42, 0))]


def ice_cream(rng: np.random.Generator) -> list[Part]:
    """A waffle cone with two scoops, sauce over the upper one, and a cherry."""
    low, high, deep = rng.uniform(0.42, 0.45), rng.uniform(0.36, 0.39), rng.uniform(0.86, 0.96)
    parts = [lathe([(0, 0), (0.07, 0.0), (0.39, deep), (0.3, deep), (0, deep)], _WAFFLE, sides=40)]
    t = np.linspace(0.12, 1, 24)
    for i in range(7):
        for way in (-1, 1):
            turn, far = 2 * np.pi * i / 7 + way * 1.5 * t, 0.07 + 0.32 * t
            path = np.stack([far * np.sin(turn), deep * t, far * np.cos(turn)], -1)
            parts.append(sweep(path, 0.026, fixed(0.66, 0.4, 0.16), 6))
    y = deep + low * 0.45
    top = y + low * 0.75 + high * 0.4
    parts += _scoop(rng, low, y) + _scoop(rng, high, top)
    a = np.linspace(0, 2.2, 30)
    over = [((high + 0.025) * np.sin(b), top + (high + 0.025) * np.cos(b)) for b in a]
    parts += [
        _running(over, _drops(rng, 6, 0.3, 0.8, 1.0), role("sauce")),
        bead(0.12, role("cherry"), (0, top + high + 0.07, 0)),
    ]
    return [scaled(p, (1.18, 1, 1.18)) for p in parts]


def pancakes(rng: np.random.Generator) -> list[Part]:
    """A stack of thick pancakes on a plate, syrup running down, a pat of butter."""
    count, wide, thick = int(rng.integers(4, 6)), rng.uniform(0.52, 0.57), rng.uniform(0.14, 0.16)
    plate = [(0, 0), (0.45, 0), (0.78, 0.08), (0.8, 0.12), (0.76, 0.13), (0.5, 0.06), (0, 0.06)]
    parts = [lathe(plate, role("plate"), sides=48)]
    y = 0.06
    for _ in range(count):
        cake_ = lathe(
            disc_profile(wide + rng.uniform(-0.02, 0.03), y, y + thick + 0.01, 0.07),
            role("pancakes"),
            sides=48,
        )
        up = np.abs(cake_.vertices[cake_.faces].mean(1)[:, 1] - y - thick / 2) > thick * 0.36
        shift = (rng.uniform(-0.03, 0.03), 0, rng.uniform(-0.03, 0.03))
        parts += [moved(p, shift) for p in split_faces(cake_, up, role("pancakes", 0.72))]
        y += thick
    over = [
        (0, y + 0.04),
        (wide - 0.07, y + 0.035),
        (wide + 0.02, y),
        (wide + 0.065, y - 0.07),
        (wide + 0.065, 0.1),
    ]
    ends = _drops(rng, 5, 0.29, 1.0, 2.2)
    parts += [
        _running(over, ends, role("syrup")),
        turned(
            cushion((0.3, 0.13, 0.3), fixed(1.0, 0.88, 0.45), (0, y + 0.1, 0), 8), 1, rng.uniform(0.2, 1.2)
        ),
    ]
    return parts


KINDS = (
    Kind(("cake", "birthday cake"), cake,
         {"icing": ("pink", "white"), "cake": ("brown", "beige"), "cream": ("white",),
          "candles": ("blue", "red")},
         {"candles": "{} candles"}, front=False),
    Kind(("cupcake", "muffin"), cupcake,
         {"frosting": ("pink", "white"), "cup": ("blue", "brown"), "cherry": ("red",)},
         {"cup": "a {} wrapper", "cherry": "a {} cherry"}, front=False),
    Kind(("donut", "doughnut"), donut, {"icing": ("pink", "brown"), "dough": ("orange",)},
         {"dough": "{} dough"}, front=False),
    Kind(("ice cream", "ice cream cone"), ice_cream,
         {"scoops": ("pink", "white"), "sauce": ("brown",), "cherry": ("red",)}, {"sauce": "{} sauce"},
         front=False),
    Kind(("pancakes", "stack of pancakes"), pancakes,
         {"pancakes": ("orange",), "syrup": ("brown",), "plate": ("white", "blue")},
         {"syrup": "{} syrup", "plate": "a {} plate"}, front=False),
)  # fmt: skip
