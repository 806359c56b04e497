"""Which score distillation? Error per call of the denoiser, for every gradient of `_gradients`.

    make bench ONLY=distillation

Every gradient trains the product's own scene from an ideal denoiser (`_mixtures`) which believes in several
scenes: told the kind, in `BELIEVED` variants of it, without a text also in those of other kinds. `apart`:
each view is judged alone; `together`: those of a step are, at one noise level, as multi-view models do;
`exact`: one scene alone. A method that asks several times a step takes so many fewer steps: `calls` count
runs of the network on the views of a step.

`commitment` is the share of held-out views that are most like the scene that most of them are most like: 1 is
one object, 1 / `BELIEVED` a heap of faces. `psnr` [dB], `chamfer` [scene units] and `normal_error` [degrees]
are against that scene. `chosen` is the gradient with the best `psnr` of exact scenes after the most calls.
`calls_for_todays_error`: of exact scenes, the fewest calls among those measured that
are as good as `TODAY`, what the default reaches after 200; None if nothing does. `weak` and `few steps` are
the mixture of one kind through a blur of clean pictures that grows with the noise, and with the likeliest
scene in place of the mean. SEEDS=n repeats every trial.

Results are kept under runs/bench/distillation, by setting and source.
"""

import dataclasses
import functools
import hashlib
import json
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter

from benchmarks._gradients import METHODS, Step
from benchmarks._ideal import Calls, linear_schedule
from benchmarks._mixtures import Believed, Query, believed, commitment, nearest, query_of, weakened
from benchmarks._plots import Curve, Panel, write_fronts
from benchmarks._pool import at_once
from benchmarks._tables import markdown
from benchmarks._trials import RESOLUTION, backgrounds, held_out, job_of, shape_error, views_psnr
from benchmarks._truths import Truth, analytic_scenes, catalogue_scenes
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.looks import Look, dress
from export.everyday_objects.data.shapes import assemble
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.rasterize import Fragments
from pipeline.nerf import train as nerf_train
from pipeline.nerf.rendering import render_views
from pipeline.nerf.step import initial_state
from pipeline.options.job import Job
from pipeline.run import staleness
from pipeline.training.batch import Batch, ViewGradient

CACHE = Path("runs/bench/distillation")
BELIEVED = 4
KINDS = ("sofa", "horse", "car")
"""Told; without a text any of them and of `OTHERS` may be it."""
OTHERS = ("airplane", "house", "teapot")
EXACT = ("ball", "boxes", "car")
TODAY = {"psnr": 30.5, "chamfer": 0.0084}
BUDGETS = (50, 100, 200)
"""Calls."""
ORACLES = ("exact", "apart", "together", "weak", "few steps")
SCALES = {"sds": 7.5, "csd": 1.0, "nfsd": 7.5, "ism": 7.5, "sdi": 7.5, "4 steps": 7.5}
"""Guidance, as the papers have it for these; SDS at 100 there, where the prior is ambiguous."""
CALLS_A_STEP = {"sds": 2, "csd": 2, "nfsd": 2, "ism": 6, "sdi": 12, "4 steps": 8}
"""At the guidance above; an exact scene has nothing to guide by, and takes the passes with a text alone."""
BLUR = 2.0
"""Of the weak network's clean pictures at the most noise, falling with it [latent pixels]."""


class Setting(NamedTuple):
    """One trial."""

    method: str
    oracle: str
    scene: str
    calls: int
    seed: int = 0
    resolution: int = RESOLUTION


def painted(colours: Float[np.ndarray, "f 3"], seen: Fragments) -> Float[np.ndarray, "h w 3"]:
    """Return the colour of the face that every pixel sees."""
    return colours[seen.triangle]


def kind_scenes(word: str, count: int) -> list[Truth]:
    """Return variants of a kind of the default model's data, blue, in flat light."""
    kind = BY_WORD[word]
    found = []
    for seed in range(count):
        shape = assemble(kind.make(np.random.default_rng(seed)))
        colours = dress(np.random.default_rng(0), kind, shape, Look("blue")).colours
        mesh = Mesh(shape.vertices, shape.faces)
        found.append(Truth(f"{word} {seed}", mesh, functools.partial(painted, colours[shape.paint])))
    return found


