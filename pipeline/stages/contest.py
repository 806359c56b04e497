"""Stage `contest`: several seeds begin their training; the one whose scene agrees best with the text goes on.

What goes on is the state after these steps, so the asset is that which its seed alone would have made.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from pipeline import arrays
from pipeline.cameras import Camera, sphere
from pipeline.diffusion.agreement import Agreement, agreement
from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.diffusion.conditions import conditions_of
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import denoiser
from pipeline.diffusion.view_gradient import distillation_gradient, flat_backgrounds, load_embeddings
from pipeline.nerf.checkpoint import decode_state, encode_state
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import Scene
from pipeline.nerf.step import State, initial_state
from pipeline.nerf.train import preview_cameras, train
from pipeline.options.nerf import TrainNerf
from pipeline.progress import say
from pipeline.report.latents import latent_preview
from pipeline.report.png import write_png
from pipeline.run.stage import Context, execute
from pipeline.sketch.lattice import load_sketch
from pipeline.training import checkpoints
from pipeline.training.batch import Batch
from pipeline.training.loop import PREVIEW, History, resume
from pipeline.training.nan_report import explained


def judged_batch(options: TrainNerf, count: int, background: Float[np.ndarray, " 4"]) -> Batch:
    """Return views all around, of the kind that training draws, without noise."""
    polar, fov = np.radians(options.polar_degrees), float(np.radians(np.mean(options.fov_degrees)))
    cameras = sphere(count, float(np.mean(options.radius)), fov, (float(polar[0]), float(polar[1])))
    backward = np.stack([camera.pose[:3, 2] for camera in cameras])
    azimuths, polars = np.arctan2(backward[:, 0], backward[:, 2]), np.arccos(backward[:, 1])
    order = np.argsort(azimuths)
    flat = np.repeat(background[None], count, axis=0)
    zeros = np.zeros((count, 4, 1, 1), np.float32)
    chosen = [cameras[i] for i in order]
    return Batch(chosen, azimuths[order], polars[order], flat, np.zeros(count), zeros, 1.0, 0.0)


def views_sheet(
    scenes: list[Scene], cameras: list[Camera], size: int, bundle: Bundle
) -> Float[np.ndarray, "h w 3"]:
    """Return a row of views in colour for each scene."""
    rows = []
    for scene in scenes:
        views = render_views(scene, cameras, size)
        picture = np.asarray(latent_preview(views.latents, views.opacity, bundle), np.float32) / 255
        rows.append(picture[: len(picture) // 2])
    return np.concatenate(rows)


def main(context: Context) -> None:
    """Read what `train_nerf` reads; write the state of the best seed, and a sheet of all."""
    job, inputs, options = context.job, context.inputs, context.job.train_nerf
    bundle = open_bundle(inputs["unet"].parent, verify=False)
    embeddings, schedule = load_embeddings(inputs["embeddings"]), load_schedule(inputs["scheduler"])
    resolution = options.resolution or bundle.latent_size
    sketch = load_sketch(inputs["sketch"]) if "sketch" in inputs else None
    backgrounds, cameras = flat_backgrounds(embeddings), preview_cameras(options)
    until = max(1, round(job.contest.share * options.steps))
    batch = judged_batch(options, job.contest.views, backgrounds[0])
    conditions = conditions_of(bundle)

    def show(state: State) -> None:
        views = render_views(state.scene, cameras, resolution)
        write_png(context.scratch / PREVIEW, latent_preview(views.latents, views.opacity, bundle))

    states: dict[int, tuple[State, History]] = {}
    scores: dict[int, Agreement] = {}
    warnings: list[str] = []
    rows, provider = 2 * options.cameras_per_step, job.provider
    with denoiser(inputs["unet"], provider=provider, rows_expected=rows, views=bundle.views) as denoise:
        view_gradient = distillation_gradient(denoise, schedule, embeddings, options, conditions)

        def begin(seed: int, folder: Path) -> tuple[State, History]:
            def keep(state: State, history: History) -> None:
                checkpoints.write(folder, state.step, encode_state(state, history))

            name = f"contest, seed {seed}"
            state, history, _, damaged = resume(
                name,
                folder,
                lambda values: decode_state(values, options),
                lambda: initial_state(options, backgrounds, seed, sketch),
                show,
            )
            warnings.extend(damaged)
            named: dict[str, Any] = {"keep": keep, "show": show, "sketch": sketch}
            with explained("contest", "train_nerf", lambda: state.step, folder):
                train(state, history, options, resolution, view_gradient, until=until, stage=name, **named)
            keep(state, history)
            return state, history

        for place in range(job.seeds):
            seed = (job.seed + place) % 2**32
            folder = context.scratch / str(seed)
            folder.mkdir(exist_ok=True)
            states[seed] = begin(seed, folder)
            scene = states[seed][0].scene
            latents = render_views(scene, batch.cameras, resolution, backgrounds[0]).latents
            scores[seed] = agreement(latents, batch, denoise, schedule, embeddings, options, conditions)
            say(f"contest: seed {seed} scores {scores[seed].score:.3f}")
    best = max(scores, key=lambda seed: scores[seed].score)
    state, history = states[best]
    # Their seconds were spent here, and would make other bytes of the same state.
    history = [{**row, "seconds": dict.fromkeys(row["seconds"], 0.0)} for row in history]
    context.outputs["state"].write_bytes(arrays.pack(encode_state(state, history)))
    scenes = [state.scene for state, _ in states.values()]
    write_png(context.outputs["sheet"], views_sheet(scenes, cameras, resolution, bundle))
    context.metrics.update(
        warnings=warnings,
        steps=until * (job.seeds - 1),  # those of the chosen one are counted where it goes on
        chosen_seed=best,
        scores={str(seed): one._asdict() for seed, one in scores.items()},
    )


if __name__ == "__main__":
    execute("contest", main)
