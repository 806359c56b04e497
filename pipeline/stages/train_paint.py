"""Stage `train_paint`: distil what the denoiser knows of the prompt into the colours of a given mesh."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from torch import nn

from pipeline import checkpoint_files, files
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.conditions import conditions_of
from pipeline.diffusion.guidance import diffusion_guidance, flat_backgrounds, load_embeddings
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import denoiser
from pipeline.divergence import explained
from pipeline.paint_options import TrainPaint
from pipeline.report.latents import latent_preview
from pipeline.scene.batch import Guidance
from pipeline.scene.paint_mesh import load_paint_mesh
from pipeline.scene.painted import Painted, complete, save_painted
from pipeline.scene.painting import PaintState, Pool, initial_paint, make_pool, paint_optimizer, paint_step
from pipeline.stage import Context, Progress, execute, say

PREVIEW = "preview_training.png"

History = list[dict[str, Any]]


def train(
    state: PaintState,
    history: History,
    options: TrainPaint,
    pool: Pool,
    guidance: Guidance,
    keep: Callable[[PaintState, History], None] = lambda state, history: None,
    show: Callable[[PaintState], None] = lambda state: None,
    name: str = "train_paint",
    noise_size: int | None = None,
) -> None:
    """Take the steps of the stage `name` that `state` has not done yet; record each in `history`.

    `keep` is called every `checkpoint_every` steps, `show` every `preview_every` steps. `noise_size`: see
    `paint_step`.

    Raises:
        FloatingPointError: a NaN or an infinity, named by tensor and step.
    """
    with Progress(name, options.steps, "steps") as progress:
        while state.step < options.steps:
            figures = paint_step(state, options, pool, guidance, noise_size)
            seconds = {part: round(value, 5) for part, value in figures.seconds.items()}
            history.append({"step": state.step, **figures._asdict(), "seconds": seconds})
            progress.update(state.step, f"gradient {figures.gradient_norm:.2f}")
            if state.step % options.checkpoint_every == 0 and state.step < options.steps:
                keep(state, history)
            if state.step % options.preview_every == 0:
                show(state)


def encode_state(state: PaintState, history: History) -> dict[str, np.ndarray]:
    """Return everything a resumed run needs, as named arrays."""
    progress = {"step": state.step, "rng": state.rng.bit_generator.state, "history": history}
    return {
        "progress": np.frombuffer(json.dumps(progress).encode(), np.uint8),
        "colours": state.colours.detach().numpy(),
        **{f"background.{name}": value.numpy() for name, value in state.background.state_dict().items()},
        **checkpoint_files.adam_arrays(state.optimizer),
    }


def decode_state(
    values: Mapping[str, np.ndarray], options: TrainPaint, state: PaintState
) -> tuple[PaintState, History]:
    """Return what `encode_state` took apart, put into `state`, an initial one of the same options.

    Raises ValueError if it belongs to other options.
    """
    try:
        progress = json.loads(values["progress"].tobytes())
        saved = {
            name.removeprefix("background."): torch.from_numpy(value.copy())
            for name, value in values.items()
            if name.startswith("background.")
        }
        state.background.load_state_dict(saved)
        if values["colours"].shape != tuple(state.colours.shape):
            raise ValueError("another number of colours")
    except (KeyError, RuntimeError) as error:
        raise ValueError(f"not a state of this training: {error}") from None
    state.colours = nn.Parameter(torch.from_numpy(values["colours"].copy()))
    state.optimizer = paint_optimizer(state.colours, state.background, options)
    checkpoint_files.restore_adam(state.optimizer, values)
    state.rng.bit_generator.state = progress["rng"]
    state.step = progress["step"]
    return state, progress["history"]


def main(context: Context) -> None:
    options = context.job.train_paint
    bundle = open_bundle(context.inputs["unet"].parent, verify=False)
    embeddings = load_embeddings(context.inputs["embeddings"])
    backgrounds = flat_backgrounds(embeddings)
    schedule = load_schedule(context.inputs["scheduler"])
    mesh = load_paint_mesh(context.inputs["mesh"]).scaled(options.mesh_radius)
    texture = options.texture if context.job.param == "texture" else None
    pool = make_pool(mesh, options, texture, options.resolution or bundle.latent_size, context.job.seed)
    warnings: list[str] = context.metrics.setdefault("warnings", [])

    found, damaged = checkpoint_files.read_newest(
        context.scratch,
        lambda values: decode_state(values, options, initial_paint(options, pool, backgrounds, 0)),
    )
    state, history = found or (initial_paint(options, pool, backgrounds, context.job.seed), [])
    say(
        f"train_paint: continues after step {state.step}"
        if found
        else f"train_paint: a preview will appear at {context.scratch / PREVIEW}"
    )
    warnings += [f"{name} was damaged: trained again from step {state.step}" for name in damaged]
    resumed_at = state.step

    def show(state: PaintState) -> None:
        colours, plain = state.colours.detach().numpy(), np.zeros(4, np.float32)
        latents = np.stack([view.render(colours, plain) for view in pool.views[0]])
        partial = context.scratch / f".{PREVIEW}"
        opacity = np.stack([view.covered for view in pool.views[0]])
        latent_preview(latents, opacity, bundle).save(partial, format="PNG")
        files.publish([(partial, context.scratch / PREVIEW)])

    def keep(state: PaintState, history: History) -> None:
        checkpoint_files.write(context.scratch, state.step, encode_state(state, history))

    where = explained("train_paint", "train_paint", lambda: state.step, context.scratch)
    rows = 2 * options.cameras_per_step
    with (
        denoiser(
            context.inputs["unet"], provider=context.job.provider, rows_expected=rows, views=bundle.views
        ) as denoise,
        where,
    ):
        guidance = diffusion_guidance(denoise, schedule, embeddings, options, conditions_of(bundle))
        train(state, history, options, pool, guidance, keep, show)

    latents, figures = complete(mesh, pool.seen, state.colours.detach().numpy(), texture)
    save_painted(context.outputs["painted"], Painted(latents, texture, options.mesh_radius))
    context.outputs["history"].write_text(json.dumps(history, allow_nan=False) + "\n", encoding="utf-8")
    context.metrics.update(
        **figures,
        steps=options.steps,
        resumed_at=resumed_at,
        resolution=pool.resolution,
        coverage=float(np.mean([row["coverage"] for row in history])),
        gradient_norm=history[-1]["gradient_norm"],
        seconds={
            part: round(sum(row["seconds"][part] for row in history), 3) for part in history[0]["seconds"]
        },
    )


if __name__ == "__main__":
    execute("train_paint", main)
