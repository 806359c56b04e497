"""Materials as patterns in object space, evaluated a pixel: what a denoiser of 32 x 32 latents can carry.

Score distillation averages whatever differs between views: a pattern's phase is fixed in the object's
coordinates and its period at least 0.2 scene units, three and a half latent pixels. The object fills a ball
of radius 0.75.
"""

from typing import NamedTuple

import numba
import numpy as np


class Material(NamedTuple):
    """One material: its number in `paint_at`, how captions say it, and in which colours it comes."""

    code: int
    adjective: str
    noun: str
    """After "made of"; empty where nothing is made of it."""
    colour: tuple[float, float, float] | None
    """Its own first colour; None: the object's, which a caption may name as well."""
    other: tuple[float, float, float]
    """The second colour, of lines, gaps or bands."""


PLAIN = 0
MATERIALS = {
    m.adjective: m
    for m in (
        Material(1, "wooden", "wood", (0.68, 0.45, 0.24), (0.4, 0.23, 0.1)),
        Material(2, "striped", "", None, (0.95, 0.95, 0.93)),
        Material(3, "dotted", "", None, (0.95, 0.95, 0.93)),
        Material(4, "checkered", "", None, (0.95, 0.95, 0.93)),
        Material(5, "brick", "bricks", (0.66, 0.27, 0.18), (0.82, 0.78, 0.72)),
        Material(6, "marble", "marble", (0.93, 0.93, 0.92), (0.42, 0.44, 0.48)),
        Material(7, "gingerbread", "gingerbread", (0.6, 0.36, 0.16), (0.97, 0.96, 0.93)),
        Material(8, "candy", "candy", (0.95, 0.45, 0.6), (0.97, 0.96, 0.93)),
        Material(9, "leopard", "", (0.87, 0.64, 0.3), (0.2, 0.12, 0.06)),
        Material(10, "steel", "steel", (0.62, 0.65, 0.69), (0.3, 0.33, 0.38)),
        Material(11, "golden", "gold", (0.98, 0.78, 0.22), (0.6, 0.38, 0.05)),
        Material(12, "lego", "lego", (0.85, 0.1, 0.1), (0.95, 0.8, 0.1)),
        Material(13, "stone", "stone", (0.6, 0.59, 0.56), (0.36, 0.35, 0.33)),
    )
}
_BRICKS = np.array(
    [[0.82, 0.1, 0.1], [0.1, 0.32, 0.75], [0.96, 0.8, 0.12], [0.12, 0.55, 0.2], [0.93, 0.93, 0.92]]
)
_SWEETS = np.array(
    [[0.96, 0.42, 0.6], [0.45, 0.8, 0.92], [0.98, 0.85, 0.35], [0.55, 0.86, 0.5], [0.78, 0.55, 0.9]]
)


@numba.njit(cache=True, nogil=True)
def _hash(i, j, k):
    """A number in [0, 1) for a cell of the integer lattice."""
    h = (i * 374761393 + j * 668265263 + k * 1274126177) & 0x7FFFFFFF
    h = ((h ^ (h >> 13)) * 1103515245) & 0x7FFFFFFF
    return ((h ^ (h >> 16)) & 0xFFFF) / 65536.0


