"""Cupboards: a cabinet and a bookcase."""

import numpy as np

from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.makers.furniture.joinery import block, four_legs, knob
from export.everyday_objects.data.shapes import Part, both_sides, box, fixed, moved, role, turned

_COVERS = (
    fixed(0.75, 0.13, 0.12),
    fixed(0.13, 0.36, 0.68),
    fixed(0.95, 0.76, 0.2),
    fixed(0.2, 0.52, 0.27),
    fixed(0.93, 0.92, 0.87),
    fixed(0.5, 0.25, 0.58),
    fixed(0.92, 0.48, 0.14),
)
"""Of books."""


def cabinet(rng: np.random.Generator) -> list[Part]:
    """A cabinet: two doors with panels above one or two drawers, a cornice, knobs, short feet."""
    w, tall, d = rng.uniform(0.88, 1.0), rng.uniform(1.2, 1.36), rng.uniform(0.48, 0.56)
    drawers = int(rng.integers(1, 3))
    low, front = 0.12, d / 2
    parts = [
        block((w, tall - low, d), role("body"), (0, (tall + low) / 2, 0), 0.02),
        block((w + 0.12, 0.1, d + 0.12), role("body", 0.85), (0, tall - 0.02, 0), 0.03),
        block((w + 0.06, 0.09, d + 0.06), role("body", 0.85), (0, low + 0.03, 0), 0.02),
        *four_legs(w / 2 - 0.08, d / 2 - 0.08, low, 0.13, role("body", 0.75), True),
        box((w - 0.24, tall - 0.36, 0.04), role("body", 0.85), (0, tall / 2 + 0.04, -front)),
    ]
    y = low + 0.1
    for _ in range(drawers):
        parts += [
            block((w - 0.12, 0.19, 0.06), role("panels"), (0, y + 0.1, front), 0.025),
            *both_sides(knob((0.2, y + 0.1, front + 0.045), 0.045)),
        ]
        y += 0.24
    high, wide = tall - 0.1 - y, w / 2 - 0.06
    door = [
        block((wide - 0.03, high, 0.06), role("body", 1.08), (wide / 2 + 0.01, y + high / 2, front), 0.02),
        block(
            (wide - 0.14, high - 0.12, 0.05),
            role("panels"),
            (wide / 2 + 0.02, y + high / 2, front + 0.02),
            0.02,
        ),
        knob((0.055, y + high / 2, front + 0.045), 0.045),
    ]
    side = turned(
        box((d - 0.18, tall - 0.42, 0.04), role("body", 0.85), (0, tall / 2 + 0.04, w / 2)), 1, np.pi / 2
    )
    return [*parts, *both_sides(side, *door)]


def bookcase(rng: np.random.Generator) -> list[Part]:
    """A bookcase: three or four shelves full of stout books in many colours, some of them leaning."""
    w, tall, d = rng.uniform(0.92, 1.05), rng.uniform(1.3, 1.42), 0.4
    shelves, low = int(rng.integers(3, 5)), 0.12
    inner, step = w - 0.16, (tall - low - 0.08) / shelves
    parts = [
        box((w - 0.02, tall - 0.04, 0.06), role("body", 0.85), (0, tall / 2, -d / 2 + 0.03)),
        box((inner, tall - 0.06, 0.03), role("body", 0.5), (0, tall / 2, -d / 2 + 0.065)),
        *both_sides(block((0.09, tall, d), role("body"), (w / 2 - 0.045, tall / 2, 0), 0.015)),
        block((w + 0.1, 0.1, d + 0.08), role("shelves"), (0, tall, 0), 0.03),
        block((w + 0.06, low + 0.02, d + 0.05), role("shelves"), (0, low / 2, 0), 0.02),
    ]
    order = rng.permutation(len(_COVERS))
    count = 0
    for k in range(shelves):
        y = low + k * step
        if k:
            parts.append(box((inner + 0.02, 0.07, d - 0.04), role("shelves"), (0, y, 0.01)))
        x, end, room = -inner / 2 + 0.01, inner / 2 - 0.01, step - 0.07
        gap = int(rng.integers(3, 6))
        while x < end - 0.09:
            wide, high = min(rng.uniform(0.1, 0.15), end - x), room * rng.uniform(0.66, 0.93)
            book = block(
                (wide - 0.012, high, d - 0.13),
                _COVERS[order[count % len(_COVERS)]],
                (0, high / 2, 0.015),
                0.015,
            )
            if count % 7 == gap and x + wide + 0.08 < end:
                book, wide = moved(turned(book, 2, -0.22, (wide / 2, 0, 0)), (0.02, 0, 0)), wide + 0.07
                book = moved(book, (0.0, 0.01, 0))
            parts.append(moved(book, (x + wide / 2, y + 0.035, 0)))
            x += wide
            count += 1
    return parts


KINDS = (
    Kind(
        ("cabinet", "dresser", "wardrobe"),
        cabinet,
        {"body": ("brown",), "panels": ("beige",)},
        {"panels": "{} doors"},
    ),
    Kind(
        ("bookcase", "bookshelf"),
        bookcase,
        {"body": ("brown",), "shelves": ("beige", "brown")},
        {"shelves": "{} shelves"},
        weight=1.3,
    ),
)
