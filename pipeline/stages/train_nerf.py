"""Stage `train_nerf`: distil what the denoiser knows of the prompt into a latent scene."""

import json
from collections.abc import Mapping

import numpy as np

from pipeline import arrays
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.conditions import conditions_of
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import denoiser
from pipeline.diffusion.view_gradient import distillation_gradient, flat_backgrounds, load_embeddings
from pipeline.nerf.checkpoint import decode_state, encode_state
from pipeline.nerf.rendering import count_samples, render_views
from pipeline.nerf.scene import load_scene, save_scene
from pipeline.nerf.sketch_loss import unjudged_share
from pipeline.nerf.start import STARTED_COOLING, started_state
from pipeline.nerf.step import State, initial_state
from pipeline.nerf.train import collapse, metrics_of, preview_cameras, train
from pipeline.options.start import started
from pipeline.report.latents import latent_preview
from pipeline.report.png import write_png
from pipeline.run.stage import Context, execute
from pipeline.sketch.lattice import load_sketch
from pipeline.training import checkpoints
from pipeline.training.loop import PREVIEW, History, resume
from pipeline.training.nan_report import explained


def main(context: Context) -> None:
    """Read the embeddings, the denoiser, its schedule, sketch and start; write the scene and its history."""
    inputs, start = context.inputs, context.inputs.get("start")
    options = context.job.train_nerf
    if start is not None:
        options = started(options, context.job.start_fit, context.job.strength)
    cooling = 0.0 if start is None else STARTED_COOLING
    bundle = open_bundle(inputs["unet"].parent, verify=False)
    embeddings = load_embeddings(inputs["embeddings"])
    backgrounds = flat_backgrounds(embeddings)
    schedule = load_schedule(inputs["scheduler"])
    resolution = options.resolution or bundle.latent_size
    sketch = load_sketch(inputs["sketch"]) if "sketch" in inputs else None
    cameras = preview_cameras(options)

    def show(state: State) -> None:
        views = render_views(state.scene, cameras, resolution)
        write_png(context.scratch / PREVIEW, latent_preview(views.latents, views.opacity, bundle))

    def decode(values: Mapping[str, np.ndarray]) -> tuple[State, History]:
        return decode_state(values, options)

    def initial() -> State:
        if start is not None:
            return started_state(load_scene(start), options, backgrounds, context.job.seed)
        return initial_state(options, backgrounds, context.job.seed, sketch)

    if "contest" in inputs and checkpoints.read_newest(context.scratch, decode)[0] is None:
        begun = decode(arrays.unpack(inputs["contest"].read_bytes()))
        checkpoints.write(context.scratch, begun[0].step, encode_state(*begun))
    state, history, resumed_at, warnings = resume(
        "train_nerf",
        context.scratch,
        decode,
        initial,
        show,
    )

    def keep(state: State, history: History) -> None:
        checkpoints.write(context.scratch, state.step, encode_state(state, history))

    rows, provider = 2 * options.cameras_per_step, context.job.provider
    with (
        denoiser(inputs["unet"], provider=provider, rows_expected=rows, views=bundle.views) as denoise,
        explained("train_nerf", "train_nerf", lambda: state.step, context.scratch),
    ):
        view_gradient = distillation_gradient(denoise, schedule, embeddings, options, conditions_of(bundle))
        train(
            state,
            history,
            options,
            resolution,
            view_gradient,
            keep=keep,
            show=show,
            sketch=sketch,
            cooling=cooling,
        )

    save_scene(context.outputs["scene"], state.scene)
    context.outputs["history"].write_text(json.dumps(history, allow_nan=False) + "\n", encoding="utf-8")
    context.metrics.update(
        warnings=[*warnings, *collapse(history)],
        resumed_at=resumed_at,
        resolution=resolution,
        skipped_samples=count_samples(state.scene, cameras, resolution).skipped(),
        skipped_steps=options.steps - state.step,
        **({} if sketch is None else {"unjudged_share": unjudged_share(sketch, options.sigma_s)}),
        **metrics_of(state, history),
    )


if __name__ == "__main__":
    execute("train_nerf", main)
