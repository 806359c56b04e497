"""What a scene does not need: every saving with its switch, what it saves and what error it makes.

    make bench ONLY=skip

A row an item of the design's list. `off` and `on` are the cost without and with the saving, in `unit`;
`processor_seconds` the same in processor time, medians measured in turn, where the work is repeatable (after
convergence: of one run each, as `oracle` made them).
`error` is the largest change that the saving makes to what `error_of` says. Rendering is measured on a torus
learned from its ideal denoiser, guidance and models on the default bundle, stages on a draft run. `default`
says whether the product skips it unless told otherwise; what it does not skip, and why, is in `not_done`.
ROUNDS=5 unless said otherwise.
"""

import dataclasses
import hashlib
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks import _plain
from benchmarks._ideal import ideal_guidance, linear_schedule
from benchmarks._savings import Row, table
from benchmarks._stopping import Pair, long_runs, pairs
from benchmarks._timing import in_turn
from benchmarks._trials import RESOLUTION, backgrounds, held_out, job_of
from benchmarks._truths import Truth, analytic_scenes, catalogue_scenes
from benchmarks.oracle import CACHE, SCENES
from pipeline.cameras import Camera
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.distillation import sds_gradient
from pipeline.diffusion.prompts import view_index, view_texts
from pipeline.diffusion.sessions import denoiser, text_encoder, vae_decoder, vae_encoder
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.mesh.coordinates import make_coordinates
from pipeline.mesh.mesh import Mesh
from pipeline.nerf.occupancy import everywhere
from pipeline.nerf.rendering import count_samples, make_rays, render_rays
from pipeline.nerf.scene import Scene
from pipeline.nerf.sketch_loss import LEAST_WEIGHT, nearest_judged, shape_loss
from pipeline.nerf.step import initial_state
from pipeline.nerf.train import train
from pipeline.options.job import Job, resolve
from pipeline.options.models import DEFAULT_MODEL, MODELS
from pipeline.paint.step import Pool, initial_paint, make_pool, paint_step
from pipeline.paint.view_weights import view_weights
from pipeline.run.engine import run_job
from pipeline.sketch.lattice import Sketch, lattice, look_up
from pipeline.sketch.winding import distances, winding_numbers
from pipeline.stages.embed import embed_texts

BUNDLE = MODELS / DEFAULT_MODEL
RUNS = Path("runs/bench")
PROMPT = "a red armchair"
NOT_DONE = {
    "view embeddings never used": "all texts are encoded: which views occur is the training's option, and "
    "the embeddings serve every training of the prompt; see the row for what it costs",
}


def paces(off: Callable[[], Any], on: Callable[[], Any], rounds: int) -> tuple[float, float]:
    """Return the median processor time of both, taken in turn [s]."""
    taken = in_turn({"off": off, "on": on}, rounds)
    return taken["off"].processor_seconds, taken["on"].processor_seconds


def learned(truth: Truth, job: Job, resolution: int) -> Scene:
    """Return a scene learned from the ideal denoiser of `truth`."""
    options = job.train_nerf
    state = initial_state(options, backgrounds(), job.seed)
    train(state, [], options, resolution, ideal_guidance(truth.draw, signal_power=options.signal_power))
    return state.scene


def rendering(scene: Scene, cameras: Sequence[Camera], size: int, rounds: int) -> list[Row]:
    """Return what rendering these views skips: samples outside, empty, hidden."""
    counts, rays = count_samples(scene, cameras, size), make_rays(cameras, size)
    full = dataclasses.replace(scene, occupancy=everywhere())
    ways: list[Callable[[], tuple[torch.Tensor, torch.Tensor]]] = [
        lambda: _plain.render(scene, rays, everything=True)[:2],
        lambda: _plain.render(scene, rays)[:2],
        lambda: _two(render_rays(full, rays, -np.inf)),
        lambda: _two(render_rays(scene, rays, -np.inf)),
        lambda: _two(render_rays(scene, rays)),
    ]
    with torch.no_grad():
        shown = [np.concatenate([light, dark.exp()[:, None]], 1) for light, dark in (way() for way in ways)]
        kinds = (
            ("rays and samples outside the box", "everything= of benchmarks/_plain.py", 0),
            ("empty cells", "occupancy.everywhere()", 2),
            ("samples behind an opaque surface", "log_stop= of render_rays", 3),
        )
        return [
            Row(item, switch, "on", "samples of 12 views", float(more), float(less),
                float(np.abs(shown[way] - shown[way + 1]).max()), "latents and transmittance of a ray",
                paces(ways[way], ways[way + 1], rounds))
            for (item, switch, way), more, less in zip(kinds, counts[:-1], counts[1:], strict=True)
        ]  # fmt: skip