@numba.njit(cache=True, nogil=True)
def _nearest_cell(x, y, z, jitter):
    """Worley: distances to the nearest and second nearest point of a jittered unit lattice, and the nearest's
    hash.
    """
    ci, cj, ck = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    first, second, which = 1e9, 1e9, 0.0
    for i in range(ci - 1, ci + 2):
        for j in range(cj - 1, cj + 2):
            for k in range(ck - 1, ck + 2):
                px = i + 0.5 + jitter * (_hash(i, j, k) - 0.5)
                py = j + 0.5 + jitter * (_hash(i + 71, j, k) - 0.5)
                pz = k + 0.5 + jitter * (_hash(i, j + 53, k) - 0.5)
                d = (x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2
                if d < first:
                    first, second, which = d, first, _hash(i, j, k + 29)
                elif d < second:
                    second = d
    return np.sqrt(first), np.sqrt(second), which


@numba.njit(cache=True, nogil=True)
def _edge(value, width):
    """0 below -width, 1 above width, smooth between."""
    t = min(max(0.5 + 0.5 * value / width, 0.0), 1.0)
    return t * t * (3 - 2 * t)


@numba.njit(cache=True, nogil=True)
def paint_at(code, x, y, z, nx, ny, nz, r, g, b, r2, g2, b2):
    """Return the unlit colour (3 values) at a point with a normal, from the paint's two colours."""
    share = 0.0  # of the second colour
    if code == 1:  # wood: rings about a tilted axis, wavy, along the object's height and depth
        radius = np.sqrt((x + 0.35) ** 2 + (0.6 * y + 0.25 * z) ** 2) + 0.03 * np.sin(5 * y + 3 * z)
        share = 0.85 * _edge(np.sin(2 * np.pi * radius / 0.23) - 0.15, 0.8)
    elif code == 2:  # bands across the height
        share = _edge(np.sin(2 * np.pi * (y + 0.06) / 0.3), 0.25)
    elif code == 3:
        near, _, _ = _nearest_cell(x / 0.25, y / 0.25, z / 0.25, 0.35)
        share = _edge(0.34 - near, 0.08)
    elif code == 4:
        # Cells of a cube lattice; faces along a lattice plane must not flicker between two cells.
        s = 0.23
        u, v, w = x - 0.03 * nx, y - 0.03 * ny, z - 0.03 * nz
        parity = np.floor(u / s + 0.31) + np.floor(v / s + 0.27) + np.floor(w / s + 0.23)
        share = parity % 2
    elif code == 5 or code == 13:
        tall, long = (0.16, 0.34) if code == 5 else (0.2, 0.3)
        if abs(ny) > 0.8:
            v, u = z, x
        else:
            v = y
            u = z if abs(nx) > abs(nz) else x
        row = np.floor(v / tall)
        u = u + (row % 2) * long / 2
        du = abs(u / long - np.floor(u / long) - 0.5) * long
        dv = abs(v / tall - np.floor(v / tall) - 0.5) * tall
        gap = max(du - (long / 2 - 0.022), dv - (tall / 2 - 0.022))
        tone = 0.86 + 0.28 * _hash(int(np.floor(u / long)), int(row), 7)
        r, g, b = r * tone, g * tone, b * tone
        share = _edge(gap, 0.012)
    elif code == 6:
        wave = x + 0.7 * y + 0.4 * z
        wave += (
            0.22 * np.sin(4.1 * y + 1.3) + 0.13 * np.sin(7.3 * z + 2.1 * x) + 0.1 * np.sin(9.7 * x - 5 * y)
        )
        vein = abs(np.sin(2 * np.pi * wave / 0.62))
        share = 0.8 * _edge(0.3 - vein, 0.28)
    elif code == 7:  # icing in wavy lines
        line = abs(np.sin(np.pi * (y + 0.035 * np.sin(11 * (x + z))) / 0.3))
        share = _edge(0.26 - line, 0.12)
    elif code == 8:
        near, far, which = _nearest_cell(x / 0.27, y / 0.27, z / 0.27, 0.8)
        index = min(int(which * 5), 4)
        r, g, b = _SWEETS[index, 0], _SWEETS[index, 1], _SWEETS[index, 2]
        share = _edge(0.1 - (far - near), 0.06)
    elif code == 9:
        near, far, _ = _nearest_cell(x / 0.24, y / 0.24, z / 0.24, 0.55)
        share = _edge(0.13 - abs(near - 0.3), 0.06)
    elif (
        code == 10 or code == 11
    ):  # a ramp by the normal: a sky, a dark horizon, a bright ground, from every side
        up = ny * 0.8 + 0.2 * nx
        bright = 0.5 + 0.5 * np.sin(4.2 * up + 0.6)
        share = 0.75 * (1 - bright)
        lift = 0.22 * bright**3
        r, g, b = r + lift, g + lift, b + lift
    elif code == 12:  # bricks of five colours, studs where it faces up
        s, t = 0.25, 0.2
        u, v, w = x - 0.02 * nx, y - 0.02 * ny, z - 0.02 * nz
        row = np.floor(v / t)
        shift = (row % 2) * s / 2
        i, k = int(np.floor((u + shift) / s)), int(np.floor((w + shift) / s))
        index = min(int(_hash(i, int(row), k) * 5), 4)
        r, g, b = _BRICKS[index, 0], _BRICKS[index, 1], _BRICKS[index, 2]
        r2, g2, b2 = 0.62 * r, 0.62 * g, 0.62 * b
        if ny > 0.7:
            du, dw = (
                (u + shift) / s - np.floor((u + shift) / s) - 0.5,
                (w + shift) / s - np.floor((w + shift) / s) - 0.5,
            )
            share = _edge(0.09 - abs(np.sqrt(du * du + dw * dw) - 0.3), 0.05)
        else:
            dv = abs(v / t - np.floor(v / t) - 0.5) * t
            share = _edge(dv - (t / 2 - 0.016), 0.01)
    return r + share * (r2 - r), g + share * (g2 - g), b + share * (b2 - b)
