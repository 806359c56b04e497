"""What a stage will cost, before it runs: seconds and peak memory.

Each figure is a constant plus the work that the options ask for times a rate, fitted to runs of the default
bundle on two Zen 5 cores and on two threads of a Zen 3 core. Other machines: their pace tells.
"""

import time
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from pipeline.options.distillation import Distillation
from pipeline.options.job import Job

START = 1.0
"""Python, its libraries and, at first, compiled kernels [seconds a stage]."""
BASE_MB = 450.0
"""Python with torch [MiB]."""
PRODUCT_SIDE = 512
"""Side of the matrices whose product tells a machine's pace."""
REFERENCE_GFLOPS = 300.0
"""What the constants are of: chosen so that the denoiser's time is right on two threads of a Zen 3 core."""

HELD = {
    "embed": ("text_encoder", "vae_encoder"),
    "train_nerf": ("unet",),
    "train_paint": ("unet",),
    "bake": ("vae_decoder",),
    "bake_paint": ("vae_decoder",),
}
"""The networks that a stage opens, one after the other."""
_REFINING = ("unet", "vae_encoder", "vae_encoder_vjp", "vae_decoder")
HELD_TOGETHER = {"refine": _REFINING, "refine_paint": _REFINING}
"""And those that it opens at once."""


class Cost(NamedTuple):
    seconds: float
    memory_mb: float


def machine_pace() -> float:
    """Return how fast this machine multiplies matrices, relative to the one that the constants are of: the
    best of some products, in hundredths of a second."""
    matrix = np.ones((PRODUCT_SIDE, PRODUCT_SIDE), np.float32)
    best = np.inf
    for _ in range(6):
        began = time.perf_counter()
        matrix @ matrix
        best = min(best, time.perf_counter() - began)
    return 2 * PRODUCT_SIDE**3 / best / 1e9 / REFERENCE_GFLOPS


def estimate(stage: str, job: Job, latent_size: int, weights: Mapping[str, float], pace: float = 1.0) -> Cost:
    """Return what a stage costs; `weights`: megabytes of each graph's files: memory, and the UNet's work.

    The denoiser is matrix products and takes 1 / `pace` of the constants' time; the rest, which waits for
    memory and for one thread, its square root (twice the time where products take 3.6 times).
    """
    # Everything is divided by the root below.
    denoiser_megabytes = weights.get("unet", 0.0) / pace**0.5
    train, views = job.train_nerf, job.bake.view_resolution or max(latent_size, 64)
    side = train.resolution or latent_size
    samples = train.cameras_per_step * side**2 * train.samples_per_ray
    denoiser = _denoiser_work(train, denoiser_megabytes, latent_size)
    refine = job.refinement
    refine_side = refine.resolution or min(2 * latent_size, 128)  # half of an image of four pixels a latent
    refine_samples = refine.cameras_per_step * refine_side**2 * train.samples_per_ray
    # The encoder and its gradient, or the decoder: as much as decoding, twice.
    pictures = refine.cameras_per_step * 1.8e-5 * 2 * latent_size**2
    refine_step = 8.4e-8 * refine_samples + 1.26e-4 * _denoiser_work(refine, denoiser_megabytes, latent_size)
    fit_step = 1.2e-7 * refine_samples
    paint, paint_views = job.train_paint, job.bake_paint.views
    paint_side = paint.resolution or latent_size
    paint_denoiser = _denoiser_work(paint, denoiser_megabytes, latent_size)
    paint_size = job.bake_paint.view_resolution or max(latent_size, 64)
    texels, paint_texels, faces = job.bake.texture**2, job.bake_paint.texture**2, job.clean.faces
    cells = job.extract.resolution**3
    frames = job.publish.turntable_frames * job.publish.turntable_size**2
    costs = {
        "embed": Cost(0.2, 0.0),
        "sketch": Cost(0.3 + 6e-6 * job.sketch_field.cells**3, 1e-4 * job.sketch_field.cells**3),
        "train_nerf": Cost(
            train.steps * (train.updates_per_call * (0.02 + 6e-8 * samples) + 1.5e-4 * denoiser),
            150 + 4e-4 * samples,
        ),
        "refine": Cost(
            refine.steps * (refine_step + pictures) + refine.fit_steps * (fit_step + pictures),
            150 + 4e-4 * refine_samples,
        ),
        "extract": Cost(6e-7 * cells + 0.02 * job.extract.views, 50 + 2e-5 * cells),
        "clean": Cost(0.7 + 7.5e-5 * faces, 0.0),
        "unwrap": Cost(0.4 + 1.9e-6 * faces**1.5, 4e-3 * faces),
        "bake": Cost(job.bake.views * (1.8e-5 * views**2 + 3e-8 * texels), 50 + 1e-4 * texels),
        "publish": Cost(0.8 + 2e-7 * frames, 0.0),
        "prepare": Cost(3.0, 50.0),
        "train_paint": Cost(
            0.5 + 2e-4 * paint.views * paint_side + paint.steps * (0.002 + 1.26e-4 * paint_denoiser),
            150 + 3e-4 * paint.views * paint_side**2,
        ),
        "bake_paint": Cost(
            paint_views * (1.8e-5 * paint_size**2 + 3e-8 * paint_texels), 50 + 1e-4 * paint_texels
        ),
        "refine_paint": Cost(
            0.5 + 2e-4 * paint.views * refine_side + refine.steps * (refine_step + pictures),
            150 + 3e-4 * paint.views * refine_side**2,
        ),
        "publish_paint": Cost(0.8 + 2e-7 * frames, 0.0),
        "report": Cost(0.3, 0.0),
    }
    cost = costs[stage]
    # A network is in memory twice: the file, and what onnxruntime makes of it (of weights stored as fp16,
    # their fp32 values: twice the file without it).
    held = max((weights.get(name, 0.0) for name in HELD.get(stage, ())), default=0.0)
    held += sum(weights.get(name, 0.0) for name in HELD_TOGETHER.get(stage, ()))
    return Cost((START + cost.seconds) / pace**0.5, BASE_MB + cost.memory_mb + 2 * held)


def _denoiser_work(options: Distillation, megabytes: float, latent_size: int) -> float:
    """Return the work of the denoiser in one step: megabytes of weights times passes times relative area."""
    passes = 1 if options.guidance_scale == options.guidance_scale_end == 1 else 3 if options.perp_neg else 2
    return options.cameras_per_step * passes * megabytes * (latent_size / 32) ** 2


def available_memory_mb() -> float | None:
    """Return the memory that programs can still take [MiB], or None where the system does not say."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            figures = dict(line.split(":", 1) for line in lines)
        return int(figures["MemAvailable"].split()[0]) / 1024
    except (OSError, KeyError, ValueError, IndexError):
        return None
