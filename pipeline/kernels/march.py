"""Marching rays through an occupancy grid, and the volume rendering of the samples met (Max 1995).

Letters: r rays, n samples of all rays, a ray's samples being `offsets[i]` to `offsets[i + 1]` in order of
distance. A sample is evaluated by the field only when something in front of it does not hide it: `rows[s]`
says where in the field's results it stands, -1 that it was never evaluated (nor anything behind it). All
samples of a call have the length `step` [scene units]. Sums run in double precision and in log space: a
transmittance is exp(-sum).
"""

import math

import numba
import numpy as np

LOG_STOP = math.log(1e-4)
"""A ray ends where its transmittance falls below 1e-4."""

_ONE, _HALF = np.float32(1), np.float32(0.5)


@numba.njit(inline="always")
def _clip(origins, directions, ray, near):
    """Return the distances at which a ray enters and leaves the box [-1, 1]^3 (enter >= leave: it misses)."""
    enter, leave = near, np.float32(np.inf)
    for axis in range(3):
        o, d = origins[ray, axis], directions[ray, axis]
        if d != 0:
            a, b = (-_ONE - o) / d, (_ONE - o) / d
            enter = max(enter, min(a, b))
            leave = min(leave, max(a, b))
        elif not (-_ONE <= o <= _ONE):
            leave = -_ONE
    return enter, leave


@numba.njit(inline="always")
def _cell(coordinate, side):
    """Return the cell of a coordinate, clamped to the grid (also for a NaN)."""
    scaled = (coordinate * _HALF + _HALF) * np.float32(side)
    return min(np.int64(scaled), side - 1) if scaled > 0 else 0


@numba.njit(inline="always")
def _occupied(origins, directions, ray, distance, occupied):
    side = occupied.shape[0]
    x = _cell(origins[ray, 0] + distance * directions[ray, 0], side)
    y = _cell(origins[ray, 1] + distance * directions[ray, 1], side)
    z = _cell(origins[ray, 2] + distance * directions[ray, 2], side)
    return occupied[x, y, z]


@numba.njit(cache=True, nogil=True)
def count(start, stop, origins, directions, jitter, near, step, occupied, counts):
    """Write to `counts` (r,) how many samples of each ray lie in occupied cells of the grid (g, g, g)."""
    for ray in range(start, stop):
        enter, leave = _clip(origins, directions, ray, near)
        found = 0
        i = 0
        distance = enter + jitter[ray] * step
        while distance < leave:
            if _occupied(origins, directions, ray, distance, occupied):
                found += 1
            i += 1
            distance = enter + (np.float32(i) + jitter[ray]) * step
        counts[ray] = found


@numba.njit(cache=True, nogil=True)
def fill(start, stop, origins, directions, jitter, near, step, occupied, offsets, distances):
    """Write to `distances` (n,) those of the samples that `count` counted."""
    for ray in range(start, stop):
        end = offsets[ray + 1]
        s = offsets[ray]
        if s == end:
            continue
        enter, _ = _clip(origins, directions, ray, near)
        i = 0
        while s < end:
            distance = enter + (np.float32(i) + jitter[ray]) * step
            if _occupied(origins, directions, ray, distance, occupied):
                distances[s] = distance
                s += 1
            i += 1


@numba.njit(cache=True, nogil=True)
def gather(start, stop, origins, directions, distances, cursor, take, first, base, rows, points):
    """Place the next `take` samples of each ray from `cursor` on: their `rows` from `first`, their `points`.

    `points` is that of this round alone, whose first row is `base`.
    """
    for ray in range(start, stop):
        for i in range(take[ray]):
            s, row = cursor[ray] + i, first[ray] + i
            rows[s] = row
            for axis in range(3):
                points[row - base, axis] = origins[ray, axis] + distances[s] * directions[ray, axis]


@numba.njit(cache=True, nogil=True)
def attenuate(start, stop, density, take, first, base, step, log_transmittance):
    """Let the samples of one round dim the rays: `density` is that of its rows, the first being `base`."""
    for ray in range(start, stop):
        for i in range(take[ray]):
            log_transmittance[ray] -= np.float64(density[first[ray] + i - base]) * step


@numba.njit(cache=True, nogil=True)
def composite(
    start,
    stop,
    density,
    latents,
    distances,
    rows,
    offsets,
    step,
    log_stop,
    pixels,
    depth,
    log_transmittance,
    used,
):
    """Sum latents (n, c) and distances along each ray, weighted by T_i (1 - exp(-density_i step)).

    Writes `pixels` (r, c), `depth` (r,), the log of the transmittance left, and how many samples were `used`:
    a ray ends where the log of its transmittance falls below `log_stop`.
    """
    channels = latents.shape[1]
    total = np.empty(channels)
    for ray in range(start, stop):
        total[:] = 0
        far = 0.0
        dimmed = 0.0
        transmittance = 1.0
        n = 0
        for s in range(offsets[ray], offsets[ray + 1]):
            row = rows[s]
            if row < 0 or dimmed < log_stop:
                break
            optical = np.float64(density[row]) * step
            weight = transmittance * -math.expm1(-optical)
            for c in range(channels):
                total[c] += weight * latents[row, c]
            far += weight * distances[s]
            transmittance -= weight
            dimmed -= optical
            n += 1
        for c in range(channels):
            pixels[ray, c] = total[c]
        depth[ray] = far
        log_transmittance[ray] = dimmed
        used[ray] = n


@numba.njit(cache=True, nogil=True)
def composite_backward(
    start,
    stop,
    density,
    latents,
    distances,
    rows,
    offsets,
    step,
    used,
    pixel_gradient,
    depth_gradient,
    log_gradient,
    density_gradient,
    latent_gradient,
):
    """Write the gradients by density and latents, given those by `composite`'s first three results.

    With s_i = latents_i . g + distance_i g_depth the derivative by density_i is
    step (T_(i+1) s_i - sum_(j > i) w_j s_j - g_log): a walk from the last sample to the first.
    """
    channels = latents.shape[1]
    room = np.empty((2, 64))
    for ray in range(start, stop):
        begin, n = offsets[ray], used[ray]
        if n > room.shape[1]:
            room = np.empty((2, 2 * n))
        weights, after = room
        transmittance = 1.0
        for i in range(n):
            weights[i] = transmittance * -math.expm1(-np.float64(density[rows[begin + i]]) * step)
            transmittance -= weights[i]
            after[i] = transmittance
        behind = 0.0
        for i in range(n - 1, -1, -1):
            s = begin + i
            row = rows[s]
            shade = np.float64(distances[s]) * depth_gradient[ray]
            for c in range(channels):
                shade += np.float64(latents[row, c]) * pixel_gradient[ray, c]
                latent_gradient[row, c] = weights[i] * pixel_gradient[ray, c]
            density_gradient[row] = step * (after[i] * shade - behind - log_gradient[ray])
            behind += weights[i] * shade
