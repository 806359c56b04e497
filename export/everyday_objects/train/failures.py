"""Failed pictures for the judge: what undertrained models and collapsed distillations leave of an object."""

import cv2
import numpy as np

from export.everyday_objects.data.colours import COLOURS, draw_colour
from export.everyday_objects.data.materials import MATERIALS
from export.everyday_objects.data.render import Looks
from export.everyday_objects.data.shapes import Part, Shape, assemble, cushion, ellipsoid, moved, role, turned


def lump(rng: np.random.Generator) -> tuple[Shape, Looks]:
    """A few ellipsoids and cushions of one or two colours, thrown together; now and then in a material."""
    parts: list[Part] = []
    for i in range(int(rng.integers(2, 6))):  # one alone would be a ball
        size, at = rng.uniform(0.12, 0.6, 3), rng.uniform(-0.35, 0.35, 3) * (i > 0)
        paint = role("second" if i and rng.random() < 0.3 else "first")
        part = cushion(2 * size, paint) if rng.random() < 0.4 else ellipsoid(size, paint)
        part = turned(turned(part, 0, rng.uniform(-1, 1)), 2, rng.uniform(-1, 1))
        parts.append(moved(part, at))
    shape, others = assemble(parts), list(MATERIALS.values())
    colours, seconds = (
        np.stack([draw_colour(rng, COLOURS[rng.integers(len(COLOURS))]) for _ in shape.paints])
        for _ in range(2)
    )
    code = others[rng.integers(len(others))].code if rng.random() < 0.3 else 0
    return shape, Looks(colours, seconds, np.full(len(shape.paints), code, np.int32))


def melt(rng: np.random.Generator, image: np.ndarray) -> np.ndarray:
    """A picture (h, w, 3) pulled about by a smooth random field, a fifth of its size in the mean."""
    size = image.shape[0]
    coarse = rng.normal(
        0, rng.uniform(0.16, 0.26) * size, (2, int(rng.integers(4, 8)), int(rng.integers(4, 8)))
    )
    flow = [cv2.resize(c.astype(np.float32), (size, size), interpolation=cv2.INTER_CUBIC) for c in coarse]
    y, x = np.mgrid[:size, :size].astype(np.float32)
    return cv2.remap(image, x + flow[0], y + flow[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def scatter(rng: np.random.Generator, image: np.ndarray) -> np.ndarray:
    """A picture (h, w, 3) whose tiles, three or four a side, were shuffled."""
    n = int(rng.integers(3, 5))
    side = image.shape[0] // n
    tiles = [image[i * side : (i + 1) * side, j * side : (j + 1) * side] for i in range(n) for j in range(n)]
    order = rng.permutation(len(tiles))
    rows = [np.concatenate([tiles[order[i * n + j]] for j in range(n)], axis=1) for i in range(n)]
    return cv2.resize(np.concatenate(rows), image.shape[1::-1])
