"""Stage `refine`: RGB refinement. The trained latent field becomes an RGB field and is trained on.

First it is fitted to what the decoder makes of the latent scene, then it is distilled: the linear layer alone
gives blurred colours, and distillation would spend its steps on what the decoder knows already.
"""

from __future__ import annotations

import json

import numpy as np
from jaxtyping import Float

from pipeline.cameras import Camera
from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.diffusion.refinement import (
    picture_distillation,
    possible_gradient,
    require_encoder,
    view_size,
)
from pipeline.diffusion.rgb_gradients import LATENT_TO_RGB, Target, enlarge, picture_gradient
from pipeline.diffusion.sessions import Decode, vae_decoder
from pipeline.mesh.baking import decibels
from pipeline.mesh.silhouettes import opacity_masks
from pipeline.nerf.checkpoint import decode_state, encode_state
from pipeline.nerf.linear_rgb import LinearRgb
from pipeline.nerf.refining import (
    initial_rgb_state,
    plain_compose,
    refinement_options,
    render_rgb,
    rgb_compose,
)
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import Scene, load_scene, save_scene
from pipeline.nerf.step import NerfMetrics, State, training_step
from pipeline.nerf.train import finish, metrics_of, preview_cameras
from pipeline.nerf.views import decoded_views
from pipeline.report.png import write_png
from pipeline.run.stage import Context, execute
from pipeline.sketch.lattice import load_sketch
from pipeline.training import checkpoints
from pipeline.training.batch import Batch
from pipeline.training.loop import PREVIEW, History, resume
from pipeline.training.nan_report import explained


def latent_to_rgb(bundle: Bundle) -> LinearRgb:
    """Return the linear layer at the start: the bundle's map, else the paper's (of Stable Diffusion)."""
    matrix = np.array(LATENT_TO_RGB if bundle.latent_to_rgb is None else bundle.latent_to_rgb)
    return LinearRgb(matrix / 2, (np.array(bundle.latent_to_rgb_bias) + 1) / 2)


def decoded_target(scene: Scene, decode: Decode, latent_size: int, size: int) -> Target:
    """Return what the decoder makes of a latent scene, in views of `size` x `size` pixels."""

    def target(batch: Batch) -> tuple[Float[np.ndarray, "b 3 h w"], Float[np.ndarray, "b h w"]]:
        pictures = np.stack(decoded_views(scene, batch.cameras, latent_size, decode)).transpose(0, 3, 1, 2)
        shown, _ = enlarge(np.ascontiguousarray(pictures), size)
        return shown, render_views(scene, batch.cameras, size, np.zeros(4, np.float32)).opacity

    return target


def likeness(
    scene: Scene, latent: Scene, cameras: list[Camera], bundle: Bundle, decode: Decode, size: int
) -> float:
    """Return the PSNR [dB] of an RGB scene's views against the decoded views of the latent scene, on the
    object as the latent scene has it."""
    wanted = decoded_views(latent, cameras, bundle.latent_size, decode)
    target, _ = enlarge(np.ascontiguousarray(np.stack(wanted).transpose(0, 3, 1, 2)), size)
    opacity = render_views(latent, cameras, size, np.zeros(4, np.float32)).opacity
    colours, own = render_rgb(scene, cameras, size)
    mask, _ = opacity_masks(opacity)
    solid = (colours / np.maximum(own, 0.05)[:, None]).clip(0, 1)
    squared = np.square(solid - target).mean(1)[mask]
    return decibels(float(squared.mean())) if squared.size else 0.0


def rgb_preview(scene: Scene, cameras: list[Camera], size: int) -> Float[np.ndarray, "h w 3"]:
    """Return views of an RGB scene side by side, over their opacity."""
    colours, opacity = render_rgb(scene, cameras, size)
    masks = np.repeat(opacity[:, None], 3, axis=1)
    rows = [np.concatenate(list(row.transpose(0, 2, 3, 1)), axis=1) for row in (colours, masks)]
    return np.concatenate(rows)


def main(context: Context) -> None:
    """Read the latent scene, what `train_nerf` reads, the autoencoder; write the RGB scene, its history."""
    job, inputs = context.job, context.inputs
    bundle = open_bundle(inputs["unet"].parent, verify=False)
    require_encoder(bundle, inputs)
    refinement = job.refinement
    options, size = refinement_options(job.train_nerf, refinement), view_size(refinement, bundle)
    latent = load_scene(inputs["scene"])
    sketch = load_sketch(inputs["sketch"]) if "sketch" in inputs else None
    cameras = preview_cameras(options)

    def initial() -> State:
        return initial_rgb_state(latent, latent_to_rgb(bundle), options, job.seed)

    def show(state: State) -> None:
        write_png(context.scratch / PREVIEW, rgb_preview(state.scene, cameras, size))

    state, history, resumed_at, warnings = resume(
        "refine", context.scratch, lambda values: decode_state(values, options), initial, show
    )
    gradient, more = possible_gradient(refinement, bundle, inputs)
    compose = rgb_compose(refinement, state.rng)

    def keep(state: State, history: History) -> None:
        checkpoints.write(context.scratch, state.step, encode_state(state, history))

    with (
        vae_decoder(inputs["vae_decoder"], bundle.latent_scale, job.provider) as decode,
        picture_distillation(refinement, gradient, bundle, inputs, decode, job.provider) as distillation,
        explained("refine", "refinement", lambda: state.step, context.scratch),
    ):
        fit = picture_gradient(decoded_target(latent, decode, bundle.latent_size, size))

        def step(state: State) -> NerfMetrics:
            fitting = state.step < refinement.fit_steps
            way, seen_as = (fit, plain_compose) if fitting else (distillation, compose)
            return training_step(
                state, options, size, way, sketch=sketch, compose=seen_as, noise_size=bundle.latent_size
            )

        psnr = {"start_psnr": likeness(initial().scene, latent, cameras, bundle, decode, size)}
        finish("refine", state, history, options, step, keep, show)
        psnr["end_psnr"] = likeness(state.scene, latent, cameras, bundle, decode, size)

    save_scene(context.outputs["scene"], state.scene)
    context.outputs["history"].write_text(json.dumps(history, allow_nan=False) + "\n", encoding="utf-8")
    context.metrics.update(
        warnings=[*warnings, *more],
        gradient=gradient,
        resumed_at=resumed_at,
        resolution=size,
        **psnr,
        **metrics_of(state, history),
    )


if __name__ == "__main__":
    execute("refine", main)
