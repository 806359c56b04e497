"""One trial of a training on a known scene: text or paint, from the ideal denoiser to its errors.

What the figures are is said in `oracle`. Letters: h x w latent pixels.
"""

import dataclasses
import functools
import hashlib
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks._ideal import Calls, ideal_guidance
from benchmarks._pool import at_once
from benchmarks._truths import (
    MODELS,
    Truth,
    analytic_scenes,
    catalogue_scenes,
    surface_error,
    to_latents,
    visible_surface,
)
from pipeline.cameras import Camera, sphere
from pipeline.mesh.coordinates import make_coordinates
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.silhouettes import comparison_cameras
from pipeline.nerf import train as nerf_train
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import Scene, density
from pipeline.nerf.step import State, initial_state
from pipeline.options.job import Job, resolve
from pipeline.options.nerf import TrainNerf
from pipeline.options.paint import TrainPaint
from pipeline.options.schema import plain
from pipeline.paint import train as paint_train
from pipeline.paint.step import initial_paint, make_pool
from pipeline.paint.surface_latents import complete
from pipeline.paint.view_weights import view_weights
from pipeline.run import staleness
from pipeline.stages.extract import SILHOUETTE_SIZE, choose_surface, sample_logarithm
from pipeline.training.flat_colours import flat_colours

PEAK = 2.0
HELD_OUT = 12
RESOLUTION = 32
"""Side of a view, as the default bundle has it [latent pixels]."""


def backgrounds() -> np.ndarray:
    """Return the latents of the flat backgrounds, (64, 4), a light grey one first."""
    colours = flat_colours()
    return np.roll(to_latents(colours), -int(np.abs(colours - 2 / 3).sum(1).argmin()), axis=0)


def held_out(options: TrainNerf | TrainPaint) -> list[Camera]:
    """Return cameras that training draws with probability 0, of the kind that it draws."""
    polar = np.radians(options.polar_degrees)
    fov = float(np.radians(np.mean(options.fov_degrees)))
    return sphere(HELD_OUT, float(np.mean(options.radius)), fov, (float(polar[0]), float(polar[1])))


def decibels(error: np.ndarray) -> float:
    """Return the PSNR of differences of latents [dB]."""
    return float(10 * np.log10(PEAK**2 / max(float(np.square(error, dtype=np.float64).mean()), 1e-12)))


def views_psnr(scene: Scene, truth: Truth, cameras: Sequence[Camera], size: int) -> float:
    """Return the PSNR of a scene's views."""
    flat = backgrounds()[0]
    shown = render_views(scene, cameras, size, flat).latents
    return decibels(shown - np.stack([truth.draw(camera, size, flat) for camera in cameras]))


def shape_error(scene: Scene, truth: Truth, job: Job) -> dict[str, float]:
    """Return how far the extracted surface is from the true one."""
    views = comparison_cameras(job.extract.views)
    opacity = render_views(scene, views, SILHOUETTE_SIZE, np.zeros(4, np.float32)).opacity
    samples = sample_logarithm(
        lambda points: density(scene, points), scene.occupancy.occupied, job.extract.resolution
    )
    mesh, figures = choose_surface(samples, opacity, views, job.extract.smoothing)
    chamfer, normals = surface_error(visible_surface(mesh), visible_surface(truth.mesh))
    return {
        "chamfer": round(chamfer, 5),
        "normal_error": round(normals, 2),
        "silhouette_iou": round(figures["silhouette_iou"], 4),
    }


def learn(truth: Truth, job: Job, traced: int = 0, resolution: int = RESOLUTION) -> list[dict[str, Any]]:
    """Train a field; return a row every `traced` steps (0: none) and one for the end."""
    options = dataclasses.replace(
        job.train_nerf, preview_every=traced or job.train_nerf.steps, checkpoint_every=100_000
    )
    cameras, calls, rows = held_out(options), Calls(), list[dict[str, Any]]()
    guidance = ideal_guidance(
        truth.draw,
        signal_power=options.signal_power,
        clean_clamp=options.predicted_clean_clamp,
        calls=calls,
    )
    state = initial_state(options, backgrounds(), job.seed)
    size = options.resolution or resolution
    watching = 0.0
    began = time.process_time()

    def row() -> dict[str, Any]:
        return {
            "steps": state.step,
            "calls": calls.runs,
            "views": calls.views,
            "seconds": round(time.process_time() - began - calls.seconds - watching, 2),
            "psnr": round(views_psnr(state.scene, truth, cameras, resolution), 3),
        }

    def show(state: State) -> None:
        nonlocal watching
        if state.step < options.steps:
            looked = time.process_time()
            rows.append(row())
            watching += time.process_time() - looked

    nerf_train.train(state, [], options, size, guidance, show=show)
    return [*rows, {**row(), **shape_error(state.scene, truth, job)}]


