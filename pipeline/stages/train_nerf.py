"""Stage `train_nerf`: distil what the denoiser knows of the prompt into a latent scene.

Letters: b views a step, h x w latent pixels, v view texts of l tokens of width d, k flat backgrounds.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from PIL import Image

from pipeline import arrays, files
from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.diffusion.distillation import sds_gradient
from pipeline.diffusion.prompts import view_index
from pipeline.diffusion.schedule import Schedule, load_schedule
from pipeline.diffusion.sessions import Denoise, denoiser
from pipeline.errors import InputError
from pipeline.job import TrainNerf
from pipeline.scene import checkpoint, occupancy
from pipeline.scene.cameras import ring
from pipeline.scene.rendering import Views, render_views
from pipeline.scene.scene import Scene, density, save_scene
from pipeline.scene.sketch import Sketch, load_sketch
from pipeline.scene.training import Batch, Figures, Guidance, State, initial_state, training_step
from pipeline.stage import Context, Progress, execute, say

PREVIEW = "preview_training.png"
_PREVIEW_VIEWS = 4
_PREVIEW_ZOOM = 4
_DEFAULT_GREY = 2 / 3
_JUDGED_STEPS = 20
_EMPTY, _FULL = 0.002, 0.98


class Embeddings(NamedTuple):
    """What stage `embed` wrote."""

    cond: Float[np.ndarray, "v l d"]
    uncond: Float[np.ndarray, "l d"]
    view_prompts: str
    backgrounds: Float[np.ndarray, "k 4"] | None
    """Latents of flat colours, a light grey one first; None: the bundle cannot encode any."""


def diffusion_guidance(
    denoise: Denoise, schedule: Schedule, embeddings: Embeddings, clean_clamp: float, signal_power: float
) -> Guidance:
    """Return score distillation from a denoiser, each view told which side of the object it shows."""

    def guidance(latents: Float[np.ndarray, "b 4 h w"], batch: Batch) -> Float[np.ndarray, "b 4 h w"]:
        total = len(schedule.alphas_cumprod)
        timesteps = np.minimum((batch.noise_levels * total).astype(np.int64), total - 1)
        rows = view_index(embeddings.view_prompts, batch.azimuths, batch.polars)
        return sds_gradient(
            latents,
            denoise,
            schedule,
            timesteps,
            batch.noise,
            embeddings.cond[rows],
            embeddings.uncond,
            batch.guidance_scale,
            clean_clamp,
            signal_power,
        ).gradient

    return guidance


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

    `keep` is called every `checkpoint_every` steps, `show` every `preview_every` steps.

    Raises:
        FloatingPointError: a NaN or an infinity, named by tensor and step.
    """
    with Progress("train_nerf", options.steps, "steps") as progress:
        while state.step < options.steps:
            figures = training_step(state, options, resolution, guidance, sketch)
            history.append(_row(state.step, figures))
            progress.update(
                state.step, f"gradient {figures.gradient_norm:.2f}, opacity {figures.opacity:.2f}"
            )
            if state.step % options.checkpoint_every == 0 and state.step < options.steps:
                keep(state, history)
            if state.step % options.preview_every == 0:
                show(state.scene)
    scene = state.scene
    scene.occupancy = occupancy.settle(lambda x: density(scene, x), scene.step, state.rng)


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


def preview(views: Views, bundle: Bundle) -> Image.Image:
    """Return the views side by side in the bundle's linear map (else three channels), over their opacity."""
    rgb = bundle.linear_rgb(views.latents)
    if rgb is None:
        low, high = np.percentile(views.latents[:, :3], (1, 99))
        rgb = (views.latents[:, :3].transpose(0, 2, 3, 1) - low) / max(high - low, 1e-6)
    opacity = np.repeat(views.opacity[..., None], 3, axis=-1)
    rows = [np.concatenate(list(pictures), axis=1) for pictures in (rgb, opacity)]
    picture = (np.concatenate(rows).clip(0, 1) * 255).round().astype(np.uint8)
    image = Image.fromarray(picture)
    return image.resize((image.width * _PREVIEW_ZOOM, image.height * _PREVIEW_ZOOM), Image.Resampling.NEAREST)


def load_embeddings(path: Path) -> Embeddings:
    """Read embeddings.npz.

    Raises:
        InputError: it is damaged.
    """
    try:
        values = arrays.unpack(path.read_bytes())
        backgrounds = values.get("backgrounds")
        if backgrounds is not None:
            nearest = np.abs(values["background_rgb"] - _DEFAULT_GREY).sum(axis=1).argmin()
            backgrounds = np.roll(backgrounds, -nearest, axis=0)
        return Embeddings(values["cond"], values["uncond"], str(values["view_prompts"]), backgrounds)
    except (ValueError, KeyError) as error:
        raise InputError(f"{path} is damaged ({error}): delete it and run again") from None


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
        backgrounds = embeddings.backgrounds
        if backgrounds is None:
            # Standard normal latents: what a denoiser takes for plausible, though of no known colour.
            backgrounds = np.random.default_rng(0).standard_normal((64, 4), np.float32)
            backgrounds[0] = 0
        state = initial_state(options, backgrounds, context.job.seed, sketch)
        say(f"train_nerf: a preview will appear at {context.scratch / PREVIEW}")
    warnings += [f"{name} was damaged: trained again from step {state.step}" for name in damaged]
    resumed_at = state.step

    def show(scene: Scene) -> None:
        cameras = ring(
            _PREVIEW_VIEWS,
            np.deg2rad(75),
            float(np.mean(options.radius)),
            float(np.deg2rad(np.mean(options.fov_degrees))),
        )
        partial = context.scratch / f".{PREVIEW}"
        preview(render_views(scene, cameras, resolution), bundle).save(partial, format="PNG")
        files.publish([(partial, context.scratch / PREVIEW)])

    with denoiser(context.inputs["unet"]) as denoise:
        guidance = diffusion_guidance(
            denoise, schedule, embeddings, options.predicted_clean_clamp, options.signal_power
        )
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
        steps=options.steps,
        resumed_at=resumed_at,
        resolution=resolution,
        opacity=history[-1]["opacity"],
        gradient_norm=history[-1]["gradient_norm"],
        shape_loss=history[-1]["shape"],
        occupied_share=float(state.scene.occupancy.occupied.mean()),
        samples_per_step=float(np.mean([row["samples"] for row in history])),
        seconds={
            part: round(sum(row["seconds"][part] for row in history), 3) for part in history[0]["seconds"]
        },
    )


def _row(step: int, figures: Figures) -> dict[str, Any]:
    seconds = {part: round(value, 5) for part, value in figures.seconds.items()}
    return {"step": step, **figures._asdict(), "seconds": seconds}


if __name__ == "__main__":
    execute("train_nerf", main)