def scenes_of(setting: Setting) -> tuple[list[Truth], list[Truth]]:
    """Return the scenes that a text leaves, and the others."""
    if setting.oracle == "exact":
        known = {truth.name: truth for truth in (*analytic_scenes(), *catalogue_scenes(["car"]))}
        return [known[setting.scene]], []
    others = [scene for word in (*KINDS, *OTHERS) if word != setting.scene for scene in kind_scenes(word, 2)]
    return kind_scenes(setting.scene, BELIEVED), others


def blurred(clean: Float[np.ndarray, "b 4 h w"], timesteps: np.ndarray) -> Float[np.ndarray, "b 4 h w"]:
    """Return clean pictures as a weak network would predict them."""
    widths = BLUR * timesteps / len(linear_schedule().alphas_cumprod)
    return np.stack(
        [gaussian_filter(c, (0, w, w), mode="nearest") for c, w in zip(clean, widths, strict=True)]
    )


def calls_a_step(setting: Setting) -> int:
    """Return the runs of the network that a step of a method asks for."""
    guided = CALLS_A_STEP[setting.method]
    if setting.oracle != "exact":
        return guided
    return {"sds": 1, "ism": 5, "sdi": 11, "4 steps": 4}.get(setting.method, guided)


def view_gradient(
    setting: Setting, job: Job, scenes: tuple[Sequence[Truth], Sequence[Truth]], calls: Calls
) -> ViewGradient:
    """Return the method's gradient from the oracle, as a training takes it."""
    schedule, method = linear_schedule(), METHODS[setting.method]
    total = len(schedule.alphas_cumprod)
    scale = 1.0 if setting.oracle == "exact" else SCALES[setting.method]
    told, others = ([truth.draw for truth in part] for part in scenes)

    def gradient(latents: Float[np.ndarray, "b 4 h w"], batch: Batch) -> Float[np.ndarray, "b 4 h w"]:
        began = time.process_time()
        seen = believed(told, others, batch, latents.shape[-1])
        levels = batch.noise_levels
        if setting.oracle == "together":
            levels = np.full_like(levels, levels[0])
        query = oracle(setting, seen, calls)
        step = Step(
            latents.astype(np.float64),
            np.clip((levels * total).astype(np.int64), 1, total - 1),
            batch.noise.astype(np.float64),
            scale,
            job.train_nerf.signal_power,
            bad_pictures(seen),
        )
        found = method(query, schedule, step)
        calls.seconds += time.process_time() - began
        return np.ascontiguousarray(found, np.float32)

    return gradient


def oracle(setting: Setting, seen: Believed, calls: Calls) -> Query:
    """Return the denoiser of a setting for the views of a step."""
    schedule = linear_schedule()
    query = query_of(
        seen,
        schedule,
        together=setting.oracle == "together",
        few_steps=setting.oracle == "few steps",
        calls=calls,
    )
    return weakened(query, schedule, blurred) if setting.oracle == "weak" else query


def bad_pictures(seen: Believed) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the noise that the blurred mean of all scenes would leave, the opposite of a good picture."""
    schedule = linear_schedule()
    bad = np.stack([gaussian_filter(mean, (0, 2, 2), mode="nearest") for mean in seen.pictures.mean(1)])

    def noise(noisy: np.ndarray, timesteps: np.ndarray) -> np.ndarray:
        signal, sigma = schedule.factors(timesteps)
        return np.asarray((noisy - signal * bad) / sigma, np.float64)

    return noise


def learn(setting: Setting, **small: Any) -> dict[str, Any]:
    """Train a scene by a setting; return its errors against the scene that it is nearest to. `small`: other
    options of train_nerf."""
    steps = max(2, setting.calls // calls_a_step(setting))
    job = job_of("standard", steps=steps, checkpoint_every=100_000, preview_every=100_000, **small)
    job = dataclasses.replace(job, seed=setting.seed)
    scenes, calls = scenes_of(setting), Calls()
    state = initial_state(job.train_nerf, backgrounds(), setting.seed)
    gradient = view_gradient(setting, job, scenes, calls)
    began = time.process_time()
    nerf_train.train(state, [], job.train_nerf, setting.resolution, gradient)
    spent = time.process_time() - began - calls.seconds
    cameras, flat = held_out(job.train_nerf), backgrounds()[0]
    views = render_views(state.scene, cameras, setting.resolution, flat).latents
    pictures = np.stack(
        [
            np.stack([truth.draw(camera, setting.resolution, flat) for truth in scenes[0]])
            for camera in cameras
        ]
    )
    choices = nearest(views, pictures)
    truth = scenes[0][int(np.bincount(choices).argmax())]
    return {
        "steps": steps,
        "calls": calls.runs,
        "views": calls.views,
        "seconds": round(spent, 2),
        "commitment": round(commitment(choices), 3),
        "psnr": round(views_psnr(state.scene, truth, cameras, setting.resolution), 3),
        **shape_error(state.scene, truth, job),
    }


def settings(seeds: int) -> list[Setting]:
    """Return all trials."""
    found = []
    for seed in range(seeds):
        for method in METHODS:
            if method not in ("csd", "nfsd"):  # of one scene alone a text adds nothing
                found += [
                    Setting(method, "exact", scene, calls, seed) for scene in EXACT for calls in BUDGETS
                ]
            found += [
                Setting(method, name, kind, BUDGETS[-1], seed) for name in ORACLES[1:] for kind in KINDS
            ]
    return found


def place(setting: Setting) -> Path:
    """Return the file of a trial's result, named after everything that it depends on."""
    own = [
        Path(__file__).with_name(f"{name}.py").read_bytes().hex()
        for name in ("distillation", "_gradients", "_mixtures", "_ideal", "_truths", "_trials")
    ]
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


