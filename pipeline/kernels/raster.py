"""Z-buffer rasterisation of one picture: the nearest triangle at every pixel centre.

Letters: v vertices, f faces. `screen` holds (x [px], y [px], 1 / depth) per vertex; interpolating 1 / depth
linearly in the picture is exact under perspective, and so are barycentrics weighted by it.
"""

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def to_screen(vertices, pose, half_width, size, screen):
    """Write what `draw` takes of every vertex: `cameras.project`, to rounding, in one pass.

    `pose` (4, 4) is the camera's, `half_width` the tangent of half its angle of view. A vertex in the
    camera's plane gets infinities or NaN, one behind it a negative 1 / depth.
    """
    for v in range(vertices.shape[0]):
        x = float(vertices[v, 0]) - pose[0, 3]
        y = float(vertices[v, 1]) - pose[1, 3]
        z = float(vertices[v, 2]) - pose[2, 3]
        right = x * pose[0, 0] + y * pose[1, 0] + z * pose[2, 0]
        up = x * pose[0, 1] + y * pose[1, 1] + z * pose[2, 1]
        depth = -(x * pose[0, 2] + y * pose[1, 2] + z * pose[2, 2])
        inverse = np.inf if depth == 0 else 1.0 / depth
        screen[v, 0] = (0.5 + 0.5 * right * inverse / half_width) * size
        screen[v, 1] = (0.5 - 0.5 * up * inverse / half_width) * size
        screen[v, 2] = inverse


@numba.njit(cache=True, nogil=True)
def draw(screen, faces, triangle, barycentric, inverse_depth):
    """Draw triangles into `triangle` (h, w), `barycentric` (h, w, 3), `inverse_depth` (h, w), in place.

    Faces with a vertex at or behind the camera (1 / depth <= 0) are skipped, as are those without area. Of
    two faces at the same depth the first one wins, so the result does not depend on anything but the input.
    """
    height, width = triangle.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = screen[a, 0], screen[a, 1], screen[a, 2]
        bx, by, bz = screen[b, 0], screen[b, 1], screen[b, 2]
        cx, cy, cz = screen[c, 0], screen[c, 1], screen[c, 2]
        if not (az > 0 and bz > 0 and cz > 0):
            continue
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0 or not np.isfinite(area):
            continue
        x0 = max(int(np.ceil(max(min(ax, bx, cx) - 0.5, -1.0))), 0)
        x1 = min(int(np.floor(min(max(ax, bx, cx) - 0.5, width + 1.0))), width - 1)
        y0 = max(int(np.ceil(max(min(ay, by, cy) - 0.5, -1.0))), 0)
        y1 = min(int(np.floor(min(max(ay, by, cy) - 0.5, height + 1.0))), height - 1)
        scale = 1.0 / area
        for y in range(y0, y1 + 1):
            py = y + 0.5
            for x in range(x0, x1 + 1):
                px = x + 0.5
                wa = ((bx - px) * (cy - py) - (cx - px) * (by - py)) * scale
                wb = ((cx - px) * (ay - py) - (ax - px) * (cy - py)) * scale
                # Not 1 - wa - wb: an edge shared by two faces gives them exactly opposite signs, so no crack.
                wc = ((ax - px) * (by - py) - (bx - px) * (ay - py)) * scale
                if wa < 0 or wb < 0 or wc < 0:
                    continue
                inverse = wa * az + wb * bz + wc * cz
                if inverse > inverse_depth[y, x]:
                    inverse_depth[y, x] = inverse
                    triangle[y, x] = f
                    barycentric[y, x, 0] = wa * az / inverse
                    barycentric[y, x, 1] = wb * bz / inverse
                    barycentric[y, x, 2] = wc * cz / inverse
