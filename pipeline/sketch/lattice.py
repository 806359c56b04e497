"""What a sketch says of a point: whether it is inside, and how far from the surface.

Both are functions of the mesh alone, so they are tabulated once (`scene.winding`) and interpolated between
the points of a lattice. Letters: k lattice points a side of the box [-1, 1]^3, indexed [x, y, z]; g cells a
side of the occupancy grid; n points.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from pipeline import arrays
from pipeline.errors import InputError
from pipeline.kernels import parallel
from pipeline.kernels import trilinear as kernels

_POINTS_PER_TASK = 8192


class Sketch(NamedTuple):
    """A solid on a lattice."""

    winding: Float[np.ndarray, "k k k"]
    """Generalised winding number, float32: about 1 inside, 0 outside; inside is above 1/2."""
    distance: Float[np.ndarray, "k k k"]
    """Distance to the nearest triangle, float32 [scene units]."""

    @property
    def cell(self) -> float:
        """Spacing of the lattice [scene units]."""
        return 2 / (len(self.distance) - 1)


def lattice(cells: int) -> Float[np.ndarray, "n 3"]:
    """Return the n = (cells + 1)^3 corners of the box's cells, float64, z fastest."""
    axis = np.linspace(-1.0, 1.0, cells + 1)
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)


def look_up(
    sketch: Sketch, points: Float[np.ndarray, "n 3"], least: float = 0.0
) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return where `points` (float32) are inside, and their distances; the box's wall stands for what is
    beyond it.

    A point nearer to the surface than `least` [scene units] costs one lookup less and counts as outside.
    Compared with exact values, `inside` is right beyond one cell from the surface, and distances to half a
    cell, at the very middle of a ball to 0.87 of one.
    """
    inside, distance = np.empty(len(points), np.bool_), np.empty(len(points), np.float32)
    results = (sketch.winding, sketch.distance, np.float32(least), inside, distance)
    parallel.run(kernels.look_up, len(points), points, *results, block=_POINTS_PER_TASK)
    return inside, distance


def solid_cells(sketch: Sketch, cells: int) -> Bool[np.ndarray, "g g g"]:
    """Return the cells of an occupancy grid, `cells` a side, that have a corner inside."""
    inside, _ = look_up(sketch, lattice(cells).astype(np.float32))
    corners = inside.reshape((cells + 1,) * 3)
    for axis in range(3):
        corners = np.logical_or(
            np.take(corners, range(cells), axis), np.take(corners, range(1, cells + 1), axis)
        )
    return np.asarray(corners, np.bool_)


def volume_iou(first: Bool[np.ndarray, " n"], second: Bool[np.ndarray, " n"]) -> float:
    """Return the intersection over union of two solids sampled at the same points, in [0, 1]."""
    union = int((first | second).sum())
    return int((first & second).sum()) / union if union else 1.0


def save_sketch(path: Path, sketch: Sketch) -> None:
    """Write the sketch; equal sketches give equal bytes."""
    path.write_bytes(arrays.pack(sketch._asdict()))


def load_sketch(path: Path) -> Sketch:
    """Read a sketch.

    Raises:
        InputError: the file is damaged or holds no sketch.
    """
    try:
        values = arrays.unpack(path.read_bytes())
        sketch = Sketch(values["winding"], values["distance"])
    except (ValueError, KeyError) as error:
        raise InputError(f"{path} is damaged ({error}): delete it and run again") from None
    return sketch
