"""Runs that end early are compared with the same runs to their last step, and with nothing else."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from benchmarks import _stopping
from benchmarks._stopping import Pair, Stopping, compared, early_ends, long_runs, pairs, worst
from benchmarks._trials import job_of
from benchmarks._truths import Truth, analytic_scenes
from pipeline.nerf.convergence import first_decision
from pipeline.options.asset import Extract


@pytest.fixture(scope="module")
def boxes() -> Truth:
    return next(truth for truth in analytic_scenes() if truth.name == "boxes")


def run_of(truth: Truth, steps: int, convergence: float) -> Stopping:
    job = job_of(
        "draft", steps=steps, convergence=convergence, cameras_per_step=1, updates_per_call=1, resolution=8,
        samples_per_ray=24, grid_levels=6, grid_finest=32, grid_table_log2=11, density_bias=-3.0,
        sparsity_weight=0.1, opacity_weight=0.0, emptiness_weight=1.0,
    )  # fmt: skip
    return Stopping(str(steps), truth, dataclasses.replace(job, extract=Extract(resolution=32, views=4)))


def ended(steps: int, psnr: float, chamfer: float, normals: float) -> list[dict[str, Any]]:
    return [{"steps": steps, "psnr": psnr, "chamfer": chamfer, "normal_error": normals}]


def test_errors_are_compared_with_the_final_ones(boxes: Truth) -> None:
    run = Stopping("100", boxes, job_of("high"))
    early = compared(run, Pair(ended(60, 20.0, 0.011, 4.0), ended(100, 20.1, 0.01, 5.0)))
    late = compared(run, Pair(ended(100, 30.0, 0.01, 5.0), ended(100, 30.0, 0.01, 5.0)))
    assert (early["run"], early["scene"], early["steps"], early["of"]) == ("100", "boxes", 60, 100)
    assert early["error_ratio"] == pytest.approx(10 ** (0.1 / 20), abs=1e-4)
    assert (early["chamfer_ratio"], early["normal_error_ratio"]) == (1.1, 0.8)
    assert (late["error_ratio"], late["chamfer_ratio"], late["normal_error_ratio"]) == (1, 1, 1)
    assert worst([early, late]) == {
        "ended_early": 1,
        "steps_saved": 0.2,
        "worst_error_ratio": early["error_ratio"],
        "worst_chamfer_ratio": 1.1,
        "worst_normal_error_ratio": 0.8,  # a run to its last step does not hide how others ended
    }
    assert worst([late])["worst_chamfer_ratio"] == 1
    assert "| boxes, 100 steps | 60 | 1.012 | 1.1 | 0.8 |" in early_ends([early, late])


@pytest.mark.thorough
def test_a_run_that_ends_early_is_run_to_its_last_step_as_well(boxes: Truth, tmp_path: Path) -> None:
    early = run_of(boxes, 250, 10.0)  # every drift but an infinite one is below: converged when first asked
    late = run_of(boxes, 4, 10.0)
    assert early.whole(8).name == "250, to the end"
    assert early.whole(8).job.train_nerf.convergence == 0
    both, same = pairs([early, late], tmp_path, 8)
    assert both.stopped[-1]["steps"] == 240
    assert both.whole[-1]["steps"] == 250
    assert same.stopped is same.whole
    assert same.whole[-1]["steps"] == 4
    assert len(list(tmp_path.iterdir())) == 3


def test_what_is_compared_may_end_early(boxes: Truth) -> None:
    truths = analytic_scenes()
    runs = long_runs(truths)
    assert {run.truth.name for run in runs if run.name == _stopping.LONG} == {one.name for one in truths}
    assert [run.truth.name for run in runs if run.name == _stopping.LONGEST] == [_stopping.LONGEST_ON]
    for run in runs:
        assert run.job.train_nerf.convergence == job_of("standard").train_nerf.convergence > 0
        assert first_decision(run.job.train_nerf.steps) is not None
