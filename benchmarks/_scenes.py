"""What the benchmarks of guidance and refinement share: scenes trained stage by stage, and figures of their
renders.

Scenes are kept under build/scenes/<benchmark>/<name>, so that a second call trains only what is missing.
SIZE=tiny in the environment tries a benchmark: few prompts, few steps, meaningless figures.
"""

import colorsys
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from jaxtyping import Float
from scipy.ndimage import binary_erosion

from benchmarks.default_model import asked_for, contact_sheet
from export.everyday_objects.networks.judge import Judge, judge_images, load_judge
from export.everyday_objects.train.train_judge import JUDGE
from pipeline.cameras import ring
from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.diffusion.sessions import Decode, vae_decoder
from pipeline.files import file_sha256
from pipeline.nerf.refining import render_rgb
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import load_scene
from pipeline.nerf.views import decoded_views
from pipeline.options.job import Job, resolve
from pipeline.options.models import bundle_folder
from pipeline.run import staleness
from pipeline.run.chain import stage_options
from pipeline.run.stage import Context
from pipeline.stages import embed, refine, train_nerf

WORK = Path("build/scenes")
TINY = os.environ.get("SIZE") == "tiny"
VIEWS, GREY = 8, 0.85
DENSE = 0.9
# What settings are chosen by; the default model's benchmark has others.
PROMPTS = (
    "a wooden table", "a blue lamp", "a brown horse", "a red bench", "a blue car", "a green sofa",
    "a yellow mushroom", "a purple house",
)  # fmt: skip
__all__ = ["contact_sheet"]


class Looks(NamedTuple):
    """Pictures around a scene."""

    pictures: Float[np.ndarray, "8 p p 3"]
    """Over a light grey."""
    opacity: Float[np.ndarray, "8 p p"]


def model() -> Bundle:
    """Return the bundle that is measured: MODEL in the environment, else the default one."""
    return open_bundle(bundle_folder(os.environ.get("MODEL") or "everyday-objects"), verify=False)


