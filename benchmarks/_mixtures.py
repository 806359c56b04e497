"""Ideal denoisers that believe in several scenes at once, as every real one does.

Latents x_0 that show scene k of K are drawn from N(mu_k, s^2), mu_k being its picture from the camera of a
view; each scene is as likely as the others. Noisy latents x_t = a x_0 + sigma e then say with

    log w_k = -|x_t - a mu_k|^2 / (2 (a^2 s^2 + sigma^2)) + constant

which scene it is, and the mean of x_0 is sum_k w_k (mu_k + a s^2 / (a^2 s^2 + sigma^2) (x_t - a mu_k)). A
denoiser that judges the views of a step together, as multi-view models do, multiplies the likelihoods of its
views.

Letters: b views, k scenes, h x w latent pixels.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Float, Int

from benchmarks._ideal import Calls, Draw
from pipeline.diffusion.schedule import Schedule
from pipeline.training.batch import Batch


class Query(Protocol):
    """A denoiser as score distillation asks it, for the views of one step."""

    def __call__(
        self, noisy: Float[np.ndarray, "b 4 h w"], timesteps: Int[np.ndarray, " b"], told: bool
    ) -> Float[np.ndarray, "b 4 h w"]:
        """Return the noise in `noisy`, float64; `told`: with the text, else without one."""
        ...


class Believed(NamedTuple):
    """What scenes show in the views of a step."""

    pictures: Float[np.ndarray, "b k 4 h w"]
    told: Int[np.ndarray, " n"]
    """The scenes that a text leaves; without a text all of them may be it."""
    likely: Float[np.ndarray, "b n"] | None = None
    """How likely the text makes each of these in every view; None: all are equally."""


def believed(
    told: Sequence[Draw],
    others: Sequence[Draw],
    batch: Batch,
    size: int,
    likely: Float[np.ndarray, "b n"] | None = None,
) -> Believed:
    """Return the pictures of scenes that a text leaves, `likely` or not, and of others, in a step's views."""
    assert batch.backgrounds is not None
    views = list(zip(batch.cameras, batch.backgrounds, strict=True))
    scenes = [*told, *others]
    pictures = np.stack([np.stack([draw(camera, size, flat) for draw in scenes]) for camera, flat in views])
    return Believed(pictures.astype(np.float64), np.arange(len(told)), likely)


def weights(
    noisy: Float[np.ndarray, "b 4 h w"],
    pictures: Float[np.ndarray, "b k 4 h w"],
    factors: tuple[Float[np.ndarray, "b 1 1 1"], Float[np.ndarray, "b 1 1 1"]],
    spread: float,
    together: bool,
    likely: Float[np.ndarray, "b k"] | None = None,
) -> Float[np.ndarray, "b k"]:
    """Return how likely each scene is by what every view, or all of them together, shows; rows sum to 1.
    `likely`: before anything is seen; None: all are equally."""
    signal, sigma = (np.asarray(factor, np.float64) for factor in factors)
    variance = (signal**2 * spread**2 + sigma**2).reshape(-1, 1)
    apart = np.square(noisy[:, None] - signal[:, None] * pictures).sum((2, 3, 4))
    logarithm = -apart / (2 * variance)
    if likely is not None:
        logarithm = logarithm + np.log(np.maximum(likely, 1e-300))
    if together:
        logarithm = np.broadcast_to(logarithm.sum(0), logarithm.shape)
    likely = np.exp(logarithm - logarithm.max(1, keepdims=True))
    return likely / likely.sum(1, keepdims=True)


def clean_mean(
    noisy: Float[np.ndarray, "b 4 h w"],
    pictures: Float[np.ndarray, "b k 4 h w"],
    factors: tuple[Float[np.ndarray, "b 1 1 1"], Float[np.ndarray, "b 1 1 1"]],
    share: Float[np.ndarray, "b k"],
    spread: float,
) -> Float[np.ndarray, "b 4 h w"]:
    """Return the mean of x_0 for scenes of these shares; with one share of 1 it is what a few-step model
    answers, whose outputs are samples, not means."""
    signal, sigma = (np.asarray(factor, np.float64) for factor in factors)
    mean = np.einsum("bk,bkchw->bchw", share, pictures)
    gain = signal * spread**2 / (signal**2 * spread**2 + sigma**2)
    return mean + gain * (noisy - signal * mean)


def query_of(
    seen: Believed,
    schedule: Schedule,
    *,
    spread: float = 0.1,
    together: bool = False,
    few_steps: bool = False,
    calls: Calls | None = None,
) -> Query:
    """Return the ideal denoiser of what is believed; `few_steps`: the likeliest scene takes all weight."""

    def query(
        noisy: Float[np.ndarray, "b 4 h w"], timesteps: Int[np.ndarray, " b"], told: bool
    ) -> Float[np.ndarray, "b 4 h w"]:
        pictures = seen.pictures[:, seen.told] if told else seen.pictures
        factors = schedule.factors(timesteps)
        likely = seen.likely if told else None
        share = weights(noisy, pictures, factors, spread, together, likely)
        if few_steps:
            share = (np.arange(share.shape[1]) == share.argmax(1)[:, None]).astype(np.float64)
        clean = clean_mean(noisy, pictures, factors, share, spread)
        signal, sigma = factors
        if calls is not None:
            calls.runs += 1
            calls.views += len(noisy)
        return np.asarray((noisy - signal * clean) / sigma, np.float64)

    return query


def nearest(
    views: Float[np.ndarray, "b 4 h w"], pictures: Float[np.ndarray, "b k 4 h w"]
) -> Int[np.ndarray, " b"]:
    """Return the scene whose picture each view is most like."""
    return np.square(views[:, None] - pictures).mean((2, 3, 4)).argmin(1)


def commitment(choices: Int[np.ndarray, " b"]) -> float:
    """Return the share of views that are most like the scene that most of them are most like: 1 for one
    object, 1 / k for a heap of faces."""
    return float(np.bincount(choices).max() / len(choices))


Weaken = Callable[[Float[np.ndarray, "b 4 h w"], Int[np.ndarray, " b"]], Float[np.ndarray, "b 4 h w"]]
"""A predicted clean picture and timesteps -> what a weak network would have predicted."""


def weakened(query: Query, schedule: Schedule, weaken: Weaken) -> Query:
    """Return a denoiser whose predicted clean pictures are `weaken`ed."""

    def weak(
        noisy: Float[np.ndarray, "b 4 h w"], timesteps: Int[np.ndarray, " b"], told: bool
    ) -> Float[np.ndarray, "b 4 h w"]:
        signal, sigma = schedule.factors(timesteps)
        clean = (noisy - sigma * query(noisy, timesteps, told)) / signal
        return np.asarray((noisy - signal * weaken(clean, timesteps)) / sigma, np.float64)

    return weak
