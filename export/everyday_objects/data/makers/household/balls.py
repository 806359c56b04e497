"""Balls: a beach ball and a football."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.household.turning import angles_around, split_faces
from export.everyday_objects.data.shapes import Part, ellipsoid, lathe, role, turned


def ball(rng: np.random.Generator) -> list[Part]:
    """A beach ball: six or eight gores in two colours, a button at each pole; the axis leans."""
    count = 6 if rng.random() < 0.5 else 8
    t = np.linspace(0, np.pi, 33)
    skin = lathe(list(zip(np.sin(t), np.cos(t), strict=True)), role("ball"), sides=72 if count == 6 else 64)
    parts = split_faces(skin, np.sin(count / 2 * angles_around(skin)) < 0, role("panels"))
    parts += [
        ellipsoid(1.015, role("ball"), top=0, bottom=0.26),
        ellipsoid(1.015, role("ball"), top=np.pi - 0.26),
    ]
    lean = rng.uniform(0.3, 0.5)
    return [turned(turned(p, 2, -lean), 0, lean * 0.6) for p in parts]


def football(rng: np.random.Generator) -> list[Part]:
    """A football of hexagons with pentagons in a second colour; seams between the hexagons."""
    steps, g = 18, (1 + 5**0.5) / 2
    corners = np.array([v for a in (-1, 1) for b in (-g, g) for v in ((0, a, b), (a, b, 0), (b, 0, a))])
    u, v = np.array([(i, j) for i in range(steps + 1) for j in range(steps + 1 - i)]).T
    number = {(i, j): k for k, (i, j) in enumerate(zip(u.tolist(), v.tolist(), strict=True))}
    cells = [[number[i, j], number[i + 1, j], number[i, j + 1]] for i, j in number if i + j < steps]
    cells += [
        [number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]] for i, j in number if i + j < steps - 1
    ]
    share = np.stack([steps - u - v, u, v], -1) / steps
    points: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    kind: list[np.ndarray] = []
    middle = share[np.array(cells)].mean(1)
    for a in range(12):
        for b in range(a):
            for c in range(b):
                three = corners[[a, b, c]]
                if max(np.linalg.norm(three - np.roll(three, 1, 0), axis=1)) < 2.1:
                    faces.append(np.array(cells) + len(points) * len(share))
                    points.append(share @ three)
                    kind.append(np.where(middle.max(1) > 2 / 3, 2, np.where(middle.min(1) < 1 / steps, 1, 0)))
    skin = np.concatenate(points)
    skin /= np.linalg.norm(skin, axis=1, keepdims=True)
    skin, which = np.unique(skin.round(6), axis=0, return_inverse=True)
    every, paint = which.ravel()[np.concatenate(faces)], np.concatenate(kind)
    paints = (role("ball"), role("ball", 0.72), role("patches"))
    parts = [Part(skin, every[paint == k], p) for k, p in enumerate(paints)]
    turn = rng.uniform(0, 0.4)
    return [turned(turned(p, 0, 0.55), 1, turn) for p in parts]


KINDS = (
    Kind(("ball", "beach ball"), ball, {"ball": ("red", "blue"), "panels": ("white", "yellow")},
         {"panels": "{} panels"},
         front=False),
    Kind(("football", "soccer ball"), football, {"ball": ("white",), "patches": ("black",)},
         {"patches": "{} patches"},
         front=False),
)  # fmt: skip
