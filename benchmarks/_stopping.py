"""Trials that end early once their scene has converged, each beside the same trial to its last step."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks._tables import markdown
from benchmarks._trials import Trial, fill, job_of, kept
from benchmarks._truths import Truth
from pipeline.options.job import Job

LONG, LONGEST = "500", "1000"
"""Steps of `high` for longer. The qualities' own runs are too short to save a step (`convergence`)."""
UPDATES = 2
"""A call: at as many as the qualities take, a long run is a slow one."""
LONGEST_ON = "ball"
"""The scene of the longest run: that which was cut off too early when converged runs were not yet cooled."""


class Stopping(NamedTuple):
    """A run that may end early, on a scene."""

    name: str
    truth: Truth
    job: Job

    def trial(self, resolution: int) -> Trial:
        """Return the run as it is."""
        return Trial(self.name, self.truth.name, self.job, 0, resolution)

    def whole(self, resolution: int) -> Trial:
        """Return the run without convergence."""
        options = dataclasses.replace(self.job.train_nerf, convergence=0.0)
        name = f"{self.name}, to the end"
        return Trial(name, self.truth.name, dataclasses.replace(self.job, train_nerf=options), 0, resolution)


class Pair(NamedTuple):
    """Rows of a run that may end early, and of the same run to its last step."""

    stopped: list[dict[str, Any]]
    whole: list[dict[str, Any]]


def long_jobs() -> dict[str, Job]:
    """Return the jobs whose convergence is compared with their last step, by name."""
    return {steps: job_of("high", steps=int(steps), updates_per_call=UPDATES) for steps in (LONG, LONGEST)}


def long_runs(truths: Sequence[Truth]) -> list[Stopping]:
    """Return what is compared: the long run of every scene, the longest of one."""
    return [
        Stopping(name, truth, job)
        for name, job in long_jobs().items()
        for truth in truths
        if name != LONGEST or truth.name == LONGEST_ON
    ]


def pairs(runs: Sequence[Stopping], cache: Path, resolution: int) -> list[Pair]:
    """Return both rows of every run, several at once; a run that takes all of its steps is its own end."""

    def rows(run: Stopping, trial: Trial) -> list[dict[str, Any]]:
        return list(kept(trial.name, run.truth, trial.job, 0, cache, resolution))

    fill([run.trial(resolution) for run in runs], cache)
    stopped = [rows(run, run.trial(resolution)) for run in runs]
    early = [found[-1]["steps"] < run.job.train_nerf.steps for run, found in zip(runs, stopped, strict=True)]
    fill([run.whole(resolution) for run, ended in zip(runs, early, strict=True) if ended], cache)
    return [
        Pair(found, rows(run, run.whole(resolution)) if ended else found)
        for run, found, ended in zip(runs, stopped, early, strict=True)
    ]


RATIOS = {"error_ratio": "views", "chamfer_ratio": "Chamfer", "normal_error_ratio": "normals"}


def compared(run: Stopping, both: Pair) -> dict[str, Any]:
    """Return the steps of both, and the errors (root mean square of views, the surface's distance, its
    normals) of the run that may end early as multiples of those at the last step."""
    stopped, whole = both.stopped[-1], both.whole[-1]
    return {
        "run": run.name,
        "scene": run.truth.name,
        "steps": stopped["steps"],
        "of": whole["steps"],
        "error_ratio": round(10 ** ((whole["psnr"] - stopped["psnr"]) / 20), 4),
        **{
            f"{error}_ratio": round(stopped[error] / whole[error], 4) for error in ("chamfer", "normal_error")
        },
        "stopped": stopped,
        "whole": whole,
    }


def worst(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Return the share of all steps that was saved, and the worst of each ratio among runs that ended early
    (1 where none did)."""
    early = [row for row in rows if row["steps"] < row["of"]]
    return {
        "ended_early": len(early),
        "steps_saved": round(1 - sum(row["steps"] for row in rows) / sum(row["of"] for row in rows), 3),
        **{f"worst_{key}": max((row[key] for row in early), default=1.0) for key in RATIOS},
    }


def early_ends(rows: Sequence[dict[str, Any]]) -> str:
    """Return the comparison in Markdown, a run a line."""
    heads = ("ending converged", "steps", *(f"{name}: error / final error" for name in RATIOS.values()))
    lines = [
        (f"{row['scene']}, {row['of']} steps", row["steps"], *(row[key] for key in RATIOS)) for row in rows
    ]
    return markdown(heads, lines)
