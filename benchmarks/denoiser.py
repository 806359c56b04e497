"""Cheaper denoisers: run time against the error of eps_cond - eps_uncond, which guidance multiplies.

The ways: int8 with static and dynamic scales, weights of 8 bits, weights of 16 bits, bf16 arithmetic where
onnxruntime has OpenVINO, a run with and one without the text in place of one of both, thread counts, half
the resolution, and leaving the unconditional pass out where noise is strongest. A denoiser that sees
several views of an object together gets as many, each told its camera. MODEL=name chooses another bundle.

Times are medians of runs that alternate with the reference, summed over the noise levels. The error is the
relative Euclidean distance from the reference's difference, over all noise levels together.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from matplotlib.figure import Figure

from benchmarks._cheaper import Told, free_size, quantised
from benchmarks._tables import markdown
from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.diffusion.prompts import view_words
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import denoiser, text_encoder
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.diffusion.view_gradient import told_cameras
from pipeline.options.models import DEFAULT_MODEL, bundle_folder

LEVELS = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Shares of the schedule: little noise to much."""
ROUNDS = 5
"""Runs a way and noise level."""
SKIP_ABOVE = 0.8
PROMPT = "a red armchair"
POLAR, DISTANCE, FOV = 75.0, 2.5, 39.5
"""Of the cameras [deg, scene units]."""
REFERENCE = "fp32, one run"
Run = Callable[..., np.ndarray]
"""A denoiser that may be told cameras as well, as `sessions.denoiser` gives it."""
Difference = Callable[[np.ndarray, int], np.ndarray]
"""Noisy latents (v, c, h, w) and a timestep to eps_cond - eps_uncond."""


def guided(denoise: Run, told: Told) -> Difference:
    """Return the difference from one run on the rows with and without the text."""
    run = told_cameras(denoise, told.cameras)

    def difference(noisy: np.ndarray, timestep: int) -> np.ndarray:
        both = run(np.concatenate([noisy, noisy]), np.full(2 * len(noisy), timestep), told.texts)
        return both[: len(noisy)] - both[len(noisy) :]

    return difference


def one_text(denoise: Run, told: Told, noisy: np.ndarray, timestep: int, which: int) -> np.ndarray:
    """Return what a run on all views gives, with their texts (`which` 0) or without (1)."""
    count = len(noisy)
    texts = told.texts[which * count : (which + 1) * count]
    return denoise(noisy, np.full(count, timestep), texts, told.cameras)


def concurrent(denoise: Run, told: Told, pool: ThreadPoolExecutor) -> Difference:
    """Return the difference from a run with the text and one without, at the same time."""

    def difference(noisy: np.ndarray, timestep: int) -> np.ndarray:
        rows = [pool.submit(one_text, denoise, told, noisy, timestep, which) for which in range(2)]
        return rows[0].result() - rows[1].result()

    return difference


def concurrent_in_turn(denoise: Run, told: Told) -> Difference:
    """Return the difference from a run with the text and one without, one after the other."""

    def difference(noisy: np.ndarray, timestep: int) -> np.ndarray:
        first, second = (one_text(denoise, told, noisy, timestep, which) for which in range(2))
        return first - second

    return difference


