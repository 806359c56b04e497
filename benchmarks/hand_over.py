"""What a start from a weaker model saves: calls of the exact denoiser, and what is lost on the way over.

    make bench ONLY=hand-over

Oracles: a scene is learned from the ideal denoiser of its *blurred* pictures first (a draft of 50 calls),
then goes on with the exact one, which sets out from the noise level `strength` (options.start.started) with
that share of 200 calls. `psnr` of held-out views [dB, latents of range 2], `chamfer` [scene units].
`exact_calls_share`: the share of 200 exact calls after which the views of every scene are as good as after
200 exact calls from nothing, the first of `STRENGTHS` that suffices; None if none does.

Latents: a scene of the bundled model is handed over to a bundle of other latents, of another size (a linear
autoencoder of 2 x 2 pixels, made here): `handover_psnr` of its views, decoded by the second model, against
those that the first one decodes [dB, colours in [0, 1]], before the first call.

Results are kept under runs/bench/hand-over, by options and source: a second call only does what is missing.
"""

import dataclasses
import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter

from benchmarks._hand_over_latents import handed_over
from benchmarks._ideal import Draw, ideal_guidance
from benchmarks._pool import at_once
from benchmarks._tables import markdown
from benchmarks._trials import RESOLUTION, backgrounds, held_out, job_of, shape_error, views_psnr
from benchmarks._truths import Truth, analytic_scenes
from pipeline.cameras import Camera
from pipeline.nerf import train as nerf_train
from pipeline.nerf.scene import Scene, load_scene, save_scene
from pipeline.nerf.start import STARTED_COOLING, started_state
from pipeline.nerf.step import State, initial_state
from pipeline.options.job import Job
from pipeline.options.quality import HAND_OVER
from pipeline.options.schema import build, plain
from pipeline.options.start import StartFit, started
from pipeline.run import staleness

CACHE = Path("runs/bench/hand-over")
SCENES = ("ball", "boxes")
BLUR = 1.5
"""Standard deviation of what the weak denoiser believes in [latent pixels]."""
FROM_NOTHING = 200
"""Calls of the exact denoiser, of two updates each, that a hand-over is compared with."""
STRENGTHS = (0.25, 0.5)
NOTHING, DRAFT = "from nothing", "the weak one's draft"


def blurred(draw: Draw) -> Draw:
    """Return a scene that is seen out of focus."""

    def picture(camera: Camera, size: int, background: Float[np.ndarray, " 4"]) -> Float[np.ndarray, "4 h w"]:
        return np.asarray(gaussian_filter(draw(camera, size, background), (0, BLUR, BLUR), mode="nearest"))

    return picture


def learn(truth: Truth, job: Job, draw: Draw, state: State, cooling: float = 0.0) -> dict[str, Any]:
    """Train a state with the ideal denoiser of what `draw` shows; return its errors against the truth."""
    options = job.train_nerf
    guidance = ideal_guidance(
        draw, signal_power=options.signal_power, clean_clamp=options.predicted_clean_clamp
    )
    nerf_train.train(state, [], options, RESOLUTION, guidance, cooling=cooling)
    psnr = views_psnr(state.scene, truth, held_out(options), RESOLUTION)
    return {"calls": state.step, "psnr": round(psnr, 3), **shape_error(state.scene, truth, job)}


def set_out_from(job: Job, scene: Scene, strength: float) -> tuple[Job, State]:
    """Return the job and the state of a training that goes on from a scene."""
    options = started(job.train_nerf, build(StartFit, HAND_OVER["start_fit"]), strength)
    return dataclasses.replace(job, train_nerf=options), started_state(
        scene, options, backgrounds(), job.seed
    )


def measure(name: str) -> dict[str, dict[str, Any]]:
    """Return the rows of a scene, by what was done."""
    truth = next(truth for truth in analytic_scenes() if truth.name == name)
    draft, standard = (
        dataclasses.replace(job, train_nerf=dataclasses.replace(job.train_nerf, checkpoint_every=100_000))
        for job in (job_of("draft"), job_of("standard"))
    )
    today = dataclasses.replace(
        standard, train_nerf=dataclasses.replace(standard.train_nerf, steps=FROM_NOTHING, updates_per_call=2)
    )

    def from_nothing(job: Job, draw: Draw, scene_file: Path | None = None) -> dict[str, Any]:
        state = initial_state(job.train_nerf, backgrounds(), job.seed)
        row = learn(truth, job, draw, state)
        if scene_file is not None:
            save_scene(scene_file, state.scene)
        return row

    scene_file = place(name, DRAFT, draft, ".npz")
    rows = {
        DRAFT: kept(name, DRAFT, draft, lambda: from_nothing(draft, blurred(truth.draw), scene_file)),
        NOTHING: kept(name, NOTHING, today, lambda: from_nothing(today, truth.draw)),
    }
    for strength in STRENGTHS:

        def gone_on(strength: float = strength) -> dict[str, Any]:
            job, state = set_out_from(standard, load_scene(scene_file), strength)
            return learn(truth, job, truth.draw, state, STARTED_COOLING)

        said = f"strength {strength:g}"
        rows[said] = kept(name, said, standard, gone_on)
        if rows[said]["psnr"] >= rows[NOTHING]["psnr"]:
            break
    return rows


def kept(scene: str, done: str, job: Job, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return a row from the cache, or make it."""
    path = place(scene, done, job, ".json")
    if not path.is_file():
        row = make()
        path.with_suffix(".partial").write_text(json.dumps(row) + "\n", encoding="utf-8")
        path.with_suffix(".partial").replace(path)
    return dict(json.loads(path.read_text(encoding="utf-8")))


def place(scene: str, done: str, job: Job, suffix: str) -> Path:
    """Return the file of a row, named after everything that it depends on."""
    CACHE.mkdir(parents=True, exist_ok=True)
    source = [
        staleness.code(f"pipeline.{module}")[0] for module in ("nerf.train", "nerf.start", "options.start")
    ]
    asked = [scene, done, plain(job), source, BLUR, HAND_OVER]
    digest = hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()[:16]
    return CACHE / f"{scene}-{done.replace(' ', '-')}-{digest}{suffix}"


def calls_share(measured: dict[str, dict[str, dict[str, Any]]]) -> float | None:
    """Return the least share of the calls from nothing after which every scene is as good."""
    shares = []
    for rows in measured.values():
        wanted = rows[NOTHING]
        good = [
            row["calls"]
            for done, row in rows.items()
            if done.startswith("strength") and row["psnr"] >= wanted["psnr"]
        ]
        if not good:
            return None
        shares.append(min(good) / wanted["calls"])
    return max(shares)


def main(folder: Path) -> dict[str, Any]:
    """Measure; write the table."""
    measured = dict(zip(SCENES, at_once(measure, [(name,) for name in SCENES], "scenes"), strict=True))
    over = handed_over(CACHE)
    heads = ("scene", "done", "calls of that denoiser", "PSNR [dB]", "Chamfer")
    lines = [
        (scene, done, row["calls"], row["psnr"], row["chamfer"])
        for scene, rows in measured.items()
        for done, row in rows.items()
    ]
    (folder / "hand-over.md").write_text(markdown(heads, lines) + "\n", encoding="utf-8")
    summary = {"exact_calls_share": calls_share(measured), "handover_psnr": over["psnr"]}
    return {"summary": summary, "scenes": measured, "latents": over}
