"""Error against denoiser calls and processor time, where the truth is known: an ideal denoiser of one scene.

    make bench ONLY=oracle

Every scene (`_truths`) is learned through the product's own training from the closed-form denoiser of exactly
its pictures (`_ideal`), then compared with it. Text mode: `psnr` of held-out views [dB, latents of range 2],
`chamfer` between the surfaces that can be seen [scene units], `normal_error` [degrees]. Paint mode: `psnr` of
the mesh's pixels in held-out views. `calls` are runs of the denoiser, each on the views of one step, `views`
are the views denoised, `seconds` the processor time of everything else in training. The paper's plain run
takes 5000 steps of one view. `calls_for_paper_error` is the least number of calls, among those measured with
the defaults, after which a scene is as good as at the end of the plain run: the worst of all scenes; None if
some scene never is.

`convergence` compares runs that stop once the scene has come to rest with the same runs to their last step:
the share of steps saved, and by how much the error (root mean square) of the worst scene is larger.

Results are kept under runs/bench/oracle, by options and source: a second call only does what is missing.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._plots import Curve, Panel, write_fronts
from benchmarks._tables import markdown
from benchmarks._trials import RESOLUTION, Trial, fill, job_of, kept
from benchmarks._truths import Truth, analytic_scenes, catalogue_scenes
from pipeline.job import Job

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
    "updates_per_call": 1,
    "convergence": 0.0,
}
"""What the paper's run has otherwise: one view a step, no annealing, its weights (see nerf_options)."""
SHORTER = (25, 50, 100)
"""Steps of the shorter runs on the curve of the defaults, which has draft, standard and high too."""
CHOICES: dict[str, dict[str, Any]] = {
    "draft": {},
    "rates x 2": {"learning_rate": 2e-3, "grid_learning_rate": 2e-2},
    "2 views a step, twice the steps": {"cameras_per_step": 2, "steps": 260},
    "8 views a step, half the steps": {"cameras_per_step": 8, "steps": 65},
    "no annealing": {"timestep_max_end": 0.98},
    "32 samples a ray": {"samples_per_ray": 32},
    "half the resolution, first half": {"coarse_share": 0.5},
    "1 update a call": {"updates_per_call": 1},
    "4 updates a call": {"updates_per_call": 4},
    "finest grid 512": {"grid_finest": 512},
}
"""What each choice behind the defaults is worth, one changed at a time in a draft."""
CHOICE_SCENES = ("boxes", "horse")


TO_THE_END = "{}, to the end"
STOPPED = ("standard",)


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
    """Return the summary: the chosen run's means over the scenes, and what the plain run's error costs."""
    table = against_paper(measured, front)
    reached = all("default_calls" in row for row in table.values())
    row, paper = (mean_row([rows[-1] for rows in measured[name].values()]) for name in (chosen, "paper"))
    return {
        "calls_for_paper_error": max(r["default_calls"] for r in table.values()) if reached else None,
        "views_for_paper_error": max(r["default_views"] for r in table.values()) if reached else None,
        "chamfer": row["chamfer"],
        "normal_error": row["normal_error"],
        "psnr": row["psnr"],
        "paper": {key: paper[key] for key in ("calls", "views", "chamfer", "normal_error", "psnr")},
    }


