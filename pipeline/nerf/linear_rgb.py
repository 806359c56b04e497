"""From latents to RGB by one linear layer: what makes a latent field an RGB field (Metzer et al. 2022, RGB
Refinement).

RGB in [0, 1] = matrix @ z + bias. A pixel is a weighted sum of samples whose weights sum to its opacity, so
the layer may be applied to composited latents, the bias taking part by the opacity: samples need not be
mapped one by one, and nothing that renders latents changes.

Letters: r rays.
"""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from pipeline.training.batch import LATENT_CHANNELS


class LinearRgb(nn.Module):
    """The layer; it is trained with the field."""

    def __init__(self, matrix: Float[np.ndarray, "3 4"], bias: Float[np.ndarray, " 3"]) -> None:
        """`matrix` and `bias` map scaled latents to RGB in [0, 1]."""
        super().__init__()
        self.matrix = nn.Parameter(torch.from_numpy(np.array(matrix, np.float32)))
        self.bias = nn.Parameter(torch.from_numpy(np.array(bias, np.float32)))

    @classmethod
    def zeros(cls) -> "LinearRgb":
        """Return a layer to be filled with saved values."""
        return cls(np.zeros((3, LATENT_CHANNELS)), np.zeros(3))

    def forward(self, latents: Float[Tensor, "r 4"], opacity: Float[Tensor, "r 1"]) -> Float[Tensor, "r 3"]:
        """Return the colours of latents that were composited to `opacity`, before any background."""
        return latents @ self.matrix.T + opacity * self.bias
