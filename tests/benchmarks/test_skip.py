"""The table of savings: none changes what it leaves, each saves something, on a small size."""

import dataclasses

import numpy as np
import pytest

from benchmarks import skip
from benchmarks._savings import Row, table
from benchmarks._stopping import Pair
from benchmarks._trials import held_out, job_of
from benchmarks._truths import Truth, analytic_scenes
from pipeline.options.asset import Extract
from pipeline.options.job import Job
from pipeline.options.paint import Prepare

SMALL = {
    "samples_per_ray": 24, "grid_levels": 6, "grid_finest": 32, "grid_table_log2": 11, "steps": 24,
    "density_bias": -3.0, "sparsity_weight": 0.1, "opacity_weight": 0.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def truth() -> Truth:
    return next(truth for truth in analytic_scenes() if truth.name == "boxes")


@pytest.fixture(scope="module")
def job() -> Job:
    job = job_of("draft", **SMALL)
    paint = dataclasses.replace(job.train_paint, views=8, texture=24, resolution=8, cameras_per_step=2)
    coarse = Extract(resolution=32, views=4)
    return dataclasses.replace(job, extract=coarse, prepare=Prepare(resolution=64), train_paint=paint)


def test_rendering_skips_what_does_not_show(truth: Truth, job: Job) -> None:
    scene = skip.learned(truth, job, 8)
    outside, empty, hidden = skip.rendering(scene, held_out(job.train_nerf)[:3], 8, 1)
    assert outside.off > outside.on >= empty.on >= hidden.on > 0
    assert outside.on == empty.off
    assert outside.error < 1e-4
    assert empty.error < 0.2
    assert hidden.error < 1e-3


def test_what_comes_after_convergence_is_compared() -> None:
    ends = {"steps": 360, "psnr": 31.9, "seconds": 5.0}, {"steps": 500, "psnr": 31.7, "seconds": 7.0}
    row = skip.after_convergence("boxes", Pair(*([row] for row in ends)))
    assert row.item == "iterations after convergence: boxes, 500 steps"
    assert (row.off, row.on) == (500, 360)
    assert row.error == pytest.approx(-0.2)
    assert row.processor_seconds == (7.0, 5.0)


def test_painting_skips_texels_without_changing_the_others(truth: Truth, job: Job) -> None:
    unseen, unwrapped = skip.texels(truth, job, 8, 1)
    assert unseen.on < unseen.off == 24 * 24
    assert unseen.error < 1e-6
    assert unwrapped.error < 1e-6


def test_the_sketchs_band_is_left_out(truth: Truth) -> None:
    row = skip.sketch_band(truth, 2.0, 20_000, 24, 1)
    assert 0 < row.on < row.off == 20_000
    assert row.error < 1e-2


def test_the_bundles_guidance_and_texts_are_skipped() -> None:
    row = skip.guidance(1)
    assert row.error < 1e-4
    texts = skip.unused_texts(job_of("draft"), 1)
    assert 0 < texts.on <= texts.off
    assert skip.models().on > 0


def test_rows_become_a_table() -> None:
    row = Row("cells", "x", "on", "samples", 200.0, 50.0, 1e-3, "latents", (2.0, 1.0)).figures()
    assert row["saving"] == 0.75
    assert np.isclose(row["error"], 1e-3)
    assert table([row]).splitlines()[2] == (
        "| cells | `x` | on | 200 → 50 samples | 75% | × 0.50 | 0.001 (latents) |"
    )
