"""Multi-resolution hash grid (Mueller et al. 2022, Instant NGP, section 3): encoding and its gradient.

Letters: n points in [-1, 1]^3, l levels, 2 features a table entry. Level i divides the box into
`resolution[i]`^3 cells; its entries are `table[offset[i]:offset[i + 1]]`. A level whose (resolution + 1)^3
vertices fit is stored densely, a finer one is hashed into a power of two of entries. Features are
interpolated trilinearly.

Half of the work is finding entries and weights. That is done for `_CHUNK` points together, a loop an
operation, so that the compiler makes one instruction do eight of them.
"""

import numba
import numpy as np

_ZERO, _HALF, _ONE = np.float32(0), np.float32(0.5), np.float32(1)
_PRIME_Y, _PRIME_Z = np.uint32(2654435761), np.uint32(805459861)
_FUSED = {"contract"}
"""A product may be rounded together with the sum it goes into, nothing else: a fifth of the time less."""
_CHUNK = 256
"""Points whose entries and weights are found together: they stay in the nearest cache."""


@numba.njit(nogil=True, fastmath=_FUSED)
def _locate(points, axis, resolution, line, cells, inside):
    """Write the cells along an axis (clamped to the box, also for a NaN) and the positions in them, [0, 1].

    `line` (n,) is overwritten.
    """
    last, scale = np.float32(resolution - 1), np.float32(resolution)
    n = points.shape[0]
    for p in range(n):  # one beside the other: only such numbers are taken eight at once
        line[p] = points[p, axis]
    for p in range(n):
        scaled = (line[p] * _HALF + _HALF) * scale
        scaled = scaled if scaled > _ZERO else _ZERO
        scaled = scaled if scaled < scale else scale
        cell = np.floor(scaled)
        cell = cell if cell < last else last
        inside[p] = scaled - cell
        cells[p] = np.int32(cell)


@numba.njit(nogil=True)
def _dense_entries(n, x, y, z, side, entries):
    """Write the entries of cells' vertices nearest the origin, in a level that stores every vertex."""
    for p in range(n):
        entries[p] = x[p] + side * (y[p] + side * z[p])


@numba.njit(nogil=True)
def _shift(n, first, by, entries):
    """Write entries that lie `by` behind others."""
    for p in range(n):
        entries[p] = first[p] + by


@numba.njit(nogil=True)
def _hashed_entries(n, x, y, z, dx, dy, dz, mask, entries):
    """Write the entries of one vertex of each cell, in a level that is hashed."""
    for p in range(n):
        spread = (x[p] + dx) ^ ((y[p] + dy) * _PRIME_Y) ^ ((z[p] + dz) * _PRIME_Z)
        entries[p] = spread & mask


@numba.njit(nogil=True)
def _products(n, u, v, upper_u, upper_v, weights):
    """Write the weights of a vertex by two of its coordinates."""
    for p in range(n):
        a = u[p] if upper_u else _ONE - u[p]
        b = v[p] if upper_v else _ONE - v[p]
        weights[p] = a * b


@numba.njit(nogil=True)
def _prepare(points, resolution, count, cells, inside, entries, weights):
    """Write the entries (8, n) of the vertices of the points' cells, x fastest, and the weights (4, n) of
    each four of them; `inside[2]` are the positions between both fours.
    """
    n = points.shape[0]
    for axis in range(3):
        _locate(points, axis, resolution, inside[3], cells[axis], inside[axis])
    x, y, z = cells[0].view(np.uint32), cells[1].view(np.uint32), cells[2].view(np.uint32)
    side = np.uint32(resolution + 1)
    if np.uint64(side) * np.uint64(side) * np.uint64(side) <= np.uint64(count):
        _dense_entries(n, x, y, z, side, entries[0])
        for corner in range(1, 8):
            dx, dy, dz = np.uint32(corner & 1), np.uint32(corner >> 1 & 1), np.uint32(corner >> 2)
            _shift(n, entries[0], dx + side * (dy + side * dz), entries[corner])
    else:
        mask = np.uint32(count - 1)
        for corner in range(8):
            dx, dy, dz = np.uint32(corner & 1), np.uint32(corner >> 1 & 1), np.uint32(corner >> 2)
            _hashed_entries(n, x, y, z, dx, dy, dz, mask, entries[corner])
    for corner in range(4):
        _products(n, inside[0], inside[1], corner & 1, corner >> 1, weights[corner])


