"""Objects of our own, in endless variations, where the catalogue is thin: each function returns a random one.

Furniture, vehicles, creatures and what stands outdoors have modules of their own.
"""

from collections.abc import Callable

import numpy as np

from export.everyday_objects import creatures, furniture, household, outdoors, vehicles
from export.everyday_objects.captions import COLOURS
from export.everyday_objects.catalogue import Model
from export.everyday_objects.shapes import Part, assemble, box, ellipsoid, lathe, pick, tilt, torus


def mushroom(rng: np.random.Generator) -> Model:
    """A stem, a cap, and often white spots."""
    cap, stem = pick(rng, "red", "red", "brown", *COLOURS), pick(rng, "white", "beige")
    h, r, w = rng.uniform(0.5, 0.9), rng.uniform(0.45, 0.7), rng.uniform(0.12, 0.2)
    height = rng.uniform(0.3, 0.55)
    parts = [
        lathe([(w * 1.25, 0), (w, h * 0.4), (w * 0.85, h * 1.1)], stem),
        ellipsoid((r, height, r), cap, (0, h, 0), 0, np.pi / 2),
        lathe([(r, h), (w, h - 0.02)], stem),
    ]
    if rng.random() < 0.6:
        for i in range(12):
            a, p = i * 2.4 + rng.uniform(0, 0.5), rng.uniform(0.15, 1.3)
            n = np.array([np.sin(p) * np.sin(a), np.cos(p), np.sin(p) * np.cos(a)])
            parts.append(ellipsoid((0.07,) * 3, np.array([0.97, 0.97, 0.95]), n * (r, height, r) + (0, h, 0)))
    return assemble(parts)


def house(rng: np.random.Generator) -> Model:
    """Walls of one colour, a gabled or hipped roof of another, a door and windows."""
    wall, roof = pick(rng, *COLOURS), pick(rng, "red", "brown", "grey", "black", "orange", "blue")
    w, h, d, r = rng.uniform(0.8, 1.2), rng.uniform(0.5, 0.9), rng.uniform(0.7, 1.2), rng.uniform(0.3, 0.6)
    over, hip = 0.08, rng.choice([0.0, 0.0, 0.25])
    x, z = w / 2 + over, d / 2 + over
    corners = np.array(
        [[-x, h, -z], [x, h, -z], [x, h, z], [-x, h, z], [0, h + r, -z + hip], [0, h + r, z - hip]]
    )
    slopes = np.array(
        [[0, 4, 5], [0, 5, 3], [1, 2, 5], [1, 5, 4], [3, 5, 2], [0, 1, 4], [0, 3, 2], [0, 2, 1]]
    )
    parts: list[Part] = [box((w, h, d), wall, (0, h / 2, 0))]
    if hip == 0:
        gable = np.array([[-w / 2, h, d / 2], [w / 2, h, d / 2], [0, h + r, d / 2], [-w / 2, h, -d / 2],
                          [w / 2, h, -d / 2],
                          [0, h + r, -d / 2]])  # fmt: skip
        parts.append((gable, np.array([[0, 1, 2], [3, 5, 4]]), wall))
        slopes = slopes[[0, 1, 2, 3]]
    parts.append((corners, slopes, roof))
    door = pick(rng, "brown", "red", "white", "black", "blue")
    glass = pick(rng, "blue", "white", "black", "yellow")
    parts.append(box((0.2, 0.36, 0.03), door, (0, 0.18, d / 2)))
    for s in (-1, 1):
        parts.append(box((0.2, 0.2, 0.03), glass, (s * w * 0.32, h * 0.6, d / 2)))
        parts.append(box((0.2, 0.2, 0.03), glass, (s * w * 0.25, h * 0.6, -d / 2)))
        parts.append(box((0.03, 0.2, 0.2), glass, (s * w / 2, h * 0.6, d * 0.22)))
        parts.append(box((0.03, 0.2, 0.2), glass, (s * w / 2, h * 0.6, -d * 0.22)))
    if rng.random() < 0.6:
        parts.append(
            box((0.14, 0.4, 0.14), pick(rng, "red", "brown", "grey"), (w * 0.25, h + r * 0.6, -d * 0.15))
        )
    return assemble(parts)


