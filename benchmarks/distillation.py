"""Which score distillation? Error per call of the denoiser, for every gradient and schedule of `_ways`.

    make bench ONLY=distillation

Every way trains the product's own scene from an ideal denoiser (`_mixtures`) which believes in several
scenes: told the kind, in four variants of it, without a text also in those of other kinds. `apart`: each view
is judged alone; `together`: those of a step are, at one noise level, as multi-view models do; `exact`: one
scene alone; `weak`: apart, erring as the bundled model does (`_weakness`); `few steps`: apart, the likeliest
scene in place of the mean, as consistency models answer; `faces`: apart, four quarter turns of one object, of
which texts take the front for likely from everywhere. A way that asks several times a step takes so many
fewer steps: `calls` count runs of the network on the views of a step.

`commitment` is the share of held-out views that are most like the scene that most of them are most like: 1 is
one object, 1/4 a heap of faces. `psnr` [dB], `chamfer` [scene units] and `normal_error` [degrees] are against
that scene, `psnr_interval` half of its 95 % interval over seeds, each seed's scenes taken together (None: one
seed). `calls_for_todays_error` are the fewest calls after which exact scenes are as good as `TODAY`, what
`sds` reached after 200 before the occupancy was refreshed by updates, by PSNR and Chamfer distance;
`calls_on_unseen` the same on scenes that no choice was made by; None if nothing is. `chosen` is the way that
is as good after so few.

Results are kept under runs/bench/distillation, by setting and source.
"""

import functools
import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from benchmarks._distilling import Setting, learn
from benchmarks._mixture_scenes import KINDS
from benchmarks._plots import Curve, Panel, write_fronts
from benchmarks._pool import at_once
from benchmarks._tables import markdown
from benchmarks._ways import FACED, GRADIENTS, WAYS
from pipeline.run import staleness

CACHE = Path("runs/bench/distillation")
EXACT, UNSEEN = ("ball", "boxes", "car"), ("torus", "piano", "horse")
BUDGETS = (50, 100, 200)
"""Calls."""
TODAY = {"exact": (30.5, 0.0084), "unseen": (34.28, 0.0069)}
"""PSNR [dB] and Chamfer distance after 200 calls, two updates each: means of `EXACT` and `UNSEEN`."""
ORACLES = ("exact", "apart", "together", "weak", "few steps", "faces")
DECIDING = ("sds", "4 updates", "8 updates")
"""Ways that are measured at every budget (the last one, which is slow, at small ones alone); the first two on
scenes that no choice was made by as well."""
CHOSEN, SEEDS = ("4 updates", 100), 10
"""What may take the place of today's 200 calls, and how often what decides it is repeated."""
FIGURES = ("psnr", "chamfer", "normal_error", "commitment", "seconds", "views", "steps")


def settings(seeds: int) -> list[Setting]:
    """Return all trials; `seeds` of those that decide."""
    found = []
    for name, way in WAYS.items():
        if way.alone:
            budgets: tuple[int, ...] = BUDGETS[1:] if name in GRADIENTS else BUDGETS[1:2]
            if name in DECIDING:
                budgets = BUDGETS[:2] if name == DECIDING[2] else BUDGETS
            found += [Setting(name, "exact", scene, calls) for scene in EXACT for calls in budgets]
        if name != "perp-neg":
            found += [Setting(name, "apart", kind, BUDGETS[-1]) for kind in KINDS]
            found.append(Setting(name, "together", KINDS[-1], BUDGETS[-1]))
        if name in GRADIENTS:
            found += [Setting(name, oracle, KINDS[-1], BUDGETS[-1]) for oracle in ("weak", "few steps")]
        if name in FACED:
            found += [Setting(name, "faces", kind, BUDGETS[-1]) for kind in KINDS]
    for name in DECIDING[:2]:
        found += [Setting(name, "exact", scene, calls) for scene in UNSEEN for calls in BUDGETS[1:]]
    again = [(CHOSEN[0], "exact", scene, CHOSEN[1]) for scene in EXACT]
    again += [(name, "apart", KINDS[-1], BUDGETS[-1]) for name in DECIDING[:2]]
    return found + [Setting(*one, seed) for seed in range(1, seeds) for one in again]


def place(setting: Setting) -> Path:
    """Return the file of a trial's result, named after everything that it depends on."""
    parts = ("_distilling", "_gradients", "_mixtures", "_mixture_scenes", "_ideal", "_truths", "_trials")
    own = [Path(__file__).with_name(f"{name}.py").read_bytes().hex() for name in parts]
    own.append(repr(WAYS[setting.way]))
    if setting.oracle == "weak":
        own.append(Path(__file__).with_name("_weakness.py").read_bytes().hex())
    asked = [*setting, staleness.code("pipeline.stages.train_nerf")[0], own]
    return CACHE / f"{hashlib.sha256(json.dumps(asked).encode()).hexdigest()[:20]}.json"


@functools.cache
def kept(setting: Setting) -> dict[str, Any]:
    """Return the result of a trial, from the cache if it is there."""
    path = place(setting)
    if not path.is_file():
        result = learn(setting)
        CACHE.mkdir(parents=True, exist_ok=True)
        path.with_suffix(".partial").write_text(json.dumps(result) + "\n", encoding="utf-8")
        path.with_suffix(".partial").replace(path)
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def interval(values: Sequence[float]) -> float | None:
    """Return half of the 95 % interval of a mean (Student's t); None of one value."""
    if len(values) < 2:
        return None
    deviation = float(np.std(values, ddof=1)) / len(values) ** 0.5
    return round(float(student.ppf(0.975, len(values) - 1)) * deviation, 3)