def _two(seen: Any) -> tuple[torch.Tensor, torch.Tensor]:
    return seen.latents, seen.log_transmittance


def after_convergence(scene: str, both: Pair) -> Row:
    """Return what ending a converged run saves; the trials are those of `oracle`."""
    stopped, full = both.stopped[-1], both.whole[-1]
    called = f"{scene}, {full['steps']} steps"
    return Row(f"iterations after convergence: {called}", "train_nerf.convergence", "on",
               "steps", float(full["steps"]), float(stopped["steps"]), full["psnr"] - stopped["psnr"],
               "PSNR of held-out views [dB lost]", (full["seconds"], stopped["seconds"]))  # fmt: skip


def guidance(rounds: int, size: int = RESOLUTION) -> Row:
    """Return what guidance 1 saves: the pass without the text."""
    rng = np.random.default_rng(0)
    latents, noise = rng.standard_normal((2, 4, 4, size, size), np.float32)
    timesteps = np.full(4, 600)
    views = open_bundle(BUNDLE, verify=False).views
    with denoiser(BUNDLE / "unet", views=views) as denoise, text_encoder(BUNDLE / "text_encoder") as encode:
        told, without = embed_texts([PROMPT, ""], load_tokenizer(BUNDLE / "tokenizer"), encode)

        def step(scale: float) -> np.ndarray:
            found = sds_gradient(
                latents, denoise, linear_schedule(), timesteps, noise, np.stack([told] * 4), without, scale
            )
            return found.gradient

        return Row(
            "unconditional pass when guidance is 1", "guidance_scale: 1", "on", "rows denoised a step",
            8.0, 4.0, float(np.abs(step(1 + 1e-9) - step(1)).max()), "gradient of a latent",
            paces(lambda: step(1 + 1e-9), lambda: step(1), rounds),
        )  # fmt: skip


def unused_texts(job: Job, rounds: int) -> Row:
    """Return what the texts of views would save that training never looks from."""
    polar = np.radians(np.linspace(*job.train_nerf.polar_degrees, 64))
    azimuth, polar = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 2 * np.pi, 64), polar))
    words = open_bundle(BUNDLE, verify=False).view_prompts
    texts = view_texts(PROMPT, words)
    used = [texts[view] for view in np.unique(view_index(words, azimuth, polar))]
    tokenizer = load_tokenizer(BUNDLE / "tokenizer")
    with text_encoder(BUNDLE / "text_encoder") as encode:
        pace = paces(
            lambda: embed_texts(texts, tokenizer, encode),
            lambda: embed_texts(used, tokenizer, encode),
            rounds,
        )
    return Row("view embeddings never used", "none", "off", "texts encoded", float(len(texts)),
               float(len(used)), 0.0, "embeddings that are read", pace)  # fmt: skip


