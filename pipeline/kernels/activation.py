"""The field's network between its matrix products: each function is one pass over a block of points.

Letters: n points, h hidden units, c channels of the latents. Column 0 of the network's output is the
logarithm of the density, less what depends on the place alone; the others are the latents. NaN stays NaN.
"""

import math

import numba
import numpy as np

_REORDERED = {"contract", "reassoc"}
"""A product may be rounded together with the sum it goes into, and a sum over hidden units be taken eight at
a time: in an order of its own, the same every time."""


@numba.njit(cache=True, nogil=True)
def activate(output, points, constants, density, latents):
    """Write `density` (n,) and `latents` (n, c) of the network's `output` (n, 1 + c) at `points` (n, 3).

    The logarithm is that of the output, plus a bias and a Gaussian. The `constants` are the Gaussian's
    height, its exponent by the squared distance from the origin, the bias, a factor of the density, and the
    most that the logarithm may be.
    """
    blob, falloff, bias = constants[0], constants[1], constants[2]
    sharpening, most = constants[3], constants[4]
    for p in range(output.shape[0]):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        logarithm = output[p, 0] + bias + blob * math.exp((x * x + y * y + z * z) * falloff)
        logarithm = most if logarithm > most else logarithm
        density[p] = math.exp(logarithm) * sharpening
        for c in range(latents.shape[1]):
            latents[p, c] = output[p, 1 + c]


@numba.njit(cache=True, nogil=True)
def activate_backward(density_gradient, latent_gradient, density, least, output_gradient):
    """Write the gradient by the network's output (n, 1 + c), given those by density and latents.

    The derivative of the density is itself, or `least` where that is more.
    """
    for p in range(density.shape[0]):
        slope = least if density[p] < least else density[p]
        output_gradient[p, 0] = density_gradient[p] * slope
        for c in range(latent_gradient.shape[1]):
            output_gradient[p, 1 + c] = latent_gradient[p, c]


@numba.njit(cache=True, nogil=True)
def relu(hidden, bias):
    """Add `bias` (h,) to rows `hidden` (n, h) and put what is negative to zero, in place."""
    for p in range(hidden.shape[0]):
        for k in range(hidden.shape[1]):
            value = hidden[p, k] + bias[k]
            hidden[p, k] = np.float32(0) if value < np.float32(0) else value


@numba.njit(cache=True, nogil=True, fastmath=_REORDERED)
def relu_linear(hidden, bias, weight, output_bias, output):
    """Do `relu` and write the five outputs (n, 5) of the layer behind it, of `weight` (5, h).

    A matrix product with so few columns takes as long as one with 64. Written out: in a loop over outputs
    each would wait for its own sum.
    """
    zero = np.float32(0)
    w0, w1, w2, w3, w4 = weight[0], weight[1], weight[2], weight[3], weight[4]
    for p in range(hidden.shape[0]):
        row = hidden[p]
        for k in range(row.shape[0]):
            value = row[k] + bias[k]
            row[k] = zero if value < zero else value
        s0, s1, s2, s3, s4 = zero, zero, zero, zero, zero
        for k in range(row.shape[0]):
            s0 += row[k] * w0[k]
            s1 += row[k] * w1[k]
            s2 += row[k] * w2[k]
            s3 += row[k] * w3[k]
            s4 += row[k] * w4[k]
        output[p, 0] = s0 + output_bias[0]
        output[p, 1] = s1 + output_bias[1]
        output[p, 2] = s2 + output_bias[2]
        output[p, 3] = s3 + output_bias[3]
        output[p, 4] = s4 + output_bias[4]


@numba.njit(cache=True, nogil=True)
def relu_backward(gradient, hidden, bias_gradient):
    """Put the gradient (n, h) to zero where `hidden` is, in place; write its sums over the rows (h,)."""
    bias_gradient[:] = 0
    for p in range(hidden.shape[0]):
        for k in range(hidden.shape[1]):
            value = np.float32(0) if hidden[p, k] <= np.float32(0) else gradient[p, k]
            gradient[p, k] = value
            bias_gradient[k] += value