def rows_of(results: dict[Setting, dict[str, Any]]) -> list[dict[str, Any]]:
    """Return a row a method, oracle and budget: means over scenes and seeds, and how far seeds are apart."""
    groups: dict[tuple[str, str, int], list[dict[str, Any]]] = {}
    for setting, result in results.items():
        groups.setdefault((setting.method, setting.oracle, setting.calls), []).append(result)
    rows = []
    for (method, name, calls), found in groups.items():
        means = {
            key: round(float(np.mean([one[key] for one in found])), 4)
            for key in ("psnr", "chamfer", "normal_error", "commitment", "seconds", "views", "steps")
        }
        apart = round(float(np.std([one["psnr"] for one in found])), 3)
        rows.append({"method": method, "oracle": name, "calls": calls, **means, "psnr_spread": apart})
    return rows


def todays_calls(rows: Sequence[dict[str, Any]]) -> int | None:
    """Return the fewest calls by which exact scenes are, in the mean, as good as today's after 200."""
    good = [
        row["calls"]
        for row in rows
        if row["oracle"] == "exact" and row["psnr"] >= TODAY["psnr"] and row["chamfer"] <= TODAY["chamfer"]
    ]
    return min(good, default=None)


def best(rows: Sequence[dict[str, Any]]) -> str:
    """Return the method whose exact scenes are nearest to the truth after the most calls, by PSNR."""
    most = max(row["calls"] for row in rows)
    last = [row for row in rows if row["oracle"] == "exact" and row["calls"] == most]
    return str(max(last, key=lambda row: row["psnr"])["method"])


def main(folder: Path) -> dict[str, Any]:
    """Run every trial, write table and picture into `folder`, return the figures."""
    trials = settings(int(os.environ.get("SEEDS") or 1))
    missing = [(setting,) for setting in trials if not place(setting).is_file()]
    at_once(kept, missing, "score distillations")
    rows = rows_of({setting: kept(setting) for setting in trials})
    heads = ("oracle", "method", "calls", "psnr", "chamfer", "normal_error", "commitment")
    table = markdown(heads, [tuple(row[head] for head in heads) for row in rows])
    (folder / "distillation.md").write_text(table, encoding="utf-8")
    curves = [
        Curve(
            method,
            BUDGETS,
            [row["psnr"] for row in rows if (row["method"], row["oracle"]) == (method, "exact")],
        )
        for method in METHODS
        if any((row["method"], row["oracle"]) == (method, "exact") for row in rows)
    ]
    panel = Panel("calls of the denoiser", "PSNR of held-out views [dB]", curves)
    write_fronts(folder / "distillation.png", [panel], "exact scenes: ball, boxes, car")
    by_name = {name: {row["method"]: row for row in rows if row["oracle"] == name} for name in ORACLES}
    return {
        "summary": {
            "calls_for_todays_error": todays_calls(rows),
            "commitment": {name: by_name[name]["sds"]["commitment"] for name in ("apart", "together")},
            "chosen": best(rows),
            "errors": {
                name: {m: [row["psnr"], row["chamfer"], row["commitment"]] for m, row in found.items()}
                for name, found in by_name.items()
            },
        },
        "rows": rows,
    }
