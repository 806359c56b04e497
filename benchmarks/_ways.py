"""The ways of score distillation that are compared: a gradient, what it is asked, and by which schedule.

Each differs from `sds`, two updates of the field a step, in the one thing that its name says; those that ask
more than twice a step take two updates a call as `4 updates` does, or their few steps would learn nothing.
`passes` are runs of the network a step, with and without the text; `alone` those on a scene that leaves
nothing to be guided by, 0 where such a scene says nothing. Guidance is 7.5, as most of their papers have it,
where nothing else is said.

Letters: b views, h x w latent pixels.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from benchmarks._gradients import METHODS
from pipeline.training.batch import Batch

TOTAL = 1000
GUIDANCE = 7.5
CAMERA_SETS = 8
"""Of fixed cameras."""


class Way(NamedTuple):
    """One way."""

    gradient: str = "sds"
    passes: int = 2
    alone: int = 1
    guidance: tuple[float, float] = (GUIDANCE, GUIDANCE)
    """At the first and the last step."""
    options: Mapping[str, Any] = MappingProxyType({"updates_per_call": 2})
    """Of train_nerf."""
    draw: str = ""
    """How batches differ from those of training: see `Draws`."""


UPDATES = {f"{n} update{'s' * (n > 1)}": Way(options={"updates_per_call": n}) for n in (1, 4, 8)}
WAYS: dict[str, Way] = {
    "sds": Way(),
    **UPDATES,
    "paper's weight": Way(options={"updates_per_call": 2, "signal_power": 0.5}),
    "uniform noise levels": Way(options={"updates_per_call": 2, "timestep_max_end": 0.98}),
    "DreamTime": Way(draw="dream time"),
    "fixed noise": Way(draw="fixed noise"),
    "fixed cameras": Way(draw="fixed cameras"),
    "replay": Way(draw="replay"),
    "csd": Way("csd", alone=0),
    "nfsd": Way("nfsd", alone=0),
    "ism": Way("ism", 6, 5, options={"updates_per_call": 12}),
    "sdi": Way("sdi", 12, 11, options={"updates_per_call": 24}),
    "4 steps": Way("4 steps", 8, 4, options={"updates_per_call": 16}),
    "guidance 1": Way(passes=1, alone=0, guidance=(1.0, 1.0)),
    "guidance 30": Way(alone=0, guidance=(30.0, 30.0)),
    "falling guidance": Way(alone=0, guidance=(15.0, 1.5)),
    "guidance interval": Way("interval", alone=0),
    "perp-neg": Way("perp-neg", 3, alone=0),
}
GRADIENTS = ("sds", "4 updates", "8 updates", "csd", "nfsd", "ism", "sdi", "4 steps")
"""Those that weak and few-step networks are asked by."""
FACED = ("sds", "csd", "4 updates", "perp-neg")
"""Those that are asked about sides."""
assert {way.gradient for way in WAYS.values()} <= set(METHODS)


def dream_time(progress: float) -> float:
    """Return the noise level of DreamTime at `progress` in [0, 1] (Huang et al. 2023): it never rises, and
    levels pass as quickly as their weight is small, exp(-(t - m)^2 / 2 s^2) above m, s = 800, 300 and below
    500, 100, and 1 between."""
    t = np.arange(20, 981)
    weight = np.where(t > 800, np.exp(-((t - 800) ** 2) / (2 * 300**2)), 1.0)
    weight = np.where(t < 500, np.exp(-((t - 500) ** 2) / (2 * 100**2)), weight)
    left = np.cumsum(weight[::-1])[::-1] / weight.sum()
    return float(t[np.abs(left - progress).argmin()]) / TOTAL


class Draws:
    """Batches of a way, made of those that training draws."""

    def __init__(self, kind: str, seed: int) -> None:
        self.kind = kind
        self.rng = np.random.default_rng([seed, 5])
        self.sets: list[Batch] = []
        self.remembered: list[Batch] = []
        """Views of earlier steps, one a batch, for `replay`."""
        self.replayed: list[int] = []
        """Which of them are behind the views of the step."""

    def __call__(self, batch: Batch, step: int, progress: float) -> Batch:
        """Return the batch of a step."""
        if self.kind == "dream time":
            return batch._replace(noise_levels=np.full_like(batch.noise_levels, dream_time(progress)))
        if self.kind == "replay":
            return self._with_earlier(batch)
        if self.kind.startswith("fixed"):
            return self._fixed(batch, step)
        return batch

    def _fixed(self, batch: Batch, step: int) -> Batch:
        if len(self.sets) < CAMERA_SETS:
            self.sets.append(batch)
        known = self.sets[step % CAMERA_SETS]
        if self.kind == "fixed noise":
            return batch._replace(noise=self.sets[0].noise)
        return batch._replace(
            cameras=known.cameras,
            azimuths=known.azimuths,
            polars=known.polars,
            backgrounds=known.backgrounds,
        )

    def _with_earlier(self, batch: Batch) -> Batch:
        """Return the views of a step and as many of earlier ones behind them."""
        count = min(len(batch.cameras), len(self.remembered))
        self.replayed = [int(i) for i in self.rng.choice(len(self.remembered), count, replace=False)]
        parts = [batch, *(self.remembered[i] for i in self.replayed)]
        self.remembered += [one_view(batch, i) for i in range(len(batch.cameras))]
        return batch._replace(
            cameras=[camera for part in parts for camera in part.cameras],
            azimuths=np.concatenate([part.azimuths for part in parts]),
            polars=np.concatenate([part.polars for part in parts]),
            backgrounds=np.concatenate([part.backgrounds for part in parts]),
            noise_levels=np.concatenate([part.noise_levels for part in parts]),
            noise=np.concatenate([part.noise for part in parts]),
        )


def one_view(batch: Batch, row: int) -> Batch:
    """Return a batch of one of the views."""
    at = slice(row, row + 1)
    assert batch.backgrounds is not None
    return batch._replace(
        cameras=batch.cameras[at],
        azimuths=batch.azimuths[at],
        polars=batch.polars[at],
        backgrounds=batch.backgrounds[at],
        noise_levels=batch.noise_levels[at],
        noise=batch.noise[at],
    )


class Targets:
    """What earlier views were told to become, for `replay`."""

    def __init__(self) -> None:
        self.wished: list[tuple[Float[np.ndarray, "4 h w"], float]] = []
        """Clean latents, and the weight of the way to them, a view."""

    def remember(
        self,
        latents: Float[np.ndarray, "b 4 h w"],
        gradient: Float[np.ndarray, "b 4 h w"],
        weight: Float[np.ndarray, " b"],
    ) -> None:
        """Note where gradients lead: they are `weight` times the way to clean latents."""
        for view, push, share in zip(latents, gradient, weight, strict=True):
            self.wished.append((view - push / share, float(share)))

    def gradient(
        self, latents: Float[np.ndarray, "b 4 h w"], which: list[int]
    ) -> Float[np.ndarray, "b 4 h w"]:
        """Return the gradients of earlier views as they look now."""
        return np.stack([self.wished[i][1] * (z - self.wished[i][0]) for z, i in zip(latents, which)])
