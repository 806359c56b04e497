"""Adam's step, in one pass over a parameter and its moments."""

import numba
import numpy as np

_ONE = np.float32(1)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def step(start, stop, parameter, gradient, mean, square, factors):
    """Move elements `start` to `stop` of a parameter along its gradient; update both moments in place.

    Args:
        parameter, gradient, mean, square: flat float32 arrays of one length.
        factors: float32, (1 - beta1, 1 - beta2, rate / (1 - beta1^t), sqrt(1 - beta2^t), epsilon).
    """
    new1, new2, rate, root, epsilon = factors[0], factors[1], factors[2], factors[3], factors[4]
    for i in range(start, stop):
        g = gradient[i]
        m = mean[i] + new1 * (g - mean[i])
        v = (_ONE - new2) * square[i] + new2 * g * g
        mean[i], square[i] = m, v
        parameter[i] -= rate * m / (np.sqrt(v) / root + epsilon)
