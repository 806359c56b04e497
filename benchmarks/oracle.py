"""Error against denoiser calls and processor time, where the truth is known: an ideal denoiser of one scene.

    make bench ONLY=oracle

Every scene (`_truths`) is learned through the product's own training from the closed-form denoiser of exactly
its pictures (`_ideal`), then compared with it. Text mode: `psnr` of held-out views [dB, latents of range 2],
`chamfer` between the surfaces that can be seen [scene units], `normal_error` [degrees]. Paint mode: `psnr` of
the mesh's pixels in held-out views. `calls` are runs of the denoiser, each on the views of one step, `views`
are the views denoised, `seconds` the processor time of everything else in training. The paper's plain run
takes 5000 steps of one view, on the `PLAIN` scenes. `calls_for_paper_error` is the least number of calls,
among those measured with the defaults, after which a scene is as good as at the end of the plain run: the
worst of these scenes; None if one never is. What each choice behind the defaults is worth: `oracle_choices`.

`convergence` compares runs that end once the scene has converged with the same runs to their last step:
the share of steps saved, and the errors of the worst scene as a multiple of its final ones.

Results are kept under runs/bench/oracle, by options and source: a second call only does what is missing.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._plots import Curve, Panel, write_fronts
from benchmarks._stopping import LONG, LONGEST, compared, early_ends, long_jobs, long_runs, pairs, worst
from benchmarks._tables import markdown
from benchmarks._trials import RESOLUTION, Trial, fill, job_of, kept
from benchmarks._truths import Truth, analytic_scenes, catalogue_scenes
from pipeline.options.job import Job

CACHE = Path("runs/bench/oracle")
SCENES = ("piano", "car", "horse")
"""Models beside the analytic shapes."""
PAPER: dict[str, Any] = {
    "steps": 5000,
    "cameras_per_step": 1,
    "timestep_min": 0.02,
    "timestep_max": 0.98,
    "timestep_max_end": 0.98,
    "signal_power": 0.5,
    "predicted_clean_clamp": 0.0,
    "sparsity_weight": 33.0,
    "sparsity_ramp": 0.0,
    "opacity_weight": 0.0,
    "emptiness_weight": 0.0,
    "updates_per_call": 1,
    "convergence": 0.0,
}
"""What the paper's run has otherwise: one view a step, no annealing, its weights (see nerf_options)."""
PLAIN = ("ball", "boxes", "car")
"""Scenes of the plain run, of high and of one cut short: when all six were compared, those that took the
defaults the most calls to be as good as the plain run (500, 240, 300; torus 210, horse 130, piano 50)."""
SHORT = "50"
"""Steps of a run of these scenes that is cut short."""


def paper_calls(rows: Sequence[dict[str, Any]], target: float) -> dict[str, Any] | None:
    """Return the cheapest of the rows that is as good as the target [dB], by calls."""
    good = [row for row in rows if row["psnr"] >= target]
    return min(good, key=lambda row: row["calls"]) if good else None


def measure(truths: Sequence[Truth], runs: dict[str, Job], cache: Path, resolution: int) -> dict[str, Any]:
    """Return, for every run and scene, its rows; the run "paper" is traced."""
    by_name = {truth.name: truth for truth in truths}
    measured: dict[str, Any] = {name: {} for name in runs}
    for one in trials(truths, runs, resolution):
        result = kept(one.name, by_name[one.truth], one.job, one.traced, cache, resolution)
        measured[one.name][one.truth] = result
    return measured