def texels(truth: Truth, job: Job, resolution: int, rounds: int) -> list[Row]:
    """Return what leaving out unseen texels saves, and using the texture coordinates that a mesh has."""
    atlas, options = job.prepare.resolution, job.train_paint
    bare = Mesh(truth.mesh.vertices, truth.mesh.faces)
    mesh = make_coordinates(bare, atlas, atlas // 64, rewrap=True)[0]
    seen = make_pool(mesh, options, options.texture, resolution, job.seed)
    views = [
        [view_weights(mesh, c, resolution, options.texture, options.supersampling) for c in group[0]]
        for group in seen.groups
    ]
    every = Pool(seen.groups, views, np.arange(options.texture**2), resolution)
    state = {id(pool): initial_paint(options, pool, backgrounds(), job.seed) for pool in (seen, every)}
    for one in state.values():
        one.rng = np.random.default_rng(job.seed)  # the starts drew differently many numbers
    painter = ideal_guidance(truth.draw, signal_power=options.signal_power)

    def step(pool: Pool) -> np.ndarray:
        paint_step(state[id(pool)], options, pool, lambda latents, batch: latents)
        return state[id(pool)].colours.detach().numpy()

    for pool in (seen, every):
        paint_step(state[id(pool)], options, pool, painter)
    error = float(np.abs(step(every)[seen.seen] - step(seen)).max())
    pace = paces(lambda: step(every), lambda: step(seen), rounds)
    unwrapping = paces(
        lambda: make_coordinates(mesh, atlas, atlas // 64, rewrap=True),
        lambda: make_coordinates(mesh, atlas, atlas // 64, rewrap=False),
        1,
    )
    kept = make_coordinates(mesh, atlas, atlas // 64, rewrap=False)[0]
    moved = float(np.abs(kept.uv - mesh.uv).max()) if kept.uv is not None and mesh.uv is not None else 1.0
    return [
        Row("texels that no view sees or no face uses", "painting.make_pool: its columns", "on",
            "colours optimised", float(options.texture**2), float(len(seen.seen)), error,
            "latents of a texel", pace),
        Row("unwrapping a mesh with good UVs", "prepare.uv: rewrap", "on", "processor seconds", *unwrapping,
            moved, "texture coordinates", unwrapping),
    ]  # fmt: skip


def models() -> Row:
    """Return what opening only the model that training asks for saves."""
    opened: dict[str, Callable[[Path], AbstractContextManager[Any]]] = {
        "unet": denoiser,
        "text_encoder": text_encoder,
        "vae_decoder": vae_decoder,
        "vae_encoder": vae_encoder,
    }
    seconds = {}
    for name, open_one in opened.items():
        began = time.process_time()
        with open_one(BUNDLE / name):
            seconds[name] = time.process_time() - began
    return Row("refining, encoding and loading models nobody asked for", "REFINE, SKETCH, MESH", "on",
               "processor seconds of opening models in training", sum(seconds.values()), seconds["unet"], 0.0,
               "the models that are used")  # fmt: skip


def sketch_band(truth: Truth, sigma: float, points: int, cells: int, rounds: int) -> Row:
    """Return what not asking for the winding number near the sketch's surface saves."""
    places, shape = lattice(cells), (cells + 1,) * 3
    vertices = truth.mesh.vertices.astype(np.float64)
    sketch = Sketch(
        winding_numbers(vertices, truth.mesh.faces, places).astype(np.float32).reshape(shape),
        distances(vertices, truth.mesh.faces, places).astype(np.float32).reshape(shape),
    )
    rng = np.random.default_rng(0)
    samples = rng.uniform(-1, 1, (points, 3)).astype(np.float32)
    density = rng.exponential(2, points).astype(np.float32)
    away = look_up(sketch, samples)[1]
    counts = [float((away >= least).sum()) for least in (0.0, nearest_judged(sigma))]
    losses, gradients = zip(
        *(shape_loss(sketch, sigma, samples, density, least) for least in (0.0, LEAST_WEIGHT)), strict=True
    )
    lost = abs(losses[0] - losses[1]) / losses[0]
    push = np.abs(gradients[0] - gradients[1]).max() / np.abs(gradients[0]).max()
    pace = paces(
        lambda: shape_loss(sketch, sigma, samples, density, 0.0),
        lambda: shape_loss(sketch, sigma, samples, density),
        rounds,
    )
    return Row("distance to a sketch inside the band where its weight vanishes",
               "least_weight= of shape_loss", "on", "points judged", counts[0], counts[1], lost,
               f"share of the shape loss; {push:.1g} of the largest gradient", pace)  # fmt: skip


def unchanged_stages(runs: Path) -> Row:
    """Return what a second call of the same job saves."""
    job = resolve({"PROMPT": PROMPT, "QUALITY": "draft"})
    threads = len(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory(dir=runs) as fresh:
        taken, made = [], []
        for _ in range(2):
            began = time.monotonic()
            run = run_job(job, Path(fresh), threads)
            taken.append(time.monotonic() - began)
            made.append(hashlib.sha256((run / "asset.glb").read_bytes()).hexdigest())
    return Row("stages whose inputs did not change", "delete the run", "on", "seconds of a draft run",
               taken[0], taken[1], float(made[0] != made[1]), "asset.glb: 0 is the same bytes")  # fmt: skip


def main(folder: Path) -> dict[str, Any]:
    """Measure every item, write the table into `folder`, return the figures."""
    rounds = int(os.environ.get("ROUNDS") or 5)
    truth = next(truth for truth in analytic_scenes() if truth.name == "torus")
    job = job_of("draft")
    RUNS.mkdir(parents=True, exist_ok=True)
    long = long_runs([*analytic_scenes(), *catalogue_scenes(SCENES)])
    rows = [
        *rendering(learned(truth, job, RESOLUTION), held_out(job.train_nerf), RESOLUTION, rounds),
        *(
            after_convergence(run.truth.name, both)
            for run, both in zip(long, pairs(long, CACHE, RESOLUTION), strict=True)
        ),
        guidance(rounds),
        unused_texts(job, rounds),
        *texels(truth, job, RESOLUTION, rounds),
        models(),
        sketch_band(truth, job.train_nerf.sigma_s, 100_000, job.sketch_field.cells, rounds),
        unchanged_stages(RUNS),
    ]
    figures = [row.figures() for row in rows]
    (folder / "skip.md").write_text(table(figures), encoding="utf-8")
    return {
        "summary": {row["item"]: {"saving": row["saving"], "error": row["error"]} for row in figures},
        "rows": figures,
        "not_done": NOT_DONE,
    }