def chosen(count: int) -> list[str]:
    """Return so many of the prompts, the same ones every time."""
    count = 1 if TINY else count
    return [PROMPTS[i * len(PROMPTS) // count] for i in range(count)]


def make_job(prompt: str, folder: Path, sections: Mapping[str, Any]) -> Job:
    """Return a draft job with these sections on top."""
    folder.mkdir(parents=True, exist_ok=True)
    asked = {"prompt": prompt, "quality": "draft", "model": str(model().path.absolute()), **sections}
    if TINY:
        asked["train_nerf"] = {**asked.get("train_nerf", {}), "steps": 3}
        asked["refinement"] = {**asked.get("refinement", {}), "fit_steps": 1, "steps": 2}
    (folder / "asked.yaml").write_text(yaml.safe_dump(asked), encoding="utf-8")
    return resolve({"JOB": str(folder / "asked.yaml")})


def stage(
    name: str,
    main: Callable[[Context], None],
    job: Job,
    folder: Path,
    files: dict[str, str],
    given: Mapping[str, Path] | None = None,
    reads: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Run a stage's main in `folder` unless its figures are there for this very source, options, bundle and
    files; return the figures.

    `files`: outputs by their names; inputs are the bundle's folders, what is `given`, and what earlier stages
    wrote, of which the stage `reads` these files.
    """
    bundle, done = model().path, folder / f"{name}.json"
    sources = [bundle / "bundle.json", *(given or {}).values(), *(folder / file for file in reads)]
    inputs = {str(path): file_sha256(path) for path in sources}
    asked = staleness.key(stage_options(job, name), f"pipeline.stages.{name}", inputs)
    if done.exists() and (stored := json.loads(done.read_text(encoding="utf-8"))).get("asked") == asked:
        return dict(stored["metrics"])
    graphs = {entry.name: entry for entry in bundle.iterdir() if entry.is_dir()}
    made = {"embeddings": folder / "embeddings.npz", "scene": folder / "field.npz"}
    outputs = {label: folder / file for label, file in files.items()}
    scratch = folder / "scratch" / name
    scratch.mkdir(parents=True, exist_ok=True)
    for old in scratch.glob("*.checkpoint"):
        old.unlink()
    context = Context(job, {**graphs, **made, **(given or {})}, outputs, scratch)
    main(context)
    done.write_text(json.dumps({"asked": asked, "metrics": context.metrics}), encoding="utf-8")
    return context.metrics


def train(job: Job, folder: Path, given: Mapping[str, Path] | None = None) -> dict[str, Any]:
    """Embed and train a latent scene: field.npz, training.json; `given`: files of the user, for `embed`."""
    stage("embed", embed.main, job, folder, {"embeddings": "embeddings.npz"}, given)
    files = {"scene": "field.npz", "history": "training.json"}
    return stage("train_nerf", train_nerf.main, job, folder, files, reads=("embeddings.npz",))


def refined(job: Job, folder: Path) -> dict[str, Any]:
    """Refine the scene of `train`: field_rgb.npz, refinement.json."""
    files = {"scene": "field_rgb.npz", "history": "refinement.json"}
    return stage("refine", refine.main, job, folder, files, reads=("embeddings.npz", "field.npz"))


def look(path: Path, decode: Decode | None = None) -> Looks:
    """Return a scene's decoded (a latent one) or rendered (an RGB one) views."""
    bundle, scene = model(), load_scene(path)
    cameras = ring(VIEWS, np.radians(75), 2.5, np.radians(40))
    if scene.rgb is not None:
        colours, opacity = render_rgb(scene, cameras, bundle.image_size)
        pictures = colours.transpose(0, 2, 3, 1).clip(0, 1) + (1 - opacity[..., None]) * GREY
        return Looks(pictures.clip(0, 1), opacity)
    assert decode is not None
    opacity = render_views(scene, cameras, bundle.image_size, np.zeros(4, np.float32)).opacity
    decoded = np.stack(decoded_views(scene, cameras, bundle.latent_size, decode))
    return Looks(decoded * opacity[..., None] + (1 - opacity[..., None]) * GREY, opacity)


def open_decoder() -> Any:
    """Give the bundle's decoder for a `with` block."""
    bundle = model()
    return vae_decoder(bundle.path / "vae_decoder", bundle.latent_scale)


def judge() -> Judge:
    """Return the classifier of the default model's benchmark."""
    return load_judge(JUDGE)[0]


def rank(judged: Judge, looks: Looks, prompt: str) -> int:
    """Return the place of the prompt's noun among all kinds, 1 the first, by the mean over the views."""
    kinds = judge_images(judged, looks.pictures.astype(np.float32))[0].mean(0)
    return int((kinds > kinds[asked_for(prompt).kind]).sum()) + 1


def agreement(judged: Judge, looks: Looks, prompt: str) -> float:
    """Return the probability of the prompt's noun, mean over the views."""
    kinds = judge_images(judged, looks.pictures.astype(np.float32))[0]
    return float(kinds[:, asked_for(prompt).kind].mean())


def inside(looks: Looks) -> np.ndarray:
    """Return where the object is opaque, three pixels from its outline, (8, p, p)."""
    return np.stack([binary_erosion(mask, iterations=3) for mask in looks.opacity > DENSE])


def sharpness(looks: Looks) -> float:
    """Return the gradient energy of the object's colours: mean squared difference of neighbours, times
    1000."""
    mask = inside(looks)
    across = np.square(np.diff(looks.pictures, axis=2)).sum(-1)[mask[:, :, 1:] & mask[:, :, :-1]]
    down = np.square(np.diff(looks.pictures, axis=1)).sum(-1)[mask[:, 1:] & mask[:, :-1]]
    return float(1000 * np.concatenate([across, down]).mean()) if len(across) + len(down) else 0.0


def saturation(looks: Looks) -> float:
    """Return the mean saturation (HSV) of the object's colours, in [0, 1]."""
    pixels = looks.pictures[inside(looks)]
    return float(np.mean([colorsys.rgb_to_hsv(*p)[1] for p in pixels[::17]])) if len(pixels) else 0.0


def step_seconds(history: Path, first: int = 0) -> float:
    """Return the median time of a step from `first` on [s]."""
    rows = json.loads(history.read_text(encoding="utf-8"))[first:]
    return float(np.median([sum(row["seconds"].values()) for row in rows]))


def total_seconds(history: Path) -> float:
    """Return the time of all steps [s]."""
    return float(sum(sum(row["seconds"].values()) for row in json.loads(history.read_text(encoding="utf-8"))))


def strip(looks: Looks) -> np.ndarray:
    """Return four of the views for a contact sheet, uint8."""
    return np.round(looks.pictures[::2] * 255).clip(0, 255).astype(np.uint8)
