"""Whether a scene has converged, and how its training then ends early.

A scene in score distillation never stops moving, since noise and views are drawn anew each step. It has
converged when it moves without going anywhere: when snapshots (fixed views) differ from one window of steps
to the next no more than within these windows. Going on would then only shrink this noise, little by little,
as lower noise levels are drawn. Letting the learning rates fall shrinks it at once: `COOLING` steps at
falling rates, in which the rest of the schedule runs by, take about as much from the errors as all the steps
that they replace (`make bench ONLY=oracle`: mostly more, a few per cent less at worst).

Letters: n snapshots, v views, h x w latent pixels.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pipeline.cameras import Camera
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import Scene
from pipeline.training.adam import rate_share

SNAPSHOT_EVERY = 10
"""Steps between two snapshots."""
WINDOW = 6
"""Snapshots in a window. With three, a ball that drifted slowly passed for converged, its views 9 % off."""
CALM = 3
"""So many snapshots in a row have to find the scene converged."""
SNAPSHOTS = 2 * WINDOW + CALM - 1
"""Snapshots that the decision needs."""
COOLING = 100
"""Steps in which a scene that has converged comes to its end; measured with four views and two updates a
step, as the default model has them."""


def take_snapshot(scene: Scene, cameras: Sequence[Camera], size: int) -> Float[np.ndarray, "v 4 h w"]:
    """Return latents of the scene before nothing: composited over zeros."""
    return render_views(scene, cameras, size, np.zeros(4, np.float32)).latents


def drift(snapshots: Float[np.ndarray, "n v 4 h w"]) -> float:
    """Return how far the mean of the second half of the snapshots is from that of the first, in standard
    errors.

    The root mean square over all latents of the difference of the means, over that of its standard error,
    estimated from the variances within the halves: about 1 for independent snapshots of a scene that only
    has noise; infinity for one that moves without noise, 0 for one that does neither.
    """
    first, second = (half.astype(np.float64) for half in np.split(snapshots, 2))
    moved = np.square(second.mean(0) - first.mean(0)).mean()
    within = (first.var(0, ddof=1) + second.var(0, ddof=1)).mean() / len(first)
    return float(np.sqrt(moved / within)) if within > 0 else (float("inf") if moved > 0 else 0.0)


def converged(snapshots: Sequence[Float[np.ndarray, "v 4 h w"]], bound: float) -> bool:
    """Return whether the last `CALM` drifts, each of `WINDOW` snapshots against the `WINDOW` before, are all
    below `bound`."""
    if len(snapshots) < SNAPSHOTS:
        return False
    recent = np.stack(snapshots[-SNAPSHOTS:])
    return all(drift(recent[start : start + 2 * WINDOW]) < bound for start in range(CALM))


class Pace(NamedTuple):
    """Where a step is in its run."""

    progress: float
    """In [0, 1]: what noise, guidance and losses go by."""
    rate: float
    """Share of the learning rates, in (0, 1]."""


def pace(step: int, steps: int, converged_at: int | None) -> Pace:
    """Return the pace of a step (counted from 0) of a run of so many steps.

    A scene found converged after `converged_at` steps goes through what is left of the schedule in `COOLING`
    steps, while the rates fall to a tenth.
    """
    progress = step / max(steps - 1, 1)
    if converged_at is None:
        return Pace(progress, 1.0)
    cooled = (step + 1 - converged_at) / COOLING
    found = converged_at / max(steps - 1, 1)
    return Pace(found + (1 - found) * cooled, rate_share(1.0, cooled))


def first_decision(steps: int) -> int | None:
    """Return the step after which a run of so many may first be found converged; None where cooling from
    there would save nothing.

    Half of the run is done then, and enough snapshots were taken.
    """
    first = max(-(-steps // 2), SNAPSHOTS * SNAPSHOT_EVERY)
    return first if first + COOLING < steps else None


def last_step(steps: int, converged_at: int | None) -> int:
    """Return how many steps a run takes in all."""
    return steps if converged_at is None else converged_at + COOLING
