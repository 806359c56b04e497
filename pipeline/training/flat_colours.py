"""The colours that views are drawn on."""

import numpy as np
from jaxtyping import Float


def flat_colours() -> Float[np.ndarray, "64 3"]:
    """Return 64 colours evenly over the RGB cube, black, white and greys among them."""
    steps = np.linspace(0, 1, 4, dtype=np.float32)
    return np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
