"""Stage `train_nerf`: distil what the denoiser knows of the prompt into a latent scene.

Letters: b views a step, h x w latent pixels, v view texts of l tokens of width d, k flat backgrounds.
"""

import json
from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline import files
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.conditions import conditions_of
from pipeline.diffusion.guidance import diffusion_guidance, flat_backgrounds, load_embeddings
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import denoiser
from pipeline.divergence import explained
from pipeline.nerf_options import TrainNerf
from pipeline.report.latents import latent_preview
from pipeline.scene import checkpoint, occupancy
from pipeline.scene.batch import Guidance, require_finite
from pipeline.scene.cameras import Camera, ring
from pipeline.scene.convergence import (
    COOLING,
    KEPT,
    LOOK_EVERY,
    converged,
    first_decision,
    last_step,
    look,
)
from pipeline.scene.rendering import count_samples, render_views
from pipeline.scene.scene import Scene, density, save_scene
from pipeline.scene.shape_loss import unjudged_share
from pipeline.scene.sketch import Sketch, load_sketch
from pipeline.scene.training import Figures, State, initial_state, training_step
from pipeline.stage import Context, Progress, execute, say

PREVIEW = "preview_training.png"
_PREVIEW_VIEWS = 4
_JUDGED_STEPS = 20
_EMPTY, _FULL = 0.002, 0.98


def train(
    state: State,
    history: list[dict[str, Any]],
    options: TrainNerf,
    resolution: int,
    guidance: Guidance,
    keep: Callable[[State, list[dict[str, Any]]], None] = lambda state, history: None,
    show: Callable[[Scene], None] = lambda scene: None,
    sketch: Sketch | None = None,
) -> None:
    """Take the steps that `state` has not done yet, then settle its occupancy; record each step in `history`.

    A scene that has converged, by `options.convergence`, is cooled and takes no further steps. `keep` is
    called every `checkpoint_every` steps, `show` every `preview_every` steps.

    Raises:
        FloatingPointError: a NaN or an infinity, named by tensor and step.
    """

    def step(state: State) -> Figures:
        return training_step(state, options, resolution, guidance, sketch)

    cameras = preview_cameras(options)
    whole_from = max(options.level_ramp, options.coarse_share)
    first = first_decision(options.steps, whole_from) if options.convergence > 0 else None

    def at_rest(state: State) -> bool:
        # What the first decision needs, and no look before; none after the last step that could save one.
        if first is None or state.step % LOOK_EVERY:
            return False
        if not first - KEPT * LOOK_EVERY < state.step < options.steps - COOLING:
            return False
        state.looks = [*state.looks, look(state.scene, cameras, resolution)][-KEPT:]
        return state.step >= first and converged(state.looks, options.convergence)

    take_steps("train_nerf", state, history, options, step, keep, show, at_rest)


def take_steps(
    name: str,
    state: State,
    history: list[dict[str, Any]],
    options: TrainNerf,
    step: Callable[[State], Figures],
    keep: Callable[[State, list[dict[str, Any]]], None],
    show: Callable[[Scene], None],
    at_rest: Callable[[State], bool] = lambda state: False,
) -> None:
    """Take the steps of the stage `name` that are not done yet; once the scene is `at_rest`, which is asked
    after every step, only those that cool it; then settle the occupancy. See `train`."""

    def last() -> int:
        return last_step(options.steps, state.rest_at)

    with Progress(name, last(), "steps") as progress:
        while state.step < last():
            figures = step(state)
            history.append(_row(state.step, figures))
            progress.update(
                state.step, f"gradient {figures.gradient_norm:.2f}, opacity {figures.opacity:.2f}"
            )
            if state.rest_at is None and at_rest(state):
                state.rest_at, state.looks = state.step, []
                progress.total = last()
            if state.step % options.checkpoint_every == 0 and state.step < last():
                keep(state, history)
            if state.step % options.preview_every == 0:
                show(state.scene)
    if state.rest_at is not None:
        say(
            f"{name}: the scene had converged at step {state.rest_at} of {options.steps}: {COOLING} steps at "
            f"falling rates have ended it, {options.steps - state.step} were skipped"
        )
    scene = state.scene
    seen = scene.occupancy.occupied
    scene.occupancy = occupancy.settle(seen, lambda x: density(scene, x), scene.step, state.rng)
    require_finite("density", scene.occupancy.density, state.step)


