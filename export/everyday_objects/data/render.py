"""Pictures of shapes: a z-buffer, soft light that never changes, smooth where surfaces bend gently,
anti-aliased.

Everything is drawn at twice the size and averaged 2 x 2. Colours are sRGB in [0, 1], and light multiplies
them there: these are pictures for a texture model, not photometry. All objects have the same light, fixed to
the world: score distillation can only paint a shading that all views agree on.
"""

from typing import NamedTuple

import numba
import numpy as np

from export.everyday_objects.data.materials import paint_at
from export.everyday_objects.data.shapes import Shape
from pipeline.cameras import Camera, orbit_camera, project

AMBIENT, DIRECTIONAL, SKY = 0.53, 0.31, 0.235
"""Shares of the light that comes from everywhere, from one side, and from above more than from below."""
TOWARDS = orbit_camera(0.0, 0.65, 1.0, 1.0).pose[:3, 2]
"""Unit vector towards the light, world axes."""
_CREASE = np.cos(np.radians(40.0))


class Looks(NamedTuple):
    """How the paints of a shape look."""

    colours: np.ndarray
    """(p, 3) float32 in [0, 1]"""
    others: np.ndarray
    """(p, 3) float32, the second colour of a material"""
    codes: np.ndarray
    """(p,) int32, see `materials`"""


class Drawable(NamedTuple):
    """A shape with what drawing needs of it at every view."""

    shape: Shape
    normals: np.ndarray
    """(f, 3, 3) float32: of every corner of every face, towards the side that its winding says"""


@numba.njit(cache=True, nogil=True)
def _corner_normals(faces, flat, starts, around):
    """Average at every corner what meets there without a crease; `flat` (f, 3) are normals times areas."""
    result = np.empty((len(faces), 3, 3), np.float32)
    for f in range(len(faces)):
        length = np.sqrt((flat[f] ** 2).sum()) + 1e-20
        for c in range(3):
            total = np.zeros(3)
            v = faces[f, c]
            for i in range(starts[v], starts[v + 1]):
                other = flat[around[i]]
                cosine = (other * flat[f]).sum() / (length * (np.sqrt((other**2).sum()) + 1e-20))
                if cosine > _CREASE:
                    total += other
                elif cosine < -_CREASE:
                    total -= other
            norm = np.sqrt((total**2).sum())
            result[f, c] = total / norm if norm > 0 else flat[f] / length
    return result


def drawable(shape: Shape) -> Drawable:
    """Return a shape with the normals of its corners."""
    a, b, c = (shape.vertices[shape.faces[:, k]].astype(np.float64) for k in range(3))
    flat = np.cross(b - a, c - a)
    order = np.argsort(shape.faces.ravel(), kind="stable")
    starts = np.searchsorted(shape.faces.ravel()[order], np.arange(len(shape.vertices) + 1))
    return Drawable(shape, _corner_normals(shape.faces, flat, starts, order // 3))


@numba.njit(cache=True, nogil=True)
def _draw(screen, world, faces, normals, paint, colours, others, codes, light, direction, eye, colour, depth):
    """Fill `colour` (h, w, 3) and `depth` (h, w; inverse, 0 = empty) in place."""
    height, width = depth.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = screen[a, 0], screen[a, 1], screen[a, 2]
        bx, by, bz = screen[b, 0], screen[b, 1], screen[b, 2]
        cx, cy, cz = screen[c, 0], screen[c, 1], screen[c, 2]
        if not (az > 0 and bz > 0 and cz > 0):
            continue
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0:
            continue
        x0 = max(int(np.ceil(min(ax, bx, cx) - 0.5)), 0)
        x1 = min(int(np.floor(max(ax, bx, cx) - 0.5)), width - 1)
        y0 = max(int(np.ceil(min(ay, by, cy) - 0.5)), 0)
        y1 = min(int(np.floor(max(ay, by, cy) - 0.5)), height - 1)
        if x1 < x0 or y1 < y0:
            continue
        e1, e2 = world[b] - world[a], world[c] - world[a]
        towards = (
            (eye[0] - world[a, 0]) * (e1[1] * e2[2] - e1[2] * e2[1])
            + (eye[1] - world[a, 1]) * (e1[2] * e2[0] - e1[0] * e2[2])
            + (eye[2] - world[a, 2]) * (e1[0] * e2[1] - e1[1] * e2[0])
        )
        side = -1.0 if towards < 0 else 1.0
        p = paint[f]
        scale = 1.0 / area
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                px, py = x + 0.5, y + 0.5
                wa = ((bx - px) * (cy - py) - (cx - px) * (by - py)) * scale
                wb = ((cx - px) * (ay - py) - (ax - px) * (cy - py)) * scale
                wc = 1.0 - wa - wb
                if wa < 0 or wb < 0 or wc < 0:
                    continue
                inverse = wa * az + wb * bz + wc * cz
                if inverse <= depth[y, x]:
                    continue
                ba, bb, bc = wa * az / inverse, wb * bz / inverse, wc * cz / inverse
                nx = side * (ba * normals[f, 0, 0] + bb * normals[f, 1, 0] + bc * normals[f, 2, 0])
                ny = side * (ba * normals[f, 0, 1] + bb * normals[f, 1, 1] + bc * normals[f, 2, 1])
                nz = side * (ba * normals[f, 0, 2] + bb * normals[f, 1, 2] + bc * normals[f, 2, 2])
                norm = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz + 1e-20)
                nx, ny, nz = nx * norm, ny * norm, nz * norm
                red, green, blue = colours[p, 0], colours[p, 1], colours[p, 2]
                if codes[p] > 0:
                    wx = ba * world[a, 0] + bb * world[b, 0] + bc * world[c, 0]
                    wy = ba * world[a, 1] + bb * world[b, 1] + bc * world[c, 1]
                    wz = ba * world[a, 2] + bb * world[b, 2] + bc * world[c, 2]
                    red, green, blue = paint_at(
                        codes[p],
                        wx,
                        wy,
                        wz,
                        nx,
                        ny,
                        nz,
                        red,
                        green,
                        blue,
                        others[p, 0],
                        others[p, 1],
                        others[p, 2],
                    )
                lambert = max(0.0, nx * direction[0] + ny * direction[1] + nz * direction[2])
                shade = light[0] + light[1] * lambert + light[2] * (0.5 + 0.5 * ny)
                depth[y, x] = inverse
                colour[y, x, 0] = min(red * shade, 1.0)
                colour[y, x, 1] = min(green * shade, 1.0)
                colour[y, x, 2] = min(blue * shade, 1.0)


def render(thing: Drawable, looks: Looks, camera: Camera, size: int, background: np.ndarray) -> np.ndarray:
    """Return a (size, size, 3) float32 picture in [0, 1] of a shape before a flat (3,) background."""
    shape = thing.shape
    xy, depth = project(camera, shape.vertices)
    screen = np.concatenate([xy * (2 * size), 1.0 / depth[:, None]], axis=1)
    colour = np.empty((2 * size, 2 * size, 3), np.float32)
    colour[:] = background
    light, empty = np.array([AMBIENT, DIRECTIONAL, SKY]), np.zeros((2 * size, 2 * size))
    things = (screen, shape.vertices, shape.faces, thing.normals, shape.paint)
    paints = (looks.colours, looks.others, looks.codes)
    _draw(*things, *paints, light, TOWARDS, camera.pose[:3, 3], colour, empty)
    return (colour[::2, ::2] + colour[1::2, ::2] + colour[::2, 1::2] + colour[1::2, 1::2]) / 4
