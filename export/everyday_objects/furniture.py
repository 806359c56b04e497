"""Procedural furniture: each function returns a random piece, y up, front to +z.

Legs are stout: those of two latent pixels and less are lost in score distillation, and tables were slabs.
"""

from collections.abc import Callable

import numpy as np

from export.everyday_objects.captions import COLOURS
from export.everyday_objects.catalogue import Model
from export.everyday_objects.shapes import Part, assemble, bar, box, cushion, frustum, lathe, pick, tilt

WOODS = ("brown", "brown", "beige", "orange")


def legs(
    rng: np.random.Generator, x: float, z: float, height: float, colour: np.ndarray, thick: float
) -> list[Part]:
    """Four legs from the floor to `height` below (+-x, +-z), straight or splayed."""
    splay, taper = rng.choice([0.0, 0.0, 0.12]) * height, rng.uniform(1.0, 1.6)
    return [
        bar((sx * (x + splay), 0, sz * (z + splay)), (sx * x, height, sz * z), thick, colour, taper)
        for sx in (-1, 1)
        for sz in (-1, 1)
    ]


def shade(colour: np.ndarray, factor: float) -> np.ndarray:
    """A lighter or darker colour."""
    return np.clip(colour * factor, 0, 1)


def upholstered(rng: np.random.Generator, seat_width: float, seats: int) -> Model:
    """An armchair or a sofa: seat, back and two arms of rounded blocks, cushions on the seat, short legs."""
    colour = pick(rng, *COLOURS)
    pads = pick(rng, *COLOURS) if rng.random() < 0.12 else shade(colour, rng.uniform(0.95, 1.12))
    lift, base = rng.uniform(0.06, 0.2), rng.uniform(0.18, 0.28)
    depth, arm = rng.uniform(0.72, 0.9), rng.uniform(0.13, 0.22)
    arm_top, back_top = lift + base + rng.uniform(0.2, 0.32), lift + base + rng.uniform(0.45, 0.72)
    width, soft = seat_width + 2 * arm, rng.uniform(4, 10)
    thick = rng.uniform(0.15, 0.22)
    parts = [cushion((width, base, depth), shade(colour, 0.9), (0, lift + base / 2, 0), 10)]
    back = cushion((width - rng.choice([0.0, arm]), back_top - lift, thick), colour, (0, 0, 0), soft)
    back = tilt(back, 0, -rng.uniform(0, 0.22))
    parts.append((back[0] + (0, (back_top + lift) / 2, -depth / 2 + thick * 0.4), back[1], colour))
    for side in (-1, 1):
        x = side * (seat_width + arm) / 2
        parts.append(cushion((arm, arm_top - lift, depth), colour, (x, (arm_top + lift) / 2, 0), soft))
        if rng.random() < 0.3:
            roll = arm * 0.62
            parts.append(bar((x, arm_top, -depth / 2), (x, arm_top, depth / 2), roll, colour))
    for i in range(seats):
        x = (i - (seats - 1) / 2) * seat_width / seats
        y = lift + base
        parts.append(
            cushion(
                (seat_width / seats * 0.98, 0.16, depth - thick), pads, (x, y + 0.05, thick / 2 + 0.02), 5
            )
        )
        if rng.random() < 0.5:
            pad = tilt(cushion((seat_width / seats * 0.95, 0.36, 0.14), pads, (0, 0, 0), 5), 0, -0.2)
            parts.append(
                (pad[0] + (0, y + 0.28, -depth / 2 + thick + 0.06) + np.array([x, 0, 0]), pad[1], pads)
            )
    parts += legs(rng, width / 2 - 0.08, depth / 2 - 0.08, lift + 0.02, pick(rng, "black", *WOODS), 0.035)
    return assemble(parts)


def armchair(rng: np.random.Generator) -> Model:
    """One seat."""
    return upholstered(rng, rng.uniform(0.5, 0.66), 1)


def sofa(rng: np.random.Generator) -> Model:
    """Two or three seats."""
    seats = int(rng.integers(2, 4))
    return upholstered(rng, seats * rng.uniform(0.5, 0.62), seats)


