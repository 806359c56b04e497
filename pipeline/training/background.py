"""What is seen behind the object: one of a few flat colours, or a small network of the viewing direction.

Letters: r rays, k flat colours of c channels, d features of an encoded direction.
"""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from pipeline.training.batch import LATENT_CHANNELS

_OCTAVES = 6
_HIDDEN = 64


class FlatBackground(nn.Module):
    """Flat colours, one of them drawn for each training view: nothing can hide in what it cannot predict."""

    colours: Tensor

    def __init__(self, colours: Float[np.ndarray, "k c"]) -> None:
        """`colours` are latents (c = 4) or, of a refined scene, RGB; where none is asked for, the first."""
        super().__init__()
        self.register_buffer("colours", torch.from_numpy(np.array(colours, np.float32)))

    def forward(self, directions: Float[Tensor, "r 3"]) -> Float[Tensor, "r c"]:
        """Return the first colour for every ray."""
        return self.colours[:1].expand(len(directions), -1)


class LearnedBackground(nn.Module):
    """Latents as a function of the direction: frequency encoding, one hidden layer (the paper's code)."""

    def __init__(self, rng: np.random.Generator) -> None:
        super().__init__()
        inputs = 3 + 2 * 3 * _OCTAVES

        def uniform(bound: float, *size: int) -> nn.Parameter:
            return nn.Parameter(torch.from_numpy(rng.uniform(-bound, bound, size).astype(np.float32)))

        self.weight1, self.bias1 = uniform(inputs**-0.5, _HIDDEN, inputs), uniform(inputs**-0.5, _HIDDEN)
        self.weight2 = uniform(_HIDDEN**-0.5, LATENT_CHANNELS, _HIDDEN)
        self.bias2 = uniform(_HIDDEN**-0.5, LATENT_CHANNELS)

    def forward(self, directions: Float[Tensor, "r 3"]) -> Float[Tensor, "r 4"]:
        """Return the latents seen along unit `directions`."""
        hidden = torch.addmm(self.bias1, frequency_encoding(directions, _OCTAVES), self.weight1.T).relu()
        return torch.addmm(self.bias2, hidden, self.weight2.T)


def frequency_encoding(directions: Float[Tensor, "r 3"], octaves: int) -> Float[Tensor, "r d"]:
    """Return x, sin(2^i x) and cos(2^i x) for i < `octaves`."""
    angles = [directions * 2.0**i for i in range(octaves)]
    return torch.cat([directions, *(f(a) for a in angles for f in (torch.sin, torch.cos))], dim=-1)


Background = FlatBackground | LearnedBackground