def rows_of(results: dict[Setting, dict[str, Any]]) -> list[dict[str, Any]]:
    """Return a row a way, oracle, set of scenes and budget: means over scenes and seeds."""
    groups: dict[tuple[str, str, int], list[tuple[Setting, dict[str, Any]]]] = {}
    for setting, result in results.items():
        oracle = "unseen" if setting.oracle == "exact" and setting.scene in UNSEEN else setting.oracle
        groups.setdefault((setting.way, oracle, setting.calls), []).append((setting, result))
    rows = []
    for (way, oracle, calls), found in groups.items():
        means = {key: round(float(np.mean([one[key] for _, one in found])), 4) for key in FIGURES}
        seeds = sorted({setting.seed for setting, _ in found})
        by_seed = [np.mean([one["psnr"] for setting, one in found if setting.seed == s]) for s in seeds]
        rows.append(
            {
                "oracle": oracle,
                "way": way,
                "calls": calls,
                **means,
                "seeds": len(seeds),
                "psnr_interval": interval([float(value) for value in by_seed]),
            }
        )
    return sorted(rows, key=lambda row: (*ORACLES, "unseen").index(row["oracle"]))


def as_good(rows: Sequence[dict[str, Any]], oracle: str) -> dict[str, Any] | None:
    """Return the row of the fewest calls that is as good as `TODAY` (of equals the best); None if none is."""
    psnr, chamfer = TODAY[oracle]
    good = [
        row for row in rows if row["oracle"] == oracle and row["psnr"] >= psnr and row["chamfer"] <= chamfer
    ]
    return min(good, key=lambda row: (row["calls"], -row["psnr"]), default=None)


def panels(rows: Sequence[dict[str, Any]]) -> list[Panel]:
    """Return the plots: all ways on exact scenes, by PSNR and by Chamfer distance."""
    ways = [name for name, way in WAYS.items() if way.alone]

    def curve(way: str, key: str) -> Curve:
        ours = [row for row in rows if (row["oracle"], row["way"]) == ("exact", way)]
        ours.sort(key=lambda row: row["calls"])
        budgets = [row["calls"] for row in ours]
        star = budgets.index(BUDGETS[1]) if way == DECIDING[1] else None
        return Curve(way, budgets, [row[key] for row in ours], star)

    return [
        Panel("calls of the denoiser", "PSNR of held-out views [dB]", [curve(way, "psnr") for way in ways]),
        Panel(
            "calls of the denoiser",
            "Chamfer distance [scene units]",
            [curve(way, "chamfer") for way in ways],
            log_y=True,
        ),
    ]


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return a line a way in Markdown: PSNR and Chamfer distance of exact scenes, after so many calls; PSNR
    and commitment where several are believed in, after 200."""
    found = {(row["way"], row["oracle"], row["calls"]): row for row in rows}
    columns = [("exact", calls) for calls in BUDGETS] + [("unseen", calls) for calls in BUDGETS[1:]]
    columns += [(oracle, BUDGETS[-1]) for oracle in ORACLES[1:]]

    def cell(way: str, oracle: str, calls: int) -> str:
        row = found.get((way, oracle, calls))
        if row is None:
            return ""
        second = f"{row['chamfer']:.4f}" if oracle in ("exact", "unseen") else f"{row['commitment']:.2f}"
        around = f" ± {row['psnr_interval']:.2f}" if row["psnr_interval"] is not None else ""
        return f"{row['psnr']:.1f}{around}, {second}"

    heads = ("way", *(f"{oracle}, {calls} calls" for oracle, calls in columns))
    return markdown(heads, [(way, *(cell(way, *column) for column in columns)) for way in WAYS])


def main(folder: Path) -> dict[str, Any]:
    """Run every trial, write table and picture into `folder`, return the figures."""
    trials = list(dict.fromkeys(settings(int(os.environ.get("SEEDS") or SEEDS))))
    at_once(kept, [(setting,) for setting in trials if not place(setting).is_file()], "score distillations")
    rows = rows_of({setting: kept(setting) for setting in trials})
    (folder / "distillation.md").write_text(table(rows), encoding="utf-8")
    write_fronts(folder / "distillation.png", panels(rows), f"exact scenes: {', '.join(EXACT)}")
    by_name = {
        name: {row["way"]: row for row in rows if row["oracle"] == name and row["calls"] == BUDGETS[-1]}
        for name in ORACLES
    }
    chosen, unseen = as_good(rows, "exact"), as_good(rows, "unseen")
    return {
        "summary": {
            "calls_for_todays_error": chosen and chosen["calls"],
            "calls_on_unseen": unseen and unseen["calls"],
            "chosen": chosen["way"] if chosen else DECIDING[0],
            "commitment": {name: by_name[name][DECIDING[1]]["commitment"] for name in ORACLES[1:]},
            "errors": {
                name: {way: [row[k] for k in ("psnr", "chamfer", "commitment")] for way, row in found.items()}
                for name, found in by_name.items()
            },
        },
        "rows": rows,
    }
