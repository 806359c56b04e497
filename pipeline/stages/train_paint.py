"""Stage `train_paint`: distil what the denoiser knows of the prompt into the colours of a given mesh."""

from __future__ import annotations

import json

import numpy as np

from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.conditions import conditions_of
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import denoiser
from pipeline.diffusion.view_gradient import distillation_gradient, flat_backgrounds, load_embeddings
from pipeline.options.start import set_out
from pipeline.paint.checkpoint import decode_state, encode_state
from pipeline.paint.given_mesh import load_paint_mesh
from pipeline.paint.step import PaintState, initial_paint, make_pool, shown_views
from pipeline.paint.surface_latents import Painted, complete, load_painted, save_painted
from pipeline.paint.train import train
from pipeline.report.latents import latent_preview
from pipeline.report.png import write_png
from pipeline.run.stage import Context, execute
from pipeline.training import checkpoints
from pipeline.training.loop import PREVIEW, History, resume, seconds_of
from pipeline.training.nan_report import explained


def main(context: Context) -> None:
    """Read the mesh, the embeddings, the denoiser and its schedule; write the latents and their history."""
    inputs, seed, start = context.inputs, context.job.seed, context.inputs.get("start")
    options = context.job.train_paint
    if start is not None:
        options = set_out(options, context.job.strength)
    bundle = open_bundle(inputs["unet"].parent, verify=False)
    embeddings = load_embeddings(inputs["embeddings"])
    backgrounds = flat_backgrounds(embeddings)
    schedule = load_schedule(inputs["scheduler"])
    mesh = load_paint_mesh(inputs["mesh"]).scaled(options.mesh_radius)
    texture = options.texture if context.job.param == "texture" else None
    pool = make_pool(mesh, options, texture, options.resolution or bundle.latent_size, seed)

    shown = shown_views(pool)

    def initial() -> PaintState:
        latents = None if start is None else load_painted(start).latents[pool.seen]
        return initial_paint(options, pool, backgrounds, seed, latents)

    def show(state: PaintState) -> None:
        colours, plain = state.colours.detach().numpy(), np.zeros(4, np.float32)
        latents = np.stack([view.render(colours, plain) for view in shown])
        opacity = np.stack([view.covered for view in shown])
        write_png(context.scratch / PREVIEW, latent_preview(latents, opacity, bundle))

    state, history, resumed_at, warnings = resume(
        "train_paint",
        context.scratch,
        lambda values: decode_state(values, options, initial_paint(options, pool, backgrounds, 0)),
        initial,
        show,
    )

    def keep(state: PaintState, history: History) -> None:
        checkpoints.write(context.scratch, state.step, encode_state(state, history))

    rows, provider = 2 * options.cameras_per_step, context.job.provider
    with (
        denoiser(inputs["unet"], provider=provider, rows_expected=rows, views=bundle.views) as denoise,
        explained("train_paint", "train_paint", lambda: state.step, context.scratch),
    ):
        view_gradient = distillation_gradient(denoise, schedule, embeddings, options, conditions_of(bundle))
        train(state, history, options, pool, view_gradient, keep=keep, show=show)

    latents, metrics = complete(mesh, pool.seen, state.colours.detach().numpy(), texture)
    save_painted(context.outputs["painted"], Painted(latents, texture, options.mesh_radius))
    context.outputs["history"].write_text(json.dumps(history, allow_nan=False) + "\n", encoding="utf-8")
    context.metrics.update(
        **metrics,
        warnings=warnings,
        steps=options.steps,
        resumed_at=resumed_at,
        resolution=pool.resolution,
        coverage=float(np.mean([row["coverage"] for row in history])),
        gradient_norm=history[-1]["gradient_norm"],
        seconds=seconds_of(history),
    )


if __name__ == "__main__":
    execute("train_paint", main)
