"""The paper's claim of efficiency: distil in latents, or in RGB from the first step? (15 against 30 minutes
there.)

    make bench ONLY=latent-vs-rgb

The same prompts, the same number of steps and the same options, three ways: `latent`; `refined`, latent and
then RGB refinement; `rgb`, an RGB field from the first step, its pictures encoded at every step and the
gradient pulled back through the encoder (or, without vae_encoder_vjp, towards decoded pictures). Seconds are
those of all steps, run in turn on the same machine; agreement is the classifier's probability of the prompt's
noun. Preparing texts, which all three share, and making a mesh are left out.
"""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import _scenes as scenes
from benchmarks._pool import at_once
from benchmarks.refine import rounded
from pipeline.diffusion.view_gradient import flat_backgrounds, load_embeddings
from pipeline.nerf.scene import save_scene
from pipeline.nerf.step import initial_state
from pipeline.options.distillation import Distillation
from pipeline.options.job import Job

PROMPT_COUNT = 4
WAYS = ("latent", "refined", "rgb")


def from_the_first_step(job: Job) -> Job:
    """Return the job whose refinement is a whole training: the options of the latent one, its rates, no
    fit."""
    train, names = job.train_nerf, {spec.name for spec in dataclasses.fields(Distillation)} - {"resolution"}
    shared: dict[str, Any] = {name: getattr(train, name) for name in names}
    rates: dict[str, Any] = {
        "learning_rate": train.learning_rate,
        "grid_learning_rate": train.grid_learning_rate,
    }
    whole = dataclasses.replace(job.refinement, **shared, **rates, fit_steps=0, steps=train.steps)
    return dataclasses.replace(job, refinement=whole)


def judged(prompt: str) -> list[tuple[dict[str, Any], np.ndarray]]:
    """Train a prompt in every way; return figures and pictures of each."""
    judge, work = scenes.judge(), scenes.WORK / "latent-vs-rgb" / prompt.replace(" ", "-")
    job = scenes.make_job(prompt, work, {})
    scenes.train(job, work)
    scenes.refined(job, work)
    pure = work / "rgb"
    whole = from_the_first_step(scenes.make_job(prompt, pure, {}))
    pure.joinpath("embeddings.npz").write_bytes((work / "embeddings.npz").read_bytes())
    backgrounds = flat_backgrounds(load_embeddings(work / "embeddings.npz"))
    save_scene(pure / "field.npz", initial_state(whole.train_nerf, backgrounds, whole.seed).scene)
    scenes.refined(whole, pure)
    latent = scenes.total_seconds(work / "training.json")
    seconds = {
        "latent": latent,
        "refined": latent + scenes.total_seconds(work / "refinement.json"),
        "rgb": scenes.total_seconds(pure / "refinement.json"),
    }
    with scenes.open_decoder() as decode:
        looks = {"latent": scenes.look(work / "field.npz", decode)}
    looks |= {"refined": scenes.look(work / "field_rgb.npz"), "rgb": scenes.look(pure / "field_rgb.npz")}
    found = []
    for way in WAYS:
        row = {
            "prompt": prompt,
            "way": way,
            "seconds": seconds[way],
            "agreement": scenes.agreement(judge, looks[way], prompt),
            "rank": scenes.rank(judge, looks[way], prompt),
        }
        found.append((row, scenes.strip(looks[way])))
    return found


def main(folder: Path) -> dict[str, Any]:
    """Train every prompt in every way; write a sheet of pictures."""
    calls = [(prompt,) for prompt in scenes.chosen(PROMPT_COUNT)]
    results = [one for found in at_once(judged, calls, "prompts, three ways each") for one in found]
    rows = [row for row, _ in results]
    pictures = [(f"{row['prompt']}: {row['way']}, rank {row['rank']}", strip) for row, strip in results]
    scenes.contact_sheet(folder / "latent-vs-rgb.png", pictures, len(WAYS))
    summary: dict[str, float] = {}
    for way in WAYS:
        mine = [r for r in rows if r["way"] == way]
        summary[f"seconds_{way}"] = float(np.mean([r["seconds"] for r in mine]))
        summary[f"agreement_{way}"] = float(np.mean([r["agreement"] for r in mine]))
        summary[f"noun_top5_{way}"] = float(np.mean([r["rank"] <= 5 for r in mine]))
    summary["rgb_over_latent"] = summary["seconds_rgb"] / summary["seconds_latent"]
    return {"summary": rounded(summary), "scenes": rows}