def rocket(rng: np.random.Generator) -> Model:
    """A body, a nose cone, fins, a window and a nozzle."""
    body, trim = (
        pick(rng, "white", "grey", *COLOURS),
        pick(rng, "red", "red", "blue", "orange", "yellow", "green"),
    )
    r, h, nose = rng.uniform(0.18, 0.28), rng.uniform(0.8, 1.1), rng.uniform(0.3, 0.5)
    t = np.linspace(0, 1, 10)
    parts = [
        lathe([(r * 0.75, 0), (r, h * 0.35), (r * 0.98, h * 0.8), (r * 0.85, h)], body),
        lathe([(r * 0.85 * np.sqrt(1 - v), h + nose * v) for v in t], trim),
        lathe([(r * 0.45, 0.02), (r * 0.6, -0.12)], np.array([0.25, 0.25, 0.27])),
        ellipsoid((0.09, 0.09, 0.04), pick(rng, "blue", "black"), (0, h * 0.7, r * 0.97)),
    ]
    for i in range(rng.choice([3, 4])):
        a = np.pi / 4 + i * np.pi / 2
        fin = np.array([[0, 0.4, r * 0.8], [0, -0.15, r + 0.28], [0, 0.1, r + 0.26], [0, 0.02, r * 0.6]])
        fins = np.concatenate([fin + (0.02, 0, 0), fin - (0.02, 0, 0)])
        sides = [
            [0, 1, 2],
            [0, 3, 1],
            [4, 6, 5],
            [4, 5, 7],
            [0, 2, 6],
            [0, 6, 4],
            [2, 1, 5],
            [2, 5, 6],
            [1, 3, 7],
            [1, 7, 5],
        ]
        parts.append(tilt((fins, np.array(sides), trim), 1, -a))
    return assemble(parts)


def donut(rng: np.random.Generator) -> Model:
    """A ring of dough with icing and sprinkles."""
    major, minor = 0.5, rng.uniform(0.19, 0.27)
    icing = pick(rng, "pink", "pink", "brown", "white", *COLOURS)
    parts = [
        torus(major, minor, np.array([0.82, 0.6, 0.34]) * rng.uniform(0.85, 1.1)),
        torus(major, minor * 1.07, icing, (-0.15, np.pi + 0.15), (0, 0.01, 0)),
    ]
    for _ in range(int(rng.choice([0, 40]))):
        a, b = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 2.6)
        q = major + minor * 1.08 * np.cos(b)
        at = (q * np.sin(a), minor * 1.08 * np.sin(b) + 0.01, q * np.cos(a))
        parts.append(ellipsoid((0.025, 0.02, 0.025), pick(rng, *COLOURS[:7], "white"), at))
    return assemble(parts)


def duck(rng: np.random.Generator) -> Model:
    """A rubber duck."""
    body, beak = pick(rng, "yellow", "yellow", *COLOURS), pick(rng, "orange", "orange", "red")
    s = rng.uniform(0.9, 1.1)
    parts = [
        ellipsoid((0.42, 0.33, 0.55), body, (0, 0.33, 0)),
        ellipsoid((0.28 * s, 0.28 * s, 0.28 * s), body, (0, 0.8, 0.25)),
        ellipsoid((0.12, 0.05, 0.16), beak, (0, 0.76, 0.25 + 0.3 * s)),
        tilt(ellipsoid((0.2, 0.1, 0.3), body, (0, 0.42, -0.5)), 0, 0.35),
    ]
    for side in (-1, 1):
        parts.append(
            ellipsoid((0.045,) * 3, np.array([0.03, 0.03, 0.03]), (side * 0.12, 0.88, 0.25 + 0.23 * s))
        )
        parts.append(ellipsoid((0.1, 0.17, 0.3), body, (side * 0.38, 0.38, -0.05)))
    return assemble(parts)


def snowman(rng: np.random.Generator) -> Model:
    """Three balls of snow, a carrot, buttons, often a hat and a scarf."""
    snow = np.array([0.95, 0.96, 0.98])
    coal = np.array([0.04, 0.04, 0.05])
    parts = [
        ellipsoid((0.42,) * 3, snow, (0, 0.4, 0)),
        ellipsoid((0.31,) * 3, snow, (0, 0.95, 0)),
        ellipsoid((0.22,) * 3, snow, (0, 1.37, 0)),
        tilt(lathe([(0.05, 0), (0.0, 0.28)], np.array([0.95, 0.5, 0.1]), (0, 0, 0), 12), 0, np.pi / 2),
    ]
    nose = parts[-1]
    parts[-1] = (nose[0] + (0, 1.36, 0.2), nose[1], nose[2])
    parts += [ellipsoid((0.035,) * 3, coal, (s * 0.08, 1.44, 0.19)) for s in (-1, 1)]
    parts += [ellipsoid((0.04,) * 3, coal, (0, y, 0.3)) for y in (0.85, 1.0)]
    if rng.random() < 0.7:
        hat = pick(rng, "black", "black", "red", "blue", "green")
        parts += [lathe([(0, 1.54), (0.3, 1.54), (0.3, 1.58), (0.19, 1.58), (0.19, 1.85), (0, 1.85)], hat)]
    if rng.random() < 0.6:
        parts.append(torus(0.2, 0.07, pick(rng, "red", "blue", "green", "yellow"), at=(0, 1.18, 0)))
    return assemble(parts)


def mug(rng: np.random.Generator) -> Model:
    """A cylinder with a handle to +x, hollow, sometimes filled."""
    colour = pick(rng, *COLOURS)
    r, h, t = rng.uniform(0.32, 0.42), rng.uniform(0.65, 0.95), 0.04
    taper = rng.uniform(0.85, 1.05)
    parts = [lathe([(0, 0), (r * taper, 0), (r, h), (r - t, h), ((r - t) * taper, t), (0, t)], colour)]
    ring = torus(h * 0.27, 0.05, colour)
    handle = tilt((ring[0] * (1.0, 1.0, 1.0), ring[1], ring[2]), 0, np.pi / 2)
    parts.append((handle[0] + (r * (0.5 + 0.5 * taper) + 0.02, h * 0.5, 0), handle[1], colour))
    if rng.random() < 0.4:
        parts.append(lathe([(0, h * 0.85), (r - t, h * 0.85)], pick(rng, "brown", "black")))
    return assemble(parts)