def chair(rng: np.random.Generator) -> Model:
    """A seat on four legs and a back: a board, slats or rungs."""
    colour = pick(rng, *COLOURS, *WOODS)
    frame = colour if rng.random() < 0.75 else pick(rng, "black", "white", *WOODS)
    w, d, h = rng.uniform(0.42, 0.52), rng.uniform(0.42, 0.5), rng.uniform(0.42, 0.5)
    top, thick = h + rng.uniform(0.42, 0.6), rng.uniform(0.028, 0.042)
    parts = [cushion((w, rng.uniform(0.04, 0.09), d), colour, (0, h, 0), 9)]
    parts += legs(rng, w / 2 - 0.04, d / 2 - 0.04, h, frame, thick)
    lean, kind = rng.uniform(0, 0.12), rng.integers(3)
    posts = [
        ((s * (w / 2 - 0.03), h, -d / 2 + 0.03), (s * (w / 2 - 0.03), top, -d / 2 - lean)) for s in (-1, 1)
    ]
    if kind > 0:
        parts += [bar(low, high, thick, frame) for low, high in posts]
    if kind == 0:
        board = tilt(cushion((w, top - h - 0.05, 0.045), colour, (0, 0, 0), 8), 0, -lean)
        parts.append((board[0] + (0, (top + h) / 2 + 0.05, -d / 2 - lean / 2), board[1], colour))
    elif kind == 1:
        for y in np.linspace(h + 0.16, top - 0.05, int(rng.integers(2, 5))):
            z = -d / 2 + 0.03 - (lean + 0.03) * (y - h) / (top - h)
            parts.append(box((w, 0.06, 0.025), colour, (0, y, z)))
    else:
        parts.append(box((w, 0.08, 0.03), colour, (0, top - 0.03, -d / 2 - lean)))
        for x in np.linspace(-w / 2 + 0.09, w / 2 - 0.09, int(rng.integers(3, 6))):
            parts.append(bar((x, h, -d / 2 + 0.03), (x, top - 0.05, -d / 2 - lean), 0.014, colour))
    return assemble(parts)


def table(rng: np.random.Generator) -> Model:
    """A rectangular or round top on four legs or on one."""
    colour = pick(rng, *WOODS, *COLOURS)
    frame = colour if rng.random() < 0.7 else pick(rng, "black", "white", "grey", *WOODS)
    h, w = rng.uniform(0.5, 0.75), rng.uniform(0.9, 1.3)
    d, thick = w * rng.uniform(0.6, 1.0), rng.uniform(0.05, 0.1)
    if rng.random() < 0.25:
        r = w / 2.2
        parts = [lathe([(0, h), (r, h), (r, h + thick), (0, h + thick)], colour)]
        if rng.random() < 0.5:
            parts += [bar((0, 0, 0), (0, h, 0), 0.06, frame), lathe([(r * 0.55, 0), (0.06, 0.07)], frame)]
            return assemble(parts)
        return assemble(parts + legs(rng, r * 0.6, r * 0.6, h, frame, 0.05))
    parts = [box((w, thick, d), colour, (0, h + thick / 2, 0))]
    parts += legs(rng, w / 2 - 0.08, d / 2 - 0.08, h, frame, rng.uniform(0.05, 0.075))
    if rng.random() < 0.5:
        parts.append(box((w - 0.14, 0.09, d - 0.14), shade(frame, 0.92), (0, h - 0.045, 0)))
    return assemble(parts)


def bench(rng: np.random.Generator) -> Model:
    """A long seat of planks on legs, mostly with a back."""
    colour, frame = pick(rng, *WOODS, *COLOURS), pick(rng, "black", "grey", *WOODS)
    w, d, h = rng.uniform(1.2, 1.7), rng.uniform(0.38, 0.48), rng.uniform(0.4, 0.48)
    parts = [box((w, 0.05, d / 3 - 0.02), colour, (0, h, (i - 1) * d / 3)) for i in range(3)]
    back = rng.random() < 0.7
    for s in (-1, 1):
        x = s * (w / 2 - 0.12)
        parts += [box((0.07, h, 0.07), frame, (x, h / 2, z)) for z in (-d / 2 + 0.05, d / 2 - 0.05)]
        if back:
            parts.append(box((0.07, 0.45, 0.05), frame, (x, h + 0.22, -d / 2)))
    if back:
        parts += [box((w, 0.1, 0.035), colour, (0, h + y, -d / 2 + 0.04)) for y in (0.2, 0.36)]
    return assemble(parts)


def stool(rng: np.random.Generator) -> Model:
    """A round seat on four legs, low or high."""
    colour = pick(rng, *COLOURS, *WOODS)
    h, r = rng.uniform(0.4, 0.75), rng.uniform(0.16, 0.2)
    thick = rng.uniform(0.03, 0.09)
    seat = lathe([(0, h), (r, h), (r * 1.03, h + thick / 2), (r, h + thick), (0, h + thick)], colour)
    frame = colour if rng.random() < 0.6 else pick(rng, "black", "grey", *WOODS)
    return assemble([seat, *legs(rng, r * 0.65, r * 0.65, h, frame, 0.035)])


