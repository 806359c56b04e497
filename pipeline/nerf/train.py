"""The training of a radiance field: steps until they are done or the scene has converged.

Letters: h x w latent pixels of a view.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from pipeline.cameras import Camera, ring
from pipeline.nerf import occupancy
from pipeline.nerf.convergence import (
    COOLING,
    SNAPSHOT_EVERY,
    SNAPSHOTS,
    converged,
    first_decision,
    last_step,
    take_snapshot,
)
from pipeline.nerf.scene import density
from pipeline.nerf.step import NerfMetrics, State, training_step
from pipeline.options.nerf import TrainNerf
from pipeline.progress import say
from pipeline.sketch.lattice import Sketch
from pipeline.training.batch import ViewGradient, require_finite
from pipeline.training.loop import History, seconds_of, take_steps

_PREVIEW_VIEWS = 4
_LAST_STEPS = 20
_EMPTY, _FULL = 0.002, 0.98

Keep = Callable[[State, History], None]
Show = Callable[[State], None]


def nothing(*_: object) -> None:
    """Keep or show nothing."""


def train(
    state: State,
    history: History,
    options: TrainNerf,
    resolution: int,
    view_gradient: ViewGradient,
    *,
    keep: Keep = nothing,
    show: Show = nothing,
    sketch: Sketch | None = None,
    cooling: float = 0.0,
    until: int | None = None,
    stage: str = "train_nerf",
) -> None:
    """Take the steps that `state` has not done yet, then settle its occupancy; record each in `history`.

    Over the last share `cooling` of the run the learning rates fall to a tenth. A scene that has converged,
    by `options.convergence`, is cooled and takes no further steps. `keep`, `show`, and what is raised: see
    `training.loop.take_steps`. `until`: stop after so many steps, unsettled, in a state from which another
    call goes on as if there had been no stop.
    """
    cameras = preview_cameras(options)
    first = first_decision(options.steps) if options.convergence > 0 else None

    def step(state: State) -> NerfMetrics:
        metrics = training_step(state, options, resolution, view_gradient, sketch=sketch, cooling=cooling)
        if state.converged_at is None and _has_converged(state):
            state.converged_at, state.snapshots = state.step, []
        return metrics

    def _has_converged(state: State) -> bool:
        # What the first decision needs, and none before; none after the last step that could save one.
        if first is None or state.step % SNAPSHOT_EVERY:
            return False
        if not first - SNAPSHOTS * SNAPSHOT_EVERY < state.step < options.steps - COOLING:
            return False
        state.snapshots = [*state.snapshots, take_snapshot(state.scene, cameras, resolution)][-SNAPSHOTS:]
        return state.step >= first and converged(state.snapshots, options.convergence)

    if until is None:
        finish(stage, state, history, options, step, keep, show)
    else:
        take_steps(stage, state, history, options, step, keep=keep, show=show, note=_note, last=lambda: until)


def _note(metrics: NerfMetrics) -> str:
    return f"gradient {metrics.gradient_norm:.2f}, opacity {metrics.opacity:.2f}"


def finish(
    stage: str,
    state: State,
    history: History,
    options: TrainNerf,
    step: Callable[[State], NerfMetrics],
    keep: Keep = nothing,
    show: Show = nothing,
) -> None:
    """Take the steps of a stage that are not done yet (of a scene that has converged, those that cool it),
    then settle the occupancy."""
    take_steps(
        stage,
        state,
        history,
        options,
        step,
        keep=keep,
        show=show,
        note=_note,
        last=lambda: last_step(options.steps, state.converged_at),
    )
    if state.converged_at is not None:
        say(
            f"{stage}: the scene had converged at step {state.converged_at} of {options.steps}: {COOLING} "
            f"steps at falling rates have ended it, {options.steps - state.step} were skipped"
        )
    scene = state.scene
    scene.occupancy = occupancy.settle(
        scene.occupancy.occupied, partial(density, scene), scene.step, state.rng
    )
    require_finite("density", scene.occupancy.density, state.step)


def preview_cameras(options: TrainNerf) -> list[Camera]:
    """Return the cameras of the picture that shows how training goes."""
    return ring(
        _PREVIEW_VIEWS,
        np.deg2rad(75),
        float(np.mean(options.radius)),
        float(np.deg2rad(np.mean(options.fov_degrees))),
    )


def collapse(history: History) -> list[str]:
    """Return a warning if the last steps saw nothing at all, or nothing but the object."""
    opacity = float(np.mean([row["opacity"] for row in history[-_LAST_STEPS:]]))
    if _EMPTY <= opacity <= _FULL:
        return []
    fault, way = ("is empty", "lower") if opacity < _EMPTY else ("fills every view", "raise")
    return [
        f"the scene {fault} (mean opacity {opacity:.4f}): try another SEED, or {way} "
        "train_nerf.opacity_weight"
    ]


def metrics_of(state: State, history: History) -> dict[str, Any]:
    """Return the metrics of a finished training for the manifest."""
    last = history[-1]
    return {
        "steps": state.step,
        "opacity": last["opacity"],
        "gradient_norm": last["gradient_norm"],
        "shape_loss": last["shape"],
        "occupied_share": float(state.scene.occupancy.occupied.mean()),
        "samples_per_step": float(np.mean([row["samples"] for row in history])),
        "seconds": seconds_of(history),
    }
