"""What each choice behind the defaults is worth: known scenes with one thing changed.

    make bench ONLY=oracle-choices

The ideal denoisers, the figures and the cache are those of `oracle`.
"""

from pathlib import Path
from typing import Any

from benchmarks._trials import RESOLUTION, fill, job_of
from benchmarks._truths import analytic_scenes, catalogue_scenes
from benchmarks.oracle import CACHE, COSTS, ERRORS, PLAIN, SCENES, mean_row, measure, table, trials

CHOICES: dict[str, dict[str, Any]] = {
    "standard": {},
    "rates x 2": {"learning_rate": 2e-3, "grid_learning_rate": 2e-2},
    "2 views a step, twice the steps": {"cameras_per_step": 2, "steps": 400, "convergence": 0.0},
    "8 views a step, half the steps": {"cameras_per_step": 8, "steps": 100},
    "1 update a call": {"updates_per_call": 1},
    "3 updates a call": {"updates_per_call": 3},
    "no annealing": {"timestep_max_end": 0.98},
    "annealing to .25": {"timestep_max_end": 0.25},
    "annealing with a root": {"timestep_annealing": "sqrt"},
    "Latent-NeRF's weight of timesteps": {"signal_power": 0.5},
    "32 samples a ray": {"samples_per_ray": 32},
    "finest grid 128": {"grid_finest": 128},
    "finest grid 512": {"grid_finest": 512},
    "8 levels": {"grid_levels": 8},
    "16 levels": {"grid_levels": 16},
    "no sparsity": {"sparsity_weight": 0.0},
    "no weight on opacity": {"opacity_weight": 0.0},
    "no emptiness": {"emptiness_weight": 0.0},
    "emptiness 30": {"emptiness_weight": 30.0},
}
"""What each choice behind the defaults is worth, one changed at a time in `standard`."""


def main(folder: Path) -> dict[str, Any]:
    """Measure everything that the cache lacks, write the table into `folder`, return the figures."""
    truths = [t for t in (*analytic_scenes(), *catalogue_scenes(list(SCENES))) if t.name in PLAIN]
    runs = {name: job_of("standard", **changed) for name, changed in CHOICES.items()}
    fill(trials(truths, runs, RESOLUTION), CACHE)
    measured = measure(truths, runs, CACHE, RESOLUTION)
    means = {name: mean_row([rows[-1] for rows in by_scene.values()]) for name, by_scene in measured.items()}
    text = table(f"text, {', '.join(PLAIN)}, one thing changed", means, {**COSTS, **ERRORS})
    (folder / "oracle-choices.md").write_text(text, encoding="utf-8")
    default = means["standard"]["psnr"]
    return {
        "summary": {name: {"psnr_gain": round(row["psnr"] - default, 3)} for name, row in means.items()},
        "scenes": [truth.name for truth in truths],
        "means": means,
        "rows": measured,
    }