def coarse(full: Difference) -> Difference:
    """Return the difference at half the resolution, enlarged."""

    def difference(noisy: np.ndarray, timestep: int) -> np.ndarray:
        b, c, h, w = noisy.shape
        # Twice the mean of four: the noise keeps its variance, as the schedule has it.
        small = noisy.reshape(b, c, h // 2, 2, w // 2, 2).mean((3, 5)) * 2
        return full(small.astype(np.float32), timestep).repeat(2, 2).repeat(2, 3)

    return difference


def without_unconditional(denoise: Run, told: Told, full: Difference, above: int) -> Difference:
    """Return a difference of nothing where noise is strong (one pass, no guidance), else the full one."""

    def difference(noisy: np.ndarray, timestep: int) -> np.ndarray:
        if timestep < above:
            return full(noisy, timestep)
        one_text(denoise, told, noisy, timestep, 0)
        return np.zeros_like(noisy)

    return difference


def camera_rows(bundle: Bundle) -> np.ndarray:
    """Return the camera input (v, k) of the bundle's views, evenly around the object; no backdrop is told."""
    known = {"camera_told": 1.0, "polar": np.radians(POLAR), "distance": DISTANCE, "fov": np.radians(FOV)}
    turns = [2 * np.pi * i / bundle.views for i in range(bundle.views)]
    rows = [[turn if c == "azimuth" else known.get(c, 0.0) for c in bundle.camera] for turn in turns]
    return np.array(rows, np.float32).reshape(bundle.views, len(bundle.camera))


def inputs(folder: Path) -> tuple[Told, list[tuple[np.ndarray, int]]]:
    """Return what is told and noisy latents with timesteps, of pictures that the model predicts."""
    bundle, schedule = open_bundle(folder, verify=False), load_schedule(folder / "scheduler")
    tokenizer = load_tokenizer(folder / "tokenizer")
    turns = [2 * np.pi * i / bundle.views for i in range(bundle.views)]
    prompts = [f"{PROMPT}, {view_words(bundle.view_prompts, turn, np.radians(POLAR))}" for turn in turns]
    with text_encoder(folder / "text_encoder") as encode:
        texts = encode(np.stack([tokenizer.encode(t) for t in (*prompts, *[""] * bundle.views)]))
    told = Told(texts, camera_rows(bundle))
    random = np.random.default_rng(0)
    shape = (bundle.views, bundle.latent_channels, bundle.latent_size, bundle.latent_size)
    total = len(schedule.alphas_cumprod)
    noisy, last = random.standard_normal(shape, np.float32), int(0.98 * total)
    with denoiser(folder / "unet", views=bundle.views) as denoise:
        clean = schedule.to_clean(one_text(denoise, told, noisy, last, 0), noisy, np.full(len(noisy), last))
    cases = []
    for level in LEVELS:
        noise = random.standard_normal(shape, np.float32)
        timestep = int(level * total)
        cases.append((schedule.add_noise(clean, noise, np.full(len(noisy), timestep)), timestep))
    return told, cases


def measure(
    difference: Difference, reference: Difference, cases: list[tuple[np.ndarray, int]]
) -> dict[str, float]:
    """Return seconds, their ratio to the reference's, and the error; runs alternate with the reference's."""
    mine = its = wrong = right = 0.0
    difference(*cases[0])
    # A median a noise level, and the mean of them: a way may be cheaper at some levels alone.
    for noisy, timestep in cases:
        spent: list[tuple[float, float]] = []
        for _ in range(ROUNDS):
            began = time.perf_counter()
            expected = reference(noisy, timestep)
            between = time.perf_counter()
            found = difference(noisy, timestep)
            spent.append((time.perf_counter() - between, between - began))
        mine += statistics.median(row[0] for row in spent) / len(cases)
        its += statistics.median(row[1] for row in spent) / len(cases)
        wrong += float(np.square(found - expected, dtype=np.float64).sum())
        right += float(np.square(expected, dtype=np.float64).sum())
    return {
        "seconds": round(mine, 4),
        "relative_time": round(mine / its, 3),
        "error": round((wrong / right) ** 0.5, 5),
    }


def plot(rows: dict[str, dict[str, float]], path: Path) -> None:
    """Draw relative time (across) against error (up, logarithmic; exact ways stand at 1e-5)."""
    figure = Figure(figsize=(9, 5), layout="constrained")
    axes = figure.subplots()
    axes.set_yscale("log")
    axes.set_ylim(2e-6, 10)
    axes.grid(visible=True, color="#dddddd")
    axes.set_xlabel("time, relative to fp32 in one run")
    axes.set_ylabel("error of eps_cond - eps_uncond (1e-5: none)")
    for name, row in rows.items():
        x, y = row["relative_time"], max(row["error"], 1e-5)
        axes.plot([x], [y], "o", color="#2060a0" if name == REFERENCE else "#b03030")
        # Exact ways share a height: their names stand upright above them.
        turn = 60 if y == 1e-5 else 0
        axes.annotate(name, (x, y), (6, 4), textcoords="offset points", fontsize=8, rotation=turn)
    figure.savefig(path, dpi=100, metadata={"Software": None})


def main(folder: Path) -> dict[str, Any]:
    """Measure every way; draw denoiser.png."""
    bundle = bundle_folder(os.environ.get("MODEL") or DEFAULT_MODEL)
    told, cases = inputs(bundle)
    views = open_bundle(bundle, verify=False).views
    unet, total = bundle / "unet", len(load_schedule(bundle / "scheduler").alphas_cumprod)
    cores = len(os.sched_getaffinity(0))
    rows: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as work, ExitStack() as stack:
        exact = stack.enter_context(denoiser(unet, views=views))
        reference = guided(exact, told)
        rows[REFERENCE] = measure(reference, reference, cases)
        pool = stack.enter_context(ThreadPoolExecutor(2))
        rows["two runs in turn"] = measure(concurrent_in_turn(exact, told), reference, cases)
        with denoiser(unet, threads=max(1, cores // 2), views=views) as single:
            rows["two runs at once"] = measure(concurrent(single, told, pool), reference, cases)
        for threads in sorted({1, cores // 2, 2 * cores} - {0, cores}):
            with denoiser(unet, threads=threads, views=views) as other:
                rows[f"{threads} thread{'s' * (threads > 1)}"] = measure(
                    guided(other, told), reference, cases
                )
        for name, place in quantised(unet, Path(work), told, cases).items():
            with denoiser(place, views=views) as other:
                rows[name] = measure(guided(other, told), reference, cases)
        if "OpenVINOExecutionProvider" in onnxruntime.get_available_providers():
            with denoiser(unet, provider="openvino", views=views) as other:
                rows["OpenVINO"] = measure(guided(other, told), reference, cases)
        if (free := free_size(bundle, Path(work))) is None:
            print(f"half resolution: left out, {unet} is fixed to {cases[0][0].shape[-1]} latents a side")
        else:
            with denoiser(free, views=views) as other:
                rows["half resolution"] = measure(coarse(guided(other, told)), reference, cases)
        skipping = without_unconditional(exact, told, reference, int(SKIP_ABOVE * total))
        rows[f"no unconditional pass above {SKIP_ABOVE:g}"] = measure(skipping, reference, cases)
    plot(rows, folder / "denoiser.png")
    table = markdown(
        ("way", "time", "error"), [(n, row["relative_time"], row["error"]) for n, row in rows.items()]
    )
    (folder / "denoiser.md").write_text(table, encoding="utf-8")
    summary = {name: [row["relative_time"], row["error"]] for name, row in rows.items()}
    return {"summary": summary, "model": bundle.name, "load_at_end": os.getloadavg(), "rows": rows}
