"""Pictures and textures with gaps, filled from what is nearest."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import distance_transform_edt


def continue_nearest(
    values: Float[np.ndarray, "h w c"], known: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w c"]:
    """Return `values` with each unknown place continuing the nearest known one."""
    _, (row, column) = distance_transform_edt(~known, return_indices=True)
    return np.ascontiguousarray(values[row, column])
