"""Texels of an unwrapped mesh: which face covers each, and what a view shows of it.

Letters: s texels along a side, n covered texels, f faces. The origin of textures is at
the top left.
"""

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def draw_charts(corners, face, barycentric, cover):
    """Find the face under every texel centre.

    Args:
        corners: (f, 3, 2) float64, texture coordinates of the faces' corners [texels].
        face: (s, s) int32 out, first face whose interior or border holds the texel's centre; preset to -1.
        barycentric: (s, s, 3) float32 out, weights of that face's corners.
        cover: (s, s) int32 out, number of faces whose interior holds the centre: above 1, charts overlap.
    """
    size = face.shape[0]
    for f in range(corners.shape[0]):
        ax, ay = corners[f, 0, 0], corners[f, 0, 1]
        bx, by = corners[f, 1, 0], corners[f, 1, 1]
        cx, cy = corners[f, 2, 0], corners[f, 2, 1]
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0.0:
            continue
        x0, x1 = (
            max(int(np.ceil(min(ax, bx, cx) - 0.5)), 0),
            min(int(np.floor(max(ax, bx, cx) - 0.5)), size - 1),
        )
        y0, y1 = (
            max(int(np.ceil(min(ay, by, cy) - 0.5)), 0),
            min(int(np.floor(max(ay, by, cy) - 0.5)), size - 1),
        )
        for y in range(y0, y1 + 1):
            py = y + 0.5
            for x in range(x0, x1 + 1):
                px = x + 0.5
                wa = ((bx - px) * (cy - py) - (cx - px) * (by - py)) / area
                wb = ((cx - px) * (ay - py) - (ax - px) * (cy - py)) / area
                wc = 1.0 - wa - wb
                if wa < 0.0 or wb < 0.0 or wc < 0.0:
                    continue
                if wa > 1e-6 and wb > 1e-6 and wc > 1e-6:
                    cover[y, x] += 1
                if face[y, x] < 0:
                    face[y, x] = f
                    barycentric[y, x, 0] = wa
                    barycentric[y, x, 1] = wb
                    barycentric[y, x, 2] = wc


@numba.njit(inline="always")
def _corner(coordinate, size):
    """Return the lower neighbour, the upper one and the upper one's weight, clamped to the picture."""
    place = min(max(coordinate * size - 0.5, 0.0), size - 1.0)
    low = min(int(place), size - 1)
    return low, min(low + 1, size - 1), place - low


@numba.njit(cache=True, nogil=True)
def look_up(start, stop, triangle, barycentric, uv, uv_faces, texture, out):
    """Look up the texture bilinearly, clamped at its border, at every pixel of some rows that sees a face.

    Args:
        triangle, barycentric: (h, w) int32 and (h, w, 3) float32, what each pixel sees; -1 is nothing.
        uv, uv_faces: (t, 2) float64 in [0, 1] and (f, 3), texture points and the faces' indices into them.
        texture: (s, s, 3) float32.
        out: (h, w, 3) float32, written where a face is seen.
    """
    for row in range(start, stop):
        for column in range(triangle.shape[1]):
            face = triangle[row, column]
            if face < 0:
                continue
            u, v = 0.0, 0.0
            for k in range(3):
                u += barycentric[row, column, k] * uv[uv_faces[face, k], 0]
                v += barycentric[row, column, k] * uv[uv_faces[face, k], 1]
            x0, x1, fx = _corner(u, texture.shape[1])
            y0, y1, fy = _corner(v, texture.shape[0])
            for c in range(3):
                top = texture[y0, x0, c] * (1.0 - fx) + texture[y0, x1, c] * fx
                bottom = texture[y1, x0, c] * (1.0 - fx) + texture[y1, x1, c] * fx
                out[row, column, c] = top * (1.0 - fy) + bottom * fy


@numba.njit(cache=True, nogil=True)
def accumulate_view(
    start,
    stop,
    pose,
    half,
    position,
    normal,
    depth,
    picture,
    trust,
    power,
    two_sided,
    least_cosine,
    bias,
    total,
):
    """Add one view's colours to those texels from `start` to `stop` that it sees.

    Args:
        pose, half: camera to world (4, 4), and tan(fov / 2).
        position, normal: (n, 3) float32, of the texels; normals are unit.
        depth: (d, d) float32, nearest surface along the viewing axis, infinite where there is none.
        picture, trust: (h, w, 3) and (h, w) float32, colours and how far each may be believed, in (0, 1].
        power, two_sided, least_cosine: the weight is trust * cosine ** power (of its absolute value if
            `two_sided`); cosines below the least get nothing.
        bias: depth tolerance [pixels of `depth`], for a surface facing the camera; more for one aslant.
        total: (n, 4) float64 in and out, sums of weight * colour and of weight.
    """
    size = depth.shape[0]
    height, width, _ = picture.shape
    for i in range(start, stop):
        vx = pose[0, 3] - position[i, 0]
        vy = pose[1, 3] - position[i, 1]
        vz = pose[2, 3] - position[i, 2]
        along = vx * pose[0, 2] + vy * pose[1, 2] + vz * pose[2, 2]
        if along <= 0.0:
            continue
        cosine = (vx * normal[i, 0] + vy * normal[i, 1] + vz * normal[i, 2]) / np.sqrt(
            vx * vx + vy * vy + vz * vz
        )
        if two_sided:
            cosine = abs(cosine)
        if cosine < least_cosine:
            continue
        u = 0.5 - 0.5 * (vx * pose[0, 0] + vy * pose[1, 0] + vz * pose[2, 0]) / (along * half)
        v = 0.5 + 0.5 * (vx * pose[0, 1] + vy * pose[1, 1] + vz * pose[2, 1]) / (along * half)
        if not (0.0 <= u < 1.0 and 0.0 <= v < 1.0):
            continue
        footprint = 2.0 * half * along / size
        slope = np.sqrt(max(1.0 - cosine * cosine, 0.0)) / cosine
        if along > depth[int(v * size), int(u * size)] + bias * footprint * (1.0 + slope):
            continue
        x0, x1, fx = _corner(u, width)
        y0, y1, fy = _corner(v, height)
        w00, w01 = (1.0 - fx) * (1.0 - fy), fx * (1.0 - fy)
        w10, w11 = (1.0 - fx) * fy, fx * fy
        believed = w00 * trust[y0, x0] + w01 * trust[y0, x1] + w10 * trust[y1, x0] + w11 * trust[y1, x1]
        weight = believed * cosine**power
        for c in range(3):
            colour = w00 * picture[y0, x0, c] + w01 * picture[y0, x1, c]
            colour += w10 * picture[y1, x0, c] + w11 * picture[y1, x1, c]
            total[i, c] += weight * colour
        total[i, 3] += weight
