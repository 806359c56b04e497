"""Stage `refine`: RGB refinement. The trained latent field becomes an RGB field and is trained on.

First it is fitted to what the decoder makes of the latent scene, then it is distilled: the linear layer alone
gives blurred colours, and distillation would spend its steps on what the decoder knows already.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image

from pipeline import files
from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.diffusion.conditions import conditions_of
from pipeline.diffusion.guidance import distil, load_embeddings
from pipeline.diffusion.rgb_guidance import (
    LATENT_TO_RGB,
    Target,
    encoder_guidance,
    enlarge,
    image_guidance,
    picture_guidance,
)
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import Decode, denoiser, vae_decoder, vae_encoder, vae_encoder_vjp
from pipeline.divergence import explained
from pipeline.errors import InputError
from pipeline.job import Job
from pipeline.scene import checkpoint
from pipeline.scene.baking import decibels, decoded_views
from pipeline.scene.batch import Batch, Guidance
from pipeline.scene.cameras import Camera
from pipeline.scene.linear_rgb import LinearRgb
from pipeline.scene.refining import (
    initial_rgb_state,
    plain_compose,
    refinement_options,
    render_rgb,
    rgb_compose,
)
from pipeline.scene.rendering import render_views
from pipeline.scene.scene import Scene, load_scene, save_scene
from pipeline.scene.silhouettes import opacity_masks
from pipeline.scene.sketch import load_sketch
from pipeline.scene.training import Figures, State, training_step
from pipeline.stage import Context, execute, say
from pipeline.stages.train_nerf import PREVIEW, preview_cameras, summary, take_steps

_MOST_PIXELS = 128


def latent_to_rgb(bundle: Bundle) -> LinearRgb:
    """Return the linear layer at the start: the bundle's map, else the paper's (of Stable Diffusion)."""
    matrix = np.array(LATENT_TO_RGB if bundle.latent_to_rgb is None else bundle.latent_to_rgb)
    return LinearRgb(matrix / 2, (np.array(bundle.latent_to_rgb_bias) + 1) / 2)


def view_size(job: Job, bundle: Bundle) -> int:
    """Return the side of a rendered view [pixels]."""
    return job.refinement.resolution or min(max(bundle.image_size // 2, 1), _MOST_PIXELS)


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


@contextmanager
def rgb_guidance(context: Context, bundle: Bundle, decode: Decode) -> Iterator[Guidance]:
    """Give score distillation of pictures by the bundle's networks, in the way that is asked for if the
    bundle can, else in the other, which is said."""
    options, inputs = context.job.refinement, context.inputs
    embeddings, schedule = load_embeddings(inputs["embeddings"]), load_schedule(inputs["scheduler"])
    scale, provider, way = bundle.latent_scale, context.job.provider, options.gradient
    if way == "encoder" and "vae_encoder_vjp" not in inputs:
        way = "image"
        context.metrics["warnings"].append(
            f"{bundle.name} has no vae_encoder_vjp (the encoder's gradient): pictures are refined towards "
            "decoded ones instead; export the bundle again to have it"
        )
    context.metrics["gradient"] = way
    with ExitStack() as stack:
        rows = 2 * options.cameras_per_step
        denoise = stack.enter_context(
            denoiser(inputs["unet"], provider=provider, rows_expected=rows, views=bundle.views)
        )
        encode = stack.enter_context(vae_encoder(inputs["vae_encoder"], scale, provider))

        def step(latents: Float[np.ndarray, "b 4 h w"], batch: Batch) -> Any:
            return distil(latents, batch, denoise, schedule, embeddings, options, conditions_of(bundle))

        if way == "image":
            yield image_guidance(step, encode, decode, bundle.image_size)
        else:
            pull_back = stack.enter_context(vae_encoder_vjp(inputs["vae_encoder_vjp"], scale, provider))
            yield encoder_guidance(step, encode, pull_back, bundle.image_size)


def main(context: Context) -> None:
    job, inputs = context.job, context.inputs
    bundle = open_bundle(inputs["unet"].parent, verify=False)
    if "vae_encoder" not in inputs:
        raise InputError(
            f"MODEL {bundle.name} has no vae_encoder, which RGB refinement needs: export the model with it, "
            "or leave REFINE out"
        )
    options, size = refinement_options(job.train_nerf, job.refinement), view_size(job, bundle)
    latent = load_scene(inputs["scene"])
    sketch = load_sketch(inputs["sketch"]) if "sketch" in inputs else None
    warnings: list[str] = context.metrics.setdefault("warnings", [])
    state, history, damaged = checkpoint.load(context.scratch, options)
    if state is not None:
        say(f"refine: continues after step {state.step}")
    else:
        state = initial_rgb_state(latent, latent_to_rgb(bundle), options, job.seed)
        say(f"refine: a preview will appear at {context.scratch / PREVIEW}")
    warnings += [f"{name} was damaged: trained again from step {state.step}" for name in damaged]
    resumed_at = state.step
    cameras = preview_cameras(options)
    compose = rgb_compose(job.refinement, state.rng)

    def show(scene: Scene) -> None:
        colours, opacity = render_rgb(scene, cameras, size)
        rows = [
            np.concatenate(list(row), axis=1) for row in (colours.transpose(0, 2, 3, 1), opacity[..., None])
        ]
        picture = np.concatenate([rows[0], np.repeat(rows[1], 3, axis=2)]).clip(0, 1)
        partial = context.scratch / f".{PREVIEW}"
        Image.fromarray(np.round(picture * 255).astype(np.uint8)).save(partial, format="PNG")
        files.publish([(partial, context.scratch / PREVIEW)])

    def keep(state: State, history: list[dict[str, Any]]) -> None:
        checkpoint.save(context.scratch, state, history)

    with (
        vae_decoder(inputs["vae_decoder"], bundle.latent_scale, job.provider) as decode,
        rgb_guidance(context, bundle, decode) as guidance,
        explained("refine", "refinement", lambda: state.step, context.scratch),
    ):
        fit = picture_guidance(decoded_target(latent, decode, bundle.latent_size, size))

        def step(state: State) -> Figures:
            fitting = state.step < job.refinement.fit_steps
            way, seen_as = (fit, plain_compose) if fitting else (guidance, compose)
            return training_step(state, options, size, way, sketch, seen_as, bundle.latent_size)

        start = initial_rgb_state(latent, latent_to_rgb(bundle), options, job.seed).scene
        psnr = {"start_psnr": likeness(start, latent, cameras, bundle, decode, size)}
        take_steps("refine", state, history, options, step, keep, show)
        psnr["end_psnr"] = likeness(state.scene, latent, cameras, bundle, decode, size)

    save_scene(context.outputs["scene"], state.scene)
    context.outputs["history"].write_text(json.dumps(history, allow_nan=False) + "\n", encoding="utf-8")
    context.metrics.update(resumed_at=resumed_at, resolution=size, **psnr, **summary(state, history))


if __name__ == "__main__":
    execute("refine", main)