def coloured(truth: Truth, job: Job, resolution: int = RESOLUTION) -> dict[str, Any]:
    """Paint a scene's mesh; return the figures."""
    options, calls = job.train_paint, Calls()
    atlas = job.prepare.resolution
    mesh = make_coordinates(Mesh(truth.mesh.vertices, truth.mesh.faces), atlas, atlas // 64, rewrap=True)[0]
    guidance = ideal_guidance(
        truth.draw,
        signal_power=options.signal_power,
        clean_clamp=options.predicted_clean_clamp,
        calls=calls,
    )
    began = time.process_time()
    pool = make_pool(mesh, options, options.texture, resolution, job.seed)
    state = initial_paint(options, pool, backgrounds(), job.seed)
    paint_train.train(state, [], options, pool, guidance)
    seconds = time.process_time() - began - calls.seconds
    latents, _ = complete(mesh, pool.seen, state.colours.detach().numpy(), options.texture)
    flat = backgrounds()[0]
    errors = []
    for camera in held_out(options):
        view = view_weights(mesh, camera, resolution, options.texture, options.supersampling)
        difference = view.render(latents, flat) - truth.draw(camera, resolution, flat)
        errors.append(difference[:, view.covered > 0.5].ravel())
    return {
        "steps": options.steps,
        "calls": calls.runs,
        "views": calls.views,
        "seconds": round(seconds, 2),
        "psnr": round(decibels(np.concatenate(errors)), 3),
    }


def job_of(quality: str, **changed: Any) -> Job:
    """Return the job of a quality with the default bundle, with other options of train_nerf."""
    job = resolve({"PROMPT": "oracle", "QUALITY": quality})
    return dataclasses.replace(job, train_nerf=dataclasses.replace(job.train_nerf, **changed))


class Trial(NamedTuple):
    """What `kept` is asked, as it can be sent to another process."""

    name: str
    truth: str
    job: Job
    traced: int = 0
    resolution: int = RESOLUTION


def kept(name: str, truth: Truth, job: Job, traced: int, cache: Path, resolution: int) -> Any:
    """Return the result of a trial, from the cache if it was made by the same source."""
    path = _place(Trial(name, truth.name, job, traced, resolution), cache)
    if path.is_file():
        return json.loads(path.read_text(encoding="utf-8"))
    result = coloured(truth, job, resolution) if name == "paint" else learn(truth, job, traced, resolution)
    cache.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(result) + "\n", encoding="utf-8")
    partial.replace(path)
    return result


def fill(trials: Sequence[Trial], cache: Path) -> None:
    """Run the trials that the cache lacks, several at once."""
    missing = [trial for trial in trials if not _place(trial, cache).is_file()]
    at_once(_fill_one, [(trial, cache) for trial in missing], "trials on known scenes")


def _fill_one(trial: Trial, cache: Path) -> None:
    kept(trial.name, _truths()[trial.truth], trial.job, trial.traced, cache, trial.resolution)


@functools.cache
def _truths() -> dict[str, Truth]:
    return {truth.name: truth for truth in (*analytic_scenes(), *catalogue_scenes(list(MODELS)))}


def _place(trial: Trial, cache: Path) -> Path:
    """Return the file of a trial's result, named after everything that it depends on."""
    stages = ("train_paint", "prepare") if trial.name == "paint" else ("train_nerf", "extract")
    source = [staleness.code(f"pipeline.stages.{stage}")[0] for stage in stages]
    own = [
        Path(__file__).with_name(f"_{name}.py").read_bytes().hex() for name in ("ideal", "truths", "trials")
    ]
    asked = [trial.name, trial.truth, plain(trial.job), trial.traced, trial.resolution, source, own]
    digest = hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()[:16]
    return cache / f"{trial.truth.replace(' ', '-')}-{digest}.json"