def bottle(rng: np.random.Generator) -> Model:
    """A body, shoulders, a neck, a stopper, often a label."""
    colour, stopper = pick(rng, *COLOURS), pick(rng, *COLOURS)
    r, h, neck = rng.uniform(0.14, 0.2), rng.uniform(0.4, 0.6), rng.uniform(0.045, 0.07)
    rise = rng.uniform(0.08, 0.2)
    parts = [
        lathe(
            [(0, 0), (r, 0), (r, h), (r * 0.8, h + rise * 0.5), (neck, h + rise), (neck, h + rise + 0.2)],
            colour,
        )
    ]
    parts.append(
        lathe([(neck * 1.25, h + rise + 0.16), (neck * 1.25, h + rise + 0.24), (0, h + rise + 0.24)], stopper)
    )
    if rng.random() < 0.6:
        parts.append(lathe([(r * 1.01, h * 0.3), (r * 1.01, h * 0.75)], pick(rng, "white", *COLOURS)))
    return assemble(parts)


def vase(rng: np.random.Generator) -> Model:
    """A smooth random profile, open at the top."""
    colour = pick(rng, *COLOURS)
    knots = np.array(
        [
            rng.uniform(0.12, 0.2),
            rng.uniform(0.22, 0.36),
            rng.uniform(0.16, 0.3),
            rng.uniform(0.07, 0.14),
            rng.uniform(0.1, 0.2),
        ]
    )
    t = np.linspace(0, 1, 25)
    profile = np.interp(t, np.linspace(0, 1, 5), knots)
    profile = np.convolve(np.pad(profile, 3, mode="edge"), np.ones(7) / 7, "valid")
    outer = list(zip(profile, t * rng.uniform(0.7, 1.0), strict=True))
    parts = [lathe([(0, 0), *outer, *((max(x - 0.025, 0.01), y) for x, y in outer[::-1]), (0, 0.04)], colour)]
    if rng.random() < 0.3:
        a = int(rng.integers(6, 14))
        parts.append(lathe([(x + 0.006, y) for x, y in outer[a : a + 4]], pick(rng, *COLOURS)))
    return assemble(parts)


def ball(rng: np.random.Generator) -> Model:
    """A ball: plain, or with bands of two colours."""
    first, second = pick(rng, *COLOURS), pick(rng, *COLOURS)
    if rng.random() < 0.5:
        return assemble([ellipsoid((0.5,) * 3, first)])
    cuts = np.linspace(0, np.pi, int(rng.choice([3, 4, 6])))
    zones = [
        ellipsoid((0.5,) * 3, (first, second)[i % 2], top=cuts[i], bottom=cuts[i + 1])
        for i in range(len(cuts) - 1)
    ]
    return assemble(zones)


def ice_cream(rng: np.random.Generator) -> Model:
    """A cone with one to three scoops."""
    parts = [lathe([(0.0, -0.75), (0.27, 0.0), (0.24, 0.02)], np.array([0.85, 0.62, 0.35]))]
    first = pick(rng, "pink", "white", "brown", *COLOURS)
    for i in range(int(rng.integers(1, 4))):
        colour = first if rng.random() < 0.6 else pick(rng, *COLOURS)
        parts.append(ellipsoid((0.29 - 0.02 * i, 0.27, 0.29 - 0.02 * i), colour, (0, 0.12 + 0.33 * i, 0)))
    return assemble(parts)


def pumpkin(rng: np.random.Generator) -> Model:
    """A ribbed ellipsoid with a stalk."""
    colour = pick(rng, "orange", "orange", "orange", "white", "green")
    vertices, faces, _ = ellipsoid((0.5, rng.uniform(0.34, 0.45), 0.5), colour)
    angle = np.arctan2(vertices[:, 0], vertices[:, 2])
    ribs = 1 - 0.09 * np.abs(np.cos(angle * rng.integers(4, 7))) ** 3
    stalk = lathe([(0.07, 0.3), (0.045, 0.5), (0.06, 0.55), (0, 0.56)], pick(rng, "green", "brown"))
    return assemble([(vertices * np.stack([ribs, ribs**0.3, ribs], -1), faces, colour), stalk])


MAKERS: dict[str, Callable[[np.random.Generator], Model]] = {
    **furniture.MAKERS,
    **creatures.MAKERS,
    **vehicles.MAKERS,
    **outdoors.MAKERS,
    **household.MAKERS,
    "bottle": bottle,
    "vase": vase,
    "mushroom": mushroom, "house": house, "rocket": rocket, "donut": donut, "duck": duck, "snowman": snowman,
    "mug": mug,
    "ball": ball, "ice cream": ice_cream, "pumpkin": pumpkin,
}  # fmt: skip