def bed(rng: np.random.Generator) -> Model:
    """A frame with a headboard, a mattress, a blanket and pillows; the foot to the front."""
    frame, blanket = pick(rng, *WOODS, *COLOURS), pick(rng, *COLOURS)
    w, d, h = rng.uniform(0.9, 1.6), 2.0, rng.uniform(0.25, 0.35)
    head = rng.uniform(0.75, 1.1)
    sheet = np.array([0.93, 0.93, 0.92])
    parts = [
        box((w, h * 0.6, d), frame, (0, h * 0.55, 0)),
        cushion((w * 0.96, 0.24, d * 0.97), sheet, (0, h + 0.08, 0), 10),
        cushion((w * 1.0, 0.25, d * 0.7), blanket, (0, h + 0.1, d * 0.15), 12),
        box((w, head, 0.07), frame, (0, head / 2, -d / 2)),
    ]
    if rng.random() < 0.5:
        parts.append(box((w, h + 0.25, 0.06), frame, (0, (h + 0.25) / 2, d / 2)))
    for x in (-w / 4, w / 4) if w > 1.2 else (0,):
        parts.append(cushion((0.45, 0.14, 0.32), sheet, (x, h + 0.26, -d / 2 + 0.25), 4))
    return assemble(parts)


def cabinet(rng: np.random.Generator) -> Model:
    """A box on short legs with drawers or doors and knobs."""
    colour = pick(rng, *WOODS, *COLOURS)
    w, h, d = rng.uniform(0.6, 1.1), rng.uniform(0.6, 1.1), rng.uniform(0.35, 0.5)
    front, knob = shade(colour, rng.choice([0.8, 1.15])), pick(rng, "black", "yellow", "grey")
    parts = [
        box((w, h, d), colour, (0, h / 2 + 0.08, 0)),
        *legs(rng, w / 2 - 0.06, d / 2 - 0.06, 0.1, colour, 0.03),
    ]
    columns, rows = (1, int(rng.integers(2, 5))) if rng.random() < 0.6 else (2, 1)
    for i in range(columns):
        for j in range(rows):
            x, y = (i - (columns - 1) / 2) * w / columns, 0.08 + (j + 0.5) * h / rows
            parts.append(box((w / columns * 0.9, h / rows * 0.86, 0.03), front, (x, y, d / 2)))
            parts.append(box((0.05, 0.05, 0.05), knob, (x * 0.3, y, d / 2 + 0.03)))
    return assemble(parts)


def bookcase(rng: np.random.Generator) -> Model:
    """Sides, shelves, a back and coloured books."""
    colour = pick(rng, *WOODS, *COLOURS)
    w, h, d, t = rng.uniform(0.6, 1.0), rng.uniform(1.2, 1.9), rng.uniform(0.25, 0.35), 0.04
    rows = int(rng.integers(3, 6))
    parts = [box((t, h, d), colour, (s * w / 2, h / 2, 0)) for s in (-1, 1)]
    parts.append(box((w, h, 0.02), shade(colour, 0.7), (0, h / 2, -d / 2)))
    parts += [box((w, t, d), colour, (0, y, 0)) for y in np.linspace(t / 2, h - t / 2, rows + 1)]
    step = (h - t) / rows
    for row in range(rows):
        x = -w / 2 + 0.05
        while rng.random() < 0.9 and x < w / 2 - 0.1:
            wide, tall = rng.uniform(0.04, 0.1), step * rng.uniform(0.55, 0.85)
            parts.append(
                box((wide, tall, d * 0.7), pick(rng, *COLOURS), (x + wide / 2, row * step + t + tall / 2, 0))
            )
            x += wide + 0.005
    return assemble(parts)


def lamp(rng: np.random.Generator) -> Model:
    """A foot, a pole and a shade; a table lamp or a floor lamp."""
    shade_colour, metal = pick(rng, *COLOURS), pick(rng, "black", "grey", "yellow", "white", "brown")
    r, tall, s = rng.uniform(0.13, 0.2), rng.uniform(0.35, 1.3), rng.uniform(0.18, 0.3)
    height = rng.uniform(0.2, 0.35)
    parts = [
        lathe([(0, 0), (r, 0), (r, 0.03), (0.03, 0.06), (0, 0.06)], metal),
        bar((0, 0, 0), (0, tall, 0), 0.02 if tall > 0.7 else rng.uniform(0.02, 0.08), metal),
        lathe([(s, tall - 0.05), (s * rng.uniform(0.5, 1.0), tall - 0.05 + height)], shade_colour),
    ]
    return assemble(parts)