def preview_cameras(options: TrainNerf) -> list[Camera]:
    """Return the cameras of the picture that shows how training goes."""
    return ring(
        _PREVIEW_VIEWS,
        np.deg2rad(75),
        float(np.mean(options.radius)),
        float(np.deg2rad(np.mean(options.fov_degrees))),
    )


def collapse(history: list[dict[str, Any]]) -> list[str]:
    """Return a warning if the last steps saw nothing at all, or nothing but the object."""
    opacity = float(np.mean([row["opacity"] for row in history[-_JUDGED_STEPS:]]))
    if opacity < _EMPTY:
        return [
            f"the scene is empty (mean opacity {opacity:.4f}): try another SEED, or lower "
            "train_nerf.opacity_weight"
        ]
    if opacity > _FULL:
        return [
            f"the scene fills every view (mean opacity {opacity:.4f}): try another SEED, or raise "
            "train_nerf.opacity_weight"
        ]
    return []


def main(context: Context) -> None:
    options = context.job.train_nerf
    bundle = open_bundle(context.inputs["unet"].parent, verify=False)
    embeddings = load_embeddings(context.inputs["embeddings"])
    schedule = load_schedule(context.inputs["scheduler"])
    resolution = options.resolution or bundle.latent_size
    sketch = load_sketch(context.inputs["sketch"]) if "sketch" in context.inputs else None
    warnings: list[str] = context.metrics.setdefault("warnings", [])

    state, history, damaged = checkpoint.load(context.scratch, options)
    if state is not None:
        say(f"train_nerf: continues after step {state.step}")
    else:
        state = initial_state(options, flat_backgrounds(embeddings), context.job.seed, sketch)
        say(f"train_nerf: a preview will appear at {context.scratch / PREVIEW}")
    warnings += [f"{name} was damaged: trained again from step {state.step}" for name in damaged]
    resumed_at = state.step

    def show(scene: Scene) -> None:
        partial = context.scratch / f".{PREVIEW}"
        views = render_views(scene, preview_cameras(options), resolution)
        latent_preview(views.latents, views.opacity, bundle).save(partial, format="PNG")
        files.publish([(partial, context.scratch / PREVIEW)])

    where = explained("train_nerf", "train_nerf", lambda: state.step, context.scratch)
    rows = 2 * options.cameras_per_step
    with (
        denoiser(
            context.inputs["unet"], provider=context.job.provider, rows_expected=rows, views=bundle.views
        ) as denoise,
        where,
    ):
        guidance = diffusion_guidance(denoise, schedule, embeddings, options, conditions_of(bundle))
        train(
            state,
            history,
            options,
            resolution,
            guidance,
            lambda state, history: checkpoint.save(context.scratch, state, history),
            show,
            sketch,
        )

    warnings += collapse(history)
    save_scene(context.outputs["scene"], state.scene)
    context.outputs["history"].write_text(json.dumps(history, allow_nan=False) + "\n", encoding="utf-8")
    context.metrics.update(
        resumed_at=resumed_at,
        resolution=resolution,
        skipped_samples=count_samples(state.scene, preview_cameras(options), resolution).skipped(),
        skipped_steps=options.steps - state.step,
        **({} if sketch is None else {"unjudged_share": unjudged_share(sketch, options.shape_sigma)}),
        **summary(state, history),
    )


def summary(state: State, history: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the figures of a finished training for the manifest."""
    last = history[-1]
    return {
        "steps": state.step,
        "opacity": last["opacity"],
        "gradient_norm": last["gradient_norm"],
        "shape_loss": last["shape"],
        "occupied_share": float(state.scene.occupancy.occupied.mean()),
        "samples_per_step": float(np.mean([row["samples"] for row in history])),
        "seconds": {part: round(sum(row["seconds"][part] for row in history), 3) for part in last["seconds"]},
    }


def _row(step: int, figures: Figures) -> dict[str, Any]:
    seconds = {part: round(value, 5) for part, value in figures.seconds.items()}
    return {"step": step, **figures._asdict(), "seconds": seconds}


if __name__ == "__main__":
    execute("train_nerf", main)
