"""Diffusion of face normals over a mesh. Letters: f faces, k neighbours of a face."""

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def diffuse(normals, area, beside, scale, steps):
    """Return unit normals (f, 3) after so many steps: each takes the mean of itself and its neighbours.

    A neighbour counts by its area and by exp(scale * squared difference of the normals); `beside` (f, k) has
    -1 where there is none. All faces of a step read the normals of the step before.
    """
    count = len(normals)
    now, then = normals.copy(), np.empty_like(normals)
    for _ in range(steps):
        for face in range(count):
            x, y, z = now[face, 0], now[face, 1], now[face, 2]
            sx, sy, sz = area[face] * x, area[face] * y, area[face] * z
            for other in beside[face]:
                if other >= 0:
                    ox, oy, oz = now[other, 0], now[other, 1], now[other, 2]
                    apart = (ox - x) ** 2 + (oy - y) ** 2 + (oz - z) ** 2
                    share = area[other] * np.exp(scale * apart)
                    sx += share * ox
                    sy += share * oy
                    sz += share * oz
            length = max(np.sqrt(sx * sx + sy * sy + sz * sz), 1e-30)
            then[face, 0], then[face, 1], then[face, 2] = sx / length, sy / length, sz / length
        now, then = then, now
    return now
