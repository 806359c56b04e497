"""Multi-resolution hash grid (Mueller et al. 2022, Instant NGP, section 3): encoding and its gradient.

Letters: n points in [-1, 1]^3, l levels, 2 features a table entry. Level i divides the box into
`resolution[i]`^3 cells; its entries are `table[offset[i]:offset[i + 1]]`. A level whose (resolution + 1)^3
vertices fit is stored densely, a finer one is hashed into a power of two of entries. Features are
interpolated trilinearly.
"""

import numba
import numpy as np

_ZERO, _HALF, _ONE = np.float32(0), np.float32(0.5), np.float32(1)
_NEXT = np.uint64(1)
_FUSED = {"contract"}
"""A product may be rounded together with the sum it goes into, nothing else: a fifth of the time less."""
_PRIME_Y, _PRIME_Z = np.uint32(2654435761), np.uint32(805459861)


@numba.njit(inline="always")
def _locate(coordinate, resolution):
    """Return the cell (clamped to the box, also for a NaN) and the position inside it in [0, 1]."""
    scaled = (coordinate * _HALF + _HALF) * np.float32(resolution)
    scaled = scaled if scaled > _ZERO else _ZERO
    scaled = scaled if scaled < np.float32(resolution) else np.float32(resolution)
    cell = min(np.int32(scaled), resolution - np.int32(1))
    return cell, scaled - np.float32(cell)


@numba.njit(inline="always")
def _corner_indices(x, y, z, resolution, entries):
    """Return the table indices of the eight corners of a cell, x fastest, relative to the level's offset."""
    # Unsigned: an index that might be negative costs a test at every load.
    side = np.uint64(resolution) + _NEXT
    if side * side * side <= np.uint64(entries):
        base = np.uint64(x) + side * (np.uint64(y) + side * np.uint64(z))
        up = base + side * side
        return (
            base, base + _NEXT, base + side, base + side + _NEXT,
            up, up + _NEXT, up + side, up + side + _NEXT,
        )  # fmt: skip
    mask = np.uint32(entries - 1)
    x0, x1 = np.uint32(x), np.uint32(x + 1)
    y0, y1 = np.uint32(y) * _PRIME_Y, np.uint32(y + 1) * _PRIME_Y
    z0, z1 = np.uint32(z) * _PRIME_Z, np.uint32(z + 1) * _PRIME_Z
    a, b, c, d = y0 ^ z0, y1 ^ z0, y0 ^ z1, y1 ^ z1
    return (
        np.uint64((x0 ^ a) & mask),
        np.uint64((x1 ^ a) & mask),
        np.uint64((x0 ^ b) & mask),
        np.uint64((x1 ^ b) & mask),
        np.uint64((x0 ^ c) & mask),
        np.uint64((x1 ^ c) & mask),
        np.uint64((x0 ^ d) & mask),
        np.uint64((x1 ^ d) & mask),
    )


@numba.njit(cache=True, nogil=True, fastmath=_FUSED)
def encode(start, stop, points, table, resolutions, offsets, features):
    """Write rows `start` to `stop` of `features` (n, 2 l) for `points` (n, 3)."""
    for level in range(resolutions.shape[0]):
        resolution = resolutions[level]
        first = offsets[level]
        entries = offsets[level + 1] - first
        own = table[first : first + entries]
        for p in range(start, stop):
            x, u = _locate(points[p, 0], resolution)
            y, v = _locate(points[p, 1], resolution)
            z, w = _locate(points[p, 2], resolution)
            u0, v0, w0 = _ONE - u, _ONE - v, _ONE - w
            i0, i1, i2, i3, i4, i5, i6, i7 = _corner_indices(x, y, z, resolution, entries)
            k0, k1, k2, k3 = u0 * v0, u * v0, u0 * v, u * v
            for feature in range(2):
                f = np.uint64(feature)
                low = k0 * own[i0, f] + k1 * own[i1, f] + k2 * own[i2, f] + k3 * own[i3, f]
                high = k0 * own[i4, f] + k1 * own[i5, f] + k2 * own[i6, f] + k3 * own[i7, f]
                features[p, 2 * level + feature] = low * w0 + high * w


@numba.njit(cache=True, nogil=True, fastmath=_FUSED)
def encode_backward(start, stop, points, feature_gradient, resolutions, offsets, table_gradient):
    """Add the gradient of levels `start` to `stop` to `table_gradient` (entries, 2).

    A level owns its entries, so levels run in parallel without atomics and sums have one order.
    Points whose features of a level have no gradient are skipped.
    """
    for level in range(start, stop):
        resolution = resolutions[level]
        first = offsets[level]
        entries = offsets[level + 1] - first
        own = table_gradient[first : first + entries]
        for p in range(points.shape[0]):
            g0 = feature_gradient[p, 2 * level]
            g1 = feature_gradient[p, 2 * level + 1]
            if g0 == _ZERO and g1 == _ZERO:
                continue
            x, u = _locate(points[p, 0], resolution)
            y, v = _locate(points[p, 1], resolution)
            z, w = _locate(points[p, 2], resolution)
            u0, v0, w0 = _ONE - u, _ONE - v, _ONE - w
            i0, i1, i2, i3, i4, i5, i6, i7 = _corner_indices(x, y, z, resolution, entries)
            indices = (i0, i1, i2, i3, i4, i5, i6, i7)
            k0, k1, k2, k3 = u0 * v0, u * v0, u0 * v, u * v
            weights = (k0 * w0, k1 * w0, k2 * w0, k3 * w0, k0 * w, k1 * w, k2 * w, k3 * w)
            for i in range(8):
                own[indices[i], 0] += weights[i] * g0
                own[indices[i], 1] += weights[i] * g1
