"""Values between the points of a lattice over the box [-1, 1]^3: what a sketch says at a sample.

Letters: k lattice points a side, n points asked for.
"""

import numba
import numpy as np

_ONE = np.float32(1)


@numba.njit(inline="always")
def _trilinear(values, i, j, k, x, y, z):
    """Return the value at (x, y, z) in [0, 1]^3 of the cell (i, j, k)."""
    a = values[i, j, k] * (_ONE - z) + values[i, j, k + 1] * z
    b = values[i, j + 1, k] * (_ONE - z) + values[i, j + 1, k + 1] * z
    c = values[i + 1, j, k] * (_ONE - z) + values[i + 1, j, k + 1] * z
    d = values[i + 1, j + 1, k] * (_ONE - z) + values[i + 1, j + 1, k + 1] * z
    return (a * (_ONE - y) + b * y) * (_ONE - x) + (c * (_ONE - y) + d * y) * x


@numba.njit(inline="always")
def _place(coordinate, cells):
    """Return the cell of a coordinate, clamped to the box, and the place in it in [0, 1]."""
    scaled = (min(max(coordinate, -_ONE), _ONE) + _ONE) * np.float32(0.5) * np.float32(cells)
    cell = min(np.int64(scaled), cells - 1)
    return cell, scaled - np.float32(cell)


@numba.njit(cache=True, nogil=True)
def look_up(start, stop, points, winding, distance, least, inside, found):
    """Write to `found` (n,) the distance at `points` (n, 3), to `inside` (n,) whether the winding number
    exceeds 1/2.

    `winding` and `distance` are (k, k, k), indexed [x, y, z]. Where the distance is below `least`, nobody
    asks for the winding number: it is not looked up, and `inside` is False.
    """
    cells = len(distance) - 1
    for n in range(start, stop):
        i, x = _place(points[n, 0], cells)
        j, y = _place(points[n, 1], cells)
        k, z = _place(points[n, 2], cells)
        away = _trilinear(distance, i, j, k, x, y, z)
        found[n] = away
        inside[n] = away >= least and _trilinear(winding, i, j, k, x, y, z) > np.float32(0.5)