def trials(truths: Sequence[Truth], runs: dict[str, Job], resolution: int) -> list[Trial]:
    """Return the trial of every run and scene; the run "paper" is traced."""
    return [
        Trial(name, truth.name, job, -(-job.train_nerf.steps // 8) if name == "paper" else 0, resolution)
        for name, job in runs.items()
        for truth in truths
    ]


def mean_row(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Return the means of the figures of several scenes."""
    return {key: round(float(np.mean([row[key] for row in rows])), 5) for key in rows[0]}


def against_paper(measured: dict[str, Any], front: Sequence[str]) -> dict[str, Any]:
    """Return, by scene, what the plain run reaches and the cheapest run of the front that is as good."""
    table = {}
    for scene, rows in measured["paper"].items():
        target = rows[-1]["psnr"]
        found = paper_calls([measured[name][scene][-1] for name in front], target)
        table[scene] = {
            "paper_psnr": target,
            **({f"default_{key}": found[key] for key in ("psnr", "calls", "views")} if found else {}),
        }
    return table


def summarise(measured: dict[str, Any], front: Sequence[str], chosen: str) -> dict[str, Any]:
    """Return the summary: the chosen run's means over the scenes, what the plain run's error costs, and both
    on the scenes of the plain run."""
    table = against_paper(measured, front)
    reached = all("default_calls" in row for row in table.values())
    row = mean_row([rows[-1] for rows in measured[chosen].values()])
    there = {name: mean_row([measured[name][scene][-1] for scene in table]) for name in ("paper", chosen)}
    return {
        "calls_for_paper_error": max(r["default_calls"] for r in table.values()) if reached else None,
        "views_for_paper_error": max(r["default_views"] for r in table.values()) if reached else None,
        "chamfer": row["chamfer"],
        "normal_error": row["normal_error"],
        "psnr": row["psnr"],
        "plain_scenes": {
            name: {key: means[key] for key in ("calls", "views", "chamfer", "normal_error", "psnr")}
            for name, means in there.items()
        },
    }


def panels(measured: dict[str, Any], painted: dict[str, Any], front: Sequence[str]) -> list[Panel]:
    """Return the plots: quality against views denoised and processor seconds, surface, on the scenes of the
    plain run; paint on all."""
    keys = ("steps", "calls", "views", "seconds", "psnr")
    traces = zip(*measured["paper"].values(), strict=True)
    plain_rows = [mean_row([{key: row[key] for key in keys} for row in rows]) for rows in traces]
    rows = [mean_row([measured[name][scene][-1] for scene in measured["paper"]]) for name in front]
    paint = [mean_row(list(painted[name].values())) for name in painted]
    labels = [name if not name.isdigit() else "" for name in front]
    star = front.index("standard") if "standard" in front else None

    def curve(name: str, source: Sequence[dict[str, float]], x: str, y: str, default: bool) -> Curve:
        points = [row[x] for row in source], [row[y] for row in source]
        return Curve(name, *points, star if default else None, labels if default else ())

    psnr = "PSNR of held-out views [dB]"
    shown = list(painted)
    return [
        *(
            Panel(
                label,
                psnr,
                [
                    curve("defaults", rows, x, "psnr", True),
                    curve("paper's run", plain_rows, x, "psnr", False),
                ],
            )
            for x, label in (("views", "views denoised"), ("seconds", "processor seconds without denoiser"))
        ),
        Panel(
            "views denoised",
            "Chamfer distance [scene units]",
            [
                curve("defaults", rows, "views", "chamfer", True),
                Curve("paper's run", [plain_rows[-1]["views"]], [_last(measured["paper"], "chamfer")]),
            ],
            log_y=True,
        ),
        Panel(
            "views denoised",
            "paint: PSNR of the mesh's pixels [dB]",
            [
                Curve(
                    "defaults",
                    [row["views"] for row in paint],
                    [row["psnr"] for row in paint],
                    shown.index("standard") if "standard" in shown else None,
                    shown,
                )
            ],
        ),
    ]


COSTS = {"calls": "denoiser calls", "views": "views denoised", "seconds": "processor s without denoiser"}
ERRORS = {"psnr": "PSNR [dB]", "chamfer": "Chamfer [scene units]", "normal_error": "normals [degrees]"}


def table(title: str, rows: dict[str, Any], figures: dict[str, str]) -> str:
    """Return the means over scenes of runs in Markdown, a run a line."""
    lines = [(name, *(row[key] for key in figures)) for name, row in rows.items()]
    return markdown((title, *figures.values()), lines)


def _last(rows: dict[str, Any], key: str) -> float:
    return float(np.mean([scene[-1][key] for scene in rows.values()]))


def main(folder: Path) -> dict[str, Any]:
    """Measure everything that the cache lacks, write the plot into `folder`, return the figures."""
    truths = [*analytic_scenes(), *catalogue_scenes(list(SCENES))]
    plain = [truth for truth in truths if truth.name in PLAIN]
    stopping = long_runs(truths)
    qualities = {quality: job_of(quality) for quality in ("draft", "standard", "high")}
    others = {SHORT: job_of("standard", steps=int(SHORT)), LONG: long_jobs()[LONG]}
    front = [SHORT, *qualities, LONG]
    everywhere = {quality: qualities[quality] for quality in ("draft", "standard")}
    on_plain = {"paper": job_of("standard", **PAPER), **others, "high": qualities["high"]}
    fill(
        [
            *trials(plain, on_plain, RESOLUTION),
            *(run.trial(RESOLUTION) for run in stopping if run.name == LONGEST),
            *(run.whole(RESOLUTION) for run in stopping if run.name == LONGEST),  # known to stop: no waiting
            *(run.trial(RESOLUTION) for run in stopping if run.truth not in plain),
            *trials(truths, everywhere, RESOLUTION),
            *(Trial("paint", truth.name, job) for job in qualities.values() for truth in truths),
        ],
        CACHE,
    )
    both = list(zip(stopping, pairs(stopping, CACHE, RESOLUTION), strict=True))
    measured = {
        **measure(plain, on_plain, CACHE, RESOLUTION),
        **measure(truths, everywhere, CACHE, RESOLUTION),
    }
    painted = {
        quality: {truth.name: kept("paint", truth, job, 0, CACHE, RESOLUTION) for truth in truths}
        for quality, job in qualities.items()
    }
    write_fronts(
        folder / "oracle.png",
        panels(measured, painted, front),
        f"Ideal denoisers of {', '.join(PLAIN)} (paint: of {len(truths)} scenes), means; star: the default",
    )
    stopped = [compared(run, found) for run, found in both]
    means = {
        "all_scenes": {n: mean_row([r[-1] for r in measured[n].values()]) for n in ("draft", "standard")},
        "plain_scenes": {
            **{n: mean_row([measured[n][t.name][-1] for t in plain]) for n in (*front, "paper")},
            f"{LONG}, to the end": mean_row(
                [found.whole[-1] for run, found in both if run.name == LONG and run.truth in plain]
            ),
        },
        "paint": {n: mean_row(list(rows.values())) for n, rows in painted.items()},
    }
    written = (
        table(f"text, {len(truths)} scenes", means["all_scenes"], {**COSTS, **ERRORS}),
        table(f"text, {', '.join(PLAIN)}", means["plain_scenes"], {**COSTS, **ERRORS}),
        table("paint", means["paint"], {**COSTS, "psnr": "PSNR of the mesh's pixels [dB]"}),
        early_ends(stopped),
    )
    (folder / "oracle.md").write_text("\n".join(written), encoding="utf-8")
    return {
        "summary": {
            "scenes": len(truths),
            **summarise(measured, front, "standard"),
            "convergence": worst(stopped),
        },
        "missing": [name for name in SCENES if name not in {truth.name for truth in truths}],
        "by_scene": against_paper(measured, front),
        "convergence": stopped,
        **means,
        "rows": measured,
        "paint_rows": painted,
    }
