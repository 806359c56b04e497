"""Views of something that is known, encoded once: what a start is fitted to.

The encoder costs as much as a step of the denoiser, so it sees a fixed number of views, each over one of the
flat backgrounds that training draws from. Letters: b views of a group, h x w latent pixels, s pixels along a
side of the encoder's pictures, k flat backgrounds.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pipeline.cameras import Camera
from pipeline.training.batch import Batch

Pictures = Callable[[Sequence[Camera], int], tuple[Float[np.ndarray, "b s s 3"], Float[np.ndarray, "b s s"]]]
"""Cameras and a size -> what they see before nothing (colours times opacity, in [0, 1]), and its opacity."""
Encode = Callable[[Float[np.ndarray, "b s s 3"]], Float[np.ndarray, "b 4 h w"]]
Group = tuple[list[Camera], Float[np.ndarray, " b"], Float[np.ndarray, " b"]]
"""Cameras, azimuths and polar angles [rad]."""
_WEIGHT = 4.0
"""Of the pull towards known latents, against the regularisers; see `diffusion.rgb_gradients`."""


class Backdrops(NamedTuple):
    """Flat backgrounds."""

    latents: Float[np.ndarray, "k 4"]
    colours: Float[np.ndarray, "k 3"]
    """RGB in [0, 1]."""


class EncodedGroup(NamedTuple):
    """The views of one step."""

    views: Group
    backgrounds: Float[np.ndarray, "b 4"]
    latents: Float[np.ndarray, "b 4 h w"]


def encode_groups(
    groups: Sequence[Group],
    pictures: Pictures,
    encode: Encode,
    backdrops: Backdrops,
    size: int,
    rng: np.random.Generator,
    tell: Callable[[int], None] = lambda done: None,
) -> list[EncodedGroup]:
    """Return what the encoder makes of views, each over a background drawn for it; `tell` hears how many
    views are encoded."""
    encoded, done = [], 0
    for group in groups:
        cameras = group[0]
        colours, opacity = pictures(cameras, size)
        rows = rng.integers(len(backdrops.latents), size=len(cameras))
        flat = backdrops.colours[rows][:, None, None]
        shown = (colours + (1 - opacity[..., None]) * flat).clip(0, 1).astype(np.float32)
        encoded.append(EncodedGroup(group, backdrops.latents[rows], encode(shown)))
        tell(done := done + len(cameras))
    return encoded


class KnownViews:
    """Gives one group a step, over and over, and pulls what is rendered towards it."""

    def __init__(self, groups: Sequence[EncodedGroup]) -> None:
        self.groups = groups
        self.now = groups[0]

    def draw(self, step: int) -> Batch:
        """Return the batch of a step; it has no noise, since no denoiser is asked."""
        self.now = self.groups[step % len(self.groups)]
        cameras, azimuths, polars = self.now.views
        zeros = np.zeros((len(cameras), 4, 1, 1), np.float32)
        return Batch(cameras, azimuths, polars, self.now.backgrounds, np.zeros(len(cameras)), zeros, 1.0, 0.0)

    def gradient(self, latents: Float[np.ndarray, "b 4 h w"], batch: Batch) -> Float[np.ndarray, "b 4 h w"]:
        """Return the gradient of half the squared distance, weighted: see `training.batch.ViewGradient`."""
        return np.asarray(_WEIGHT * (latents - self.now.latents), np.float32)
