"""Which ways of guiding are worth their time? One option changed at a time, on the same prompts.

    make bench ONLY=guidance

`agreement`: the probability that the classifier of the default model's benchmark gives the prompt's noun.
`front_from_behind`: two faces. The denoiser itself says whether a view from behind looks more like "front
view" than "back view": noise is added to the rendered latents, and the text under which it is removed better
has the vote (Li et al. 2023, a diffusion model is a zero-shot classifier); the share of votes for the front.
`saturation`: mean HSV saturation of the object. `seconds`: of a step, relative to the base, see `paces`.
"""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks import _scenes as scenes
from benchmarks._pool import at_once
from benchmarks._tables import markdown
from benchmarks.refine import rounded
from pipeline.cameras import orbit_camera
from pipeline.diffusion.prompts import view_index
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import denoiser
from pipeline.diffusion.view_gradient import Embeddings, load_embeddings
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import load_scene
from pipeline.progress import Progress

PROMPT_COUNT = 4
ROUNDS, PACED_STEPS = 7, 12
"""Short trainings of every option that tell how long a step takes."""
NOISE_LEVELS, DRAWS = (400, 550, 700), 4
BEHIND = np.radians([140.0, 165.0, 195.0, 220.0])
"""As many as a model sees together, told no cameras: its words alone are asked."""
OPTIONS: dict[str, dict[str, Any]] = {
    "base": {},
    "interpolated": {"view_text": "interpolated"},
    "perp-neg": {"perp_neg": 1.0},
    "both": {"view_text": "interpolated", "perp_neg": 1.0},
    "rescale 0.5": {"guidance_rescale": 0.5},
    "clip 0.5": {"gradient_clip": 0.5},
    "clip 0.5 to 2": {"gradient_clip": 0.5, "gradient_clip_end": 2.0},
    "sqrt annealing": {"timestep_annealing": "sqrt"},
    "no annealing": {"timestep_max": 0.98, "timestep_max_end": 0.98},
    "guidance 30 to 12": {"guidance_scale": 30.0, "guidance_scale_end": 12.0},
}


def front_from_behind(scene_file: Path, embeddings: Embeddings) -> float:
    """Return the share of votes by which views from behind are taken for the front, in [0, 1]."""
    bundle = scenes.model()
    schedule, scene = load_schedule(bundle.path / "scheduler"), load_scene(scene_file)
    cameras = [orbit_camera(a, np.radians(75), 2.5, np.radians(40)) for a in BEHIND]
    latents = render_views(scene, cameras, bundle.latent_size).latents
    level = np.full(2, np.radians(75))
    front, back = embeddings.cond[view_index(embeddings.view_prompts, np.array([0, np.pi]), level)]
    votes = []
    with denoiser(bundle.path / "unet", views=bundle.views) as denoise:
        for number, timestep in enumerate(NOISE_LEVELS * DRAWS):
            noise = np.random.default_rng(number).standard_normal(latents.shape, np.float32)
            timesteps = np.full(len(latents), timestep)
            noisy = schedule.add_noise(latents, noise, timesteps)

            def error(
                text: Float[np.ndarray, "l d"], x: np.ndarray = noisy, t: np.ndarray = timesteps
            ) -> np.ndarray:
                told = denoise(x, t, np.broadcast_to(text, (len(x), *text.shape)))
                return np.square(schedule.to_clean(told, x, t) - latents).mean((1, 2, 3))

            votes.append(error(front) < error(back))
    return float(np.mean(votes))


def judged(prompt: str, name: str) -> tuple[dict[str, Any], np.ndarray]:
    """Train a prompt with an option; return its figures and pictures."""
    work = scenes.WORK / "guidance" / prompt.replace(" ", "-") / name.replace(" ", "-")
    scenes.train(scenes.make_job(prompt, work, {"train_nerf": OPTIONS[name]}), work)
    with scenes.open_decoder() as decode:
        looks = scenes.look(work / "field.npz", decode)
    judge = scenes.judge()
    row = {
        "prompt": prompt,
        "option": name,
        "agreement": scenes.agreement(judge, looks, prompt),
        "rank": scenes.rank(judge, looks, prompt),
        "front_from_behind": front_from_behind(work / "field.npz", load_embeddings(work / "embeddings.npz")),
        "saturation": scenes.saturation(looks),
    }
    return row, scenes.strip(looks)


def paces(prompt: str) -> dict[str, float]:
    """Return the time of a step with every option, relative to the first of them: short trainings in turn,
    with all threads and nothing else going on; the median over rounds of what each took of its own round's.
    """
    taken: dict[str, list[float]] = {name: [] for name in OPTIONS}
    with Progress("paces", ROUNDS * len(OPTIONS)) as progress:
        for turn in range(ROUNDS):
            for name, options in OPTIONS.items():
                work = scenes.WORK / "guidance" / "paces" / f"{name}-{turn}".replace(" ", "-")
                shutil.rmtree(work, ignore_errors=True)
                job = scenes.make_job(prompt, work, {"train_nerf": {**options, "steps": PACED_STEPS}})
                scenes.train(job, work)
                taken[name].append(scenes.step_seconds(work / "training.json", PACED_STEPS // 3))
                progress.update(sum(map(len, taken.values())))
    base = np.array(next(iter(taken.values())))
    return {name: float(np.median(np.array(seconds) / base)) for name, seconds in taken.items()}


def main(folder: Path) -> dict[str, Any]:
    """Train every prompt with every option; write a sheet of pictures, an option a column."""
    calls = [(prompt, name) for prompt in scenes.chosen(PROMPT_COUNT) for name in OPTIONS]
    results = at_once(judged, calls, "scenes")
    rows = [row for row, _ in results]
    pictures = [(f"{row['prompt']}: {row['option']}", strip) for row, strip in results]
    scenes.contact_sheet(folder / "guidance.png", pictures, len(OPTIONS))
    table = {name: figures([r for r in rows if r["option"] == name]) for name in OPTIONS}
    for name, pace in paces(calls[0][0]).items():
        table[name]["seconds"] = round(pace, 3)
    heads = list(table["base"])
    lines = [(name, *(row[head] for head in heads)) for name, row in table.items()]
    (folder / "guidance.md").write_text(markdown(("option", *heads), lines), encoding="utf-8")
    return {"summary": table, "scenes": rows}


def figures(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Return the means over prompts."""
    names = ("agreement", "front_from_behind", "saturation")
    mean = {name: float(np.mean([row[name] for row in rows])) for name in names}
    return rounded({**mean, "noun_top5": float(np.mean([row["rank"] <= 5 for row in rows]))})