def desk(rng: np.random.Generator) -> Model:
    """A top, a pedestal of drawers on one side, legs on the other."""
    colour = pick(rng, *WOODS, *COLOURS)
    w, d, h, side = rng.uniform(1.1, 1.5), rng.uniform(0.55, 0.7), 0.7, rng.choice([-1, 1])
    parts = [
        box((w, 0.05, d), colour, (0, h, 0)),
        box((0.36, h, d * 0.9), shade(colour, 0.92), (side * (w / 2 - 0.2), h / 2, 0)),
    ]
    for j in range(3):
        parts.append(
            box((0.3, 0.17, 0.03), shade(colour, 1.12), (side * (w / 2 - 0.2), 0.16 + j * 0.2, d * 0.45))
        )
    parts += [
        bar((-side * (w / 2 - 0.06), 0, z), (-side * (w / 2 - 0.06), h, z), 0.05, colour)
        for z in (-d / 2 + 0.06, d / 2 - 0.06)
    ]
    return assemble(parts)


def barrel(rng: np.random.Generator) -> Model:
    """Staves that bulge, with hoops."""
    colour, hoop = pick(rng, *WOODS, *COLOURS), pick(rng, "black", "grey")
    r, h, bulge = rng.uniform(0.26, 0.34), rng.uniform(0.7, 0.95), rng.uniform(1.12, 1.3)
    t = np.linspace(0, 1, 12)
    side = [(r * (1 + (bulge - 1) * np.sin(np.pi * v)), h * v) for v in t]
    parts = [lathe([(0, 0), *side, (0, h)], colour)]
    for v in (0.15, 0.85):
        q = r * (1 + (bulge - 1) * np.sin(np.pi * v)) + 0.01
        parts.append(lathe([(q, h * v - 0.03), (q, h * v + 0.03)], hoop))
    return assemble(parts)


def open_box(rng: np.random.Generator, w: float, h: float, d: float, colour: np.ndarray) -> Model:
    """Four walls and a floor, and four flaps that hang outwards."""
    inside, t = shade(colour, 0.6), 0.03
    parts = [box((w, t, d), inside, (0, t / 2, 0)), box((w * 0.98, t, d * 0.98), inside, (0, h * 0.55, 0))]
    parts += [box((t, h, d), colour, (s * w / 2, h / 2, 0)) for s in (-1, 1)]
    parts += [box((w, h, t), colour, (0, h / 2, s * d / 2)) for s in (-1, 1)]
    angle, flap = rng.uniform(0.2, 0.9), rng.uniform(0.2, 0.32)
    for s in (-1, 1):
        for axis, half, along in ((2, w / 2, d), (0, d / 2, w)):
            size = (flap, t, along) if axis == 2 else (along, t, flap)
            at = (s * flap / 2, 0, 0) if axis == 2 else (0, 0, s * flap / 2)
            turned = tilt(box(size, shade(colour, 1.1), at), axis, -s * angle if axis == 2 else s * angle)
            parts.append((turned[0] + ((s * half, h, 0) if axis == 2 else (0, h, s * half)), *turned[1:]))
    return assemble(parts)


def crate(rng: np.random.Generator) -> Model:
    """A box: open with four flaps, with a frame of boards, or now and then plain."""
    colour = pick(rng, *WOODS, *COLOURS)
    w, h, d = rng.uniform(0.5, 0.9), rng.uniform(0.4, 0.7), rng.uniform(0.5, 0.9)
    kind = rng.random()
    if kind < 0.5:
        return open_box(rng, w, h, d, colour)
    parts = [frustum((w, d), (w, d), h, colour, (0, 0, 0))]
    if kind < 0.9:
        edge = shade(colour, 0.75)
        parts += [
            box((0.07, h, 0.07), edge, (sx * w / 2, h / 2, sz * d / 2)) for sx in (-1, 1) for sz in (-1, 1)
        ]
        parts += [box((w, 0.07, 0.07), edge, (0, y, s * d / 2)) for y in (0.03, h) for s in (-1, 1)]
        parts += [box((0.07, 0.07, d), edge, (s * w / 2, y, 0)) for y in (0.03, h) for s in (-1, 1)]
    return assemble(parts)


MAKERS: dict[str, Callable[[np.random.Generator], Model]] = {
    "armchair": armchair, "sofa": sofa, "chair": chair, "table": table, "bench": bench, "stool": stool,
    "bed": bed, "cabinet": cabinet, "bookcase": bookcase, "lamp": lamp, "desk": desk, "barrel": barrel,
    "box": crate,
}  # fmt: skip