@numba.njit(cache=True, nogil=True, fastmath=_FUSED)
def encode(start, stop, points, table, resolutions, offsets, features):
    """Write rows `start` to `stop` of `features` (n, 2 l) for `points` (n, 3)."""
    cells, inside = np.empty((3, _CHUNK), np.int32), np.empty((4, _CHUNK), np.float32)
    entries, weights = np.empty((8, _CHUNK), np.uint32), np.empty((4, _CHUNK), np.float32)
    for level in range(resolutions.shape[0]):
        first = offsets[level]
        count = offsets[level + 1] - first
        own = table[first : first + count]
        for chunk in range(start, stop, _CHUNK):
            end = min(chunk + _CHUNK, stop)
            n = end - chunk
            here = points[chunk:end]
            _prepare(here, resolutions[level], count, cells, inside, entries, weights)
            rows = features[chunk:end]
            for p in range(n):
                # Unsigned: an index that might be negative costs a test at every load.
                i0, i1 = np.uint64(entries[0, p]), np.uint64(entries[1, p])
                i2, i3 = np.uint64(entries[2, p]), np.uint64(entries[3, p])
                i4, i5 = np.uint64(entries[4, p]), np.uint64(entries[5, p])
                i6, i7 = np.uint64(entries[6, p]), np.uint64(entries[7, p])
                k0, k1, k2, k3 = weights[0, p], weights[1, p], weights[2, p], weights[3, p]
                w = inside[2, p]
                w0 = _ONE - w
                low = k0 * own[i0, 0] + k1 * own[i1, 0] + k2 * own[i2, 0] + k3 * own[i3, 0]
                high = k0 * own[i4, 0] + k1 * own[i5, 0] + k2 * own[i6, 0] + k3 * own[i7, 0]
                rows[p, 2 * level] = low * w0 + high * w
                low = k0 * own[i0, 1] + k1 * own[i1, 1] + k2 * own[i2, 1] + k3 * own[i3, 1]
                high = k0 * own[i4, 1] + k1 * own[i5, 1] + k2 * own[i6, 1] + k3 * own[i7, 1]
                rows[p, 2 * level + 1] = low * w0 + high * w


@numba.njit(cache=True, nogil=True, fastmath=_FUSED)
def encode_backward(start, stop, points, feature_gradient, resolutions, offsets, table_gradient):
    """Add the gradient of levels `start` to `stop` to `table_gradient` (entries, 2).

    A level owns its entries, so levels run in parallel without atomics and sums have one order.
    Points whose features of a level have no gradient are skipped.
    """
    cells, inside = np.empty((3, _CHUNK), np.int32), np.empty((4, _CHUNK), np.float32)
    entries, weights = np.empty((8, _CHUNK), np.uint32), np.empty((4, _CHUNK), np.float32)
    for level in range(start, stop):
        first = offsets[level]
        count = offsets[level + 1] - first
        own = table_gradient[first : first + count]
        for chunk in range(0, points.shape[0], _CHUNK):
            end = min(chunk + _CHUNK, points.shape[0])
            n = end - chunk
            here = points[chunk:end]
            _prepare(here, resolutions[level], count, cells, inside, entries, weights)
            rows = feature_gradient[chunk:end]
            for p in range(n):
                g0, g1 = rows[p, 2 * level], rows[p, 2 * level + 1]
                if g0 == _ZERO and g1 == _ZERO:
                    continue
                w = inside[2, p]
                w0 = _ONE - w
                for corner in range(4):
                    low, high = np.uint64(entries[corner, p]), np.uint64(entries[corner + 4, p])
                    k = weights[corner, p]
                    own[low, 0] += k * w0 * g0
                    own[low, 1] += k * w0 * g1
                    own[high, 0] += k * w * g0
                    own[high, 1] += k * w * g1
