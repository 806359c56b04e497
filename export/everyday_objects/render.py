"""Pictures of catalogue models: z-buffer with alpha test, soft light, anti-aliased, on a plain background.

Everything is drawn at twice the size and averaged 2 x 2. Colours are sRGB in [0, 1], and light multiplies
them there: these are pictures for a texture model, not photometry.
"""

from typing import NamedTuple

import numba
import numpy as np

from export.everyday_objects.catalogue import Model
from pipeline.scene.cameras import Camera, project


class Light(NamedTuple):
    """Ambient share plus one directional light and a sky that is brighter than the ground."""

    ambient: float
    directional: float
    sky: float
    direction: np.ndarray
    """(3,) unit vector towards the light, world axes."""


class Picture(NamedTuple):
    """A rendered view."""

    image: np.ndarray
    """(size, size, 3) float32 in [0, 1]"""
    albedo: np.ndarray
    """(n, 3) float32: unlit colours of the object's samples, for naming its colour as seen"""


@numba.njit(cache=True, nogil=True)
def _draw(
    screen,
    world,
    faces,
    uv,
    material,
    colours,
    textured,
    textures,
    wood,
    light,
    direction,
    eye,
    colour,
    depth,
    albedo,
):
    """Fill `colour` (h, w, 3), `depth` (h, w; inverse, 0 = empty) and `albedo` (h, w, 3) in place."""
    height, width = depth.shape
    size = textures.shape[1]
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = screen[a, 0], screen[a, 1], screen[a, 2]
        bx, by, bz = screen[b, 0], screen[b, 1], screen[b, 2]
        cx, cy, cz = screen[c, 0], screen[c, 1], screen[c, 2]
        m = material[f]
        glass = colours[m, 3] < 0.5
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
        e1 = world[b] - world[a]
        e2 = world[c] - world[a]
        nx = e1[1] * e2[2] - e1[2] * e2[1]
        ny = e1[2] * e2[0] - e1[0] * e2[2]
        nz = e1[0] * e2[1] - e1[1] * e2[0]
        norm = np.sqrt(nx * nx + ny * ny + nz * nz) + 1e-20
        towards = (eye[0] - world[a, 0]) * nx + (eye[1] - world[a, 1]) * ny + (eye[2] - world[a, 2]) * nz
        if towards < 0:
            norm = -norm
        nx, ny, nz = nx / norm, ny / norm, nz / norm
        lambert = max(0.0, nx * direction[0] + ny * direction[1] + nz * direction[2])
        shade = light[0] + light[1] * lambert + light[2] * (0.5 + 0.5 * ny)
        scale = 1.0 / area
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                if glass and ((x * 7 + y * 3) % 5) != 0:
                    continue
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
                r, g, bl = colours[m, 0], colours[m, 1], colours[m, 2]
                if textured[m]:
                    u = ba * uv[a, 0] + bb * uv[b, 0] + bc * uv[c, 0]
                    v = ba * uv[a, 1] + bb * uv[b, 1] + bc * uv[c, 1]
                    tx = int((u - np.floor(u)) * size) % size
                    ty = int((v - np.floor(v)) * size) % size
                    if textures[m, ty, tx, 3] < 100:
                        continue
                    r = textures[m, ty, tx, 0] / 255.0
                    g = textures[m, ty, tx, 1] / 255.0
                    bl = textures[m, ty, tx, 2] / 255.0
                if wood[m] > 0:
                    wx = ba * world[a, 0] + bb * world[b, 0] + bc * world[c, 0]
                    wy = ba * world[a, 1] + bb * world[b, 1] + bc * world[c, 1]
                    wz = ba * world[a, 2] + bb * world[b, 2] + bc * world[c, 2]
                    grain = np.sin(60 * wx + 5 * np.sin(4 * wy) + 4 * np.sin(5 * wz)) * np.sin(
                        23 * wz + 3 * wy
                    )
                    factor = 1.0 + 0.14 * wood[m] * grain
                    r, g, bl = r * factor, g * factor, bl * factor
                depth[y, x] = inverse
                albedo[y, x, 0], albedo[y, x, 1], albedo[y, x, 2] = r, g, bl
                colour[y, x, 0] = min(r * shade, 1.0)
                colour[y, x, 1] = min(g * shade, 1.0)
                colour[y, x, 2] = min(bl * shade, 1.0)


def render(
    model: Model, wood: np.ndarray, camera: Camera, size: int, light: Light, background: np.ndarray
) -> Picture:
    """Render `model` into a `size` x `size` picture.

    wood: (m,) strength of a wood grain per material, 0 = none. background: (3,) or (2 size, 2 size, 3)
    colours.
    """
    xy, depth = project(camera, model.vertices)
    screen = np.concatenate([xy * (2 * size), 1.0 / depth[:, None]], axis=1)
    colour = np.empty((2 * size, 2 * size, 3), np.float32)
    colour[:] = background
    inverse_depth = np.zeros((2 * size, 2 * size))
    albedo = np.zeros((2 * size, 2 * size, 3), np.float32)
    _draw(screen, model.vertices, model.faces, model.uv, model.material, model.colours, model.textured,
    model.textures,
          wood, np.array([light.ambient, light.directional, light.sky]), light.direction, camera.pose[:3, 3],
          colour, inverse_depth, albedo)  # fmt: skip
    image = (colour[::2, ::2] + colour[1::2, ::2] + colour[::2, 1::2] + colour[1::2, 1::2]) / 4
    return Picture(image, albedo[inverse_depth > 0])