def convergence(measured: dict[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """Return, by run, what stopping at convergence saves and loses against its `TO_THE_END`, by scene."""
    table: dict[str, Any] = {}
    for name in names:
        stopped, whole = measured[name], measured[TO_THE_END.format(name)]
        table[name] = {
            scene: {
                "steps": stopped[scene][-1]["steps"],
                "of": whole[scene][-1]["steps"],
                "error_ratio": round(10 ** ((whole[scene][-1]["psnr"] - stopped[scene][-1]["psnr"]) / 20), 4),
            }
            for scene in stopped
        }
    return table


def panels(measured: dict[str, Any], painted: dict[str, Any], front: Sequence[str]) -> list[Panel]:
    """Return the plots: quality against views denoised and processor seconds, surface, paint."""
    keys = ("steps", "calls", "views", "seconds", "psnr")
    traces = zip(*measured["paper"].values(), strict=True)
    plain_rows = [mean_row([{key: row[key] for key in keys} for row in rows]) for rows in traces]
    rows = [mean_row([r[-1] for r in measured[name].values()]) for name in front]
    paint = [mean_row(list(painted[name].values())) for name in painted]
    labels = [name if not name.isdigit() else "" for name in front]
    star = list(front).index("standard") if "standard" in front else None

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


def tables(front: dict[str, Any], choices: dict[str, Any], paint: dict[str, Any]) -> str:
    """Return the means over the scenes in Markdown: the runs, the choices behind the defaults, painting."""
    costs = {"calls": "denoiser calls", "views": "views denoised", "seconds": "processor s without denoiser"}
    errors = {"psnr": "PSNR [dB]", "chamfer": "Chamfer [scene units]", "normal_error": "normals [degrees]"}
    parts = []
    for title, rows, figures in (
        ("text", front, {**costs, **errors}),
        ("text, a draft with one thing changed", choices, {**costs, **errors}),
        ("paint", paint, {**costs, "psnr": "PSNR of the mesh's pixels [dB]"}),
    ):
        lines = [(name, *(row[key] for key in figures)) for name, row in rows.items()]
        parts.append(markdown((title, *figures.values()), lines))
    return "\n".join(parts)


def _last(rows: dict[str, Any], key: str) -> float:
    return float(np.mean([scene[-1][key] for scene in rows.values()]))


def main(folder: Path) -> dict[str, Any]:
    """Measure everything that the cache lacks, write the plot into `folder`, return the figures."""
    truths = [*analytic_scenes(), *catalogue_scenes(list(SCENES))]
    chosen = [truth for truth in truths if truth.name in CHOICE_SCENES]
    shorter = {str(steps): job_of("draft", steps=steps) for steps in SHORTER}
    qualities = {quality: job_of(quality) for quality in ("draft", "standard", "high")}
    front = {**shorter, **qualities}
    runs = {
        "paper": job_of("standard", **PAPER),
        **{TO_THE_END.format(quality): job_of(quality, convergence=0.0) for quality in STOPPED},
        **front,
    }
    changes = {name: job_of("draft", **changed) for name, changed in CHOICES.items()}
    fill(
        [
            *trials(truths, runs, RESOLUTION),
            *(Trial("paint", truth.name, job) for job in qualities.values() for truth in truths),
            *trials(chosen, changes, RESOLUTION),
        ],
        CACHE,
    )
    measured = measure(truths, runs, CACHE, RESOLUTION)
    choices = measure(chosen, changes, CACHE, RESOLUTION)
    painted = {
        quality: {truth.name: kept("paint", truth, job, 0, CACHE, RESOLUTION) for truth in truths}
        for quality, job in qualities.items()
    }
    write_fronts(
        folder / "oracle.png",
        panels(measured, painted, list(front)),
        f"Ideal denoisers of {len(truths)} scenes, means; star: the default",
    )
    means = {
        "front": {n: mean_row([r[-1] for r in measured[n].values()]) for n in (*front, "paper")},
        "choices_in_draft": {n: mean_row([r[-1] for r in choices[n].values()]) for n in choices},
        "paint": {n: mean_row(list(rows.values())) for n, rows in painted.items()},
    }
    (folder / "oracle.md").write_text(tables(*means.values()), encoding="utf-8")
    stopped = convergence(measured, STOPPED)
    cut = [row for rows in stopped.values() for row in rows.values()]
    return {
        "summary": {
            "scenes": len(truths),
            **summarise(measured, list(front), "standard"),
            "convergence": {
                "steps_saved": round(1 - sum(row["steps"] for row in cut) / sum(row["of"] for row in cut), 3),
                "worst_error_ratio": max(row["error_ratio"] for row in cut),
            },
        },
        "missing": [name for name in SCENES if name not in {truth.name for truth in truths}],
        "by_scene": against_paper(measured, list(front)),
        "convergence": stopped,
        **means,
        "rows": measured,
        "paint_rows": painted,
    }
