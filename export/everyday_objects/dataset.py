"""Pictures and captions: random object, look, camera, light and background, in numbered shards.

`python -m export.everyday_objects.dataset WORK --shards 8` writes WORK/shards/NNN.npy (n, 128, 128, 3) uint8
and NNN.json (captions and what each picture shows), besides WORK/held_out of objects kept from training and
WORK/judge, other pictures of the training objects for the classifier that judges the model. A shard depends
on its folder and number alone; finished shards are kept.
"""

import argparse
import json
import multiprocessing
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from export.everyday_objects import captions, furniture, procedural
from export.everyday_objects.catalogue import Model, load_model, read_catalogue
from export.everyday_objects.nouns import NOUNS, Noun, noun_of
from export.everyday_objects.render import Light, render
from pipeline.scene.cameras import orbit_camera
from pipeline.stage import Progress

IMAGE_SIZE = 128
SHARD_SIZE, HELD_OUT_SIZE = 8000, 1000
JUDGE_FIRST = 900  # shards from here on are never trained on by the model, only by its judge
# The cameras of the pipeline (bundle.json hands them on): radius [scene units], angles [deg].
RADIUS_RANGE, FOV_RANGE = (2.3, 2.7), (37.0, 43.0)
PROCEDURAL_SHARE = 0.8  # of the pictures of nouns that have both sources
REPAINTED_SHARE = 0.4  # of the procedural furniture: in one colour throughout, or in wood


class Source(NamedTuple):
    """All there is of one noun."""

    noun: Noun
    models: tuple[Model, ...]


class Sample(NamedTuple):
    """One training picture."""

    image: np.ndarray
    """(size, size, 3) float32 in [0, 1]"""
    noun: Noun
    look: str
    azimuth: float
    polar: float


def split_entries(work: Path) -> tuple[dict[str, list], dict[str, list]]:
    """Return catalogue entries by noun: those to train on and the held-out ones (every fourth or later one
    from 4 up).

    Whole objects are held out, one in eight but at least one, of every noun with four models or more.
    """
    train: dict[str, list] = {n.words[0]: [] for n in NOUNS}
    for entry in read_catalogue(work / "catalogue"):
        if noun := noun_of(entry.name):
            train[noun.words[0]].append(entry)
    held_out = {}
    for word, entries in train.items():
        if len(entries) >= 4:
            held_out[word] = entries[3::8]
            train[word] = [e for i, e in enumerate(entries) if i % 8 != 3]
    return train, held_out


def load_sources(entries: dict[str, list]) -> list[Source]:
    """Load the models of every noun that has any, or has a procedural maker."""
    sources = [Source(n, tuple(load_model(e) for e in entries.get(n.words[0], ()))) for n in NOUNS]
    return [s for s in sources if s.models or s.noun.words[0] in procedural.MAKERS]


def recolour(rng: np.random.Generator, model: Model) -> tuple[Model, np.ndarray, str]:
    """Paint a model's main materials in one named colour or in wood; return it, the grain strengths, and the
    word.
    """
    area = face_areas(model)
    share = np.bincount(model.material, area, minlength=len(model.colours)) / area.sum()
    order = np.argsort(-share, kind="stable")
    painted = order if rng.random() < 0.4 else order[: int(np.searchsorted(np.cumsum(share[order]), 0.6)) + 1]
    wood = np.zeros(len(model.colours), np.float32)
    word = "wooden" if rng.random() < 0.12 else captions.COLOURS[rng.integers(len(captions.COLOURS))]
    target = captions.draw_colour(rng, "brown" if word == "wooden" else word)
    if word == "wooden":
        target = np.array([0.62, 0.42, 0.24], np.float32) * rng.uniform(0.65, 1.25)
        wood[painted] = rng.uniform(0.6, 1.3)
    colours, textures = model.colours.copy(), model.textures
    if model.textured[painted].any():
        textures = textures.copy()
    for m in painted:
        variation = rng.uniform(0.9, 1.1)
        colours[m, :3] = np.clip(target * variation, 0, 1)
        if model.textured[m]:
            grey = textures[m, ..., :3].mean(-1, dtype=np.float32)
            relief = np.clip(grey / max(float(grey.mean()), 1.0), 0.6, 1.25)[..., None]
            textures[m, ..., :3] = np.clip(relief * colours[m, :3] * 255, 0, 255)
    return model._replace(colours=colours, textures=textures), wood, word


def face_areas(model: Model) -> np.ndarray:
    """Return the area of every face."""
    a, b, c = (model.vertices[model.faces[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) + 1e-12


def draw_background(rng: np.random.Generator, size: int) -> np.ndarray:
    """Draw a plain colour, (3,), or now and then a soft vertical gradient, (size, size, 3)."""

    def colour() -> np.ndarray:
        kind = rng.random()
        if kind < 0.5:
            return rng.uniform(0, 1, 3).astype(np.float32)
        if kind < 0.75:
            return np.full(3, rng.choice([rng.uniform(0, 1), 1.0, 0.5]), np.float32)
        return captions.draw_colour(rng, captions.COLOURS[rng.integers(len(captions.COLOURS))])

    if rng.random() < 0.85:
        return colour()
    t = np.linspace(0, 1, size, dtype=np.float32)[:, None, None]
    return np.broadcast_to(colour() * (1 - t) + colour() * t, (size, size, 3))


def draw_sample(rng: np.random.Generator, source: Source, size: int = IMAGE_SIZE) -> Sample:
    """Draw one picture of a noun."""
    word = source.noun.words[0]
    maker = procedural.MAKERS.get(word)
    look = ""
    if maker and (not source.models or rng.random() < PROCEDURAL_SHARE):
        model = maker(rng)
        wood = np.zeros(len(model.colours), np.float32)
        if word in furniture.MAKERS and rng.random() < REPAINTED_SHARE:
            model, wood, look = recolour(rng, model)
    else:
        model = source.models[rng.integers(len(source.models))]
        wood = np.zeros(len(model.colours), np.float32)
        if rng.random() < source.noun.recolour:
            model, wood, look = recolour(rng, model)
    azimuth = rng.uniform(0, 2 * np.pi)
    polar = np.radians(rng.uniform(50, 105) if rng.random() < 0.85 else rng.uniform(15, 50))
    camera = orbit_camera(azimuth, polar, rng.uniform(*RADIUS_RANGE), np.radians(rng.uniform(*FOV_RANGE)))
    place = model.vertices * np.float32(rng.uniform(0.82, 1.08)) + rng.normal(0, 0.03, 3).astype(np.float32)
    # Nearly the same light for every object: an object of one colour shows its hollows by shading alone, and
    # score distillation can only paint a shading that all views agree on.
    towards = orbit_camera(rng.uniform(-0.4, 0.4), rng.uniform(0.5, 0.8), 1, 1).pose[:3, 2]
    strength = rng.uniform(0.35, 0.6)
    light = Light(1.0 - strength, strength * rng.uniform(0.4, 0.9), strength * 0.5, towards)
    picture = render(
        model._replace(vertices=place), wood, camera, size, light, draw_background(rng, 2 * size)
    )
    seen = captions.dominant_colours(picture.albedo)
    if look in captions.COLOURS and look not in seen:
        look = seen  # the painted part is hidden from here, or too small to give the object its colour
    return Sample(picture.image, source.noun, look or seen, azimuth, polar)


_sources: list[Source] = []


def _shard_part(arguments: tuple[int, int, int]) -> tuple[np.ndarray, list[dict]]:
    """Draw pictures `start` to `stop` of a shard; each has a seed of its own."""
    shard, start, stop = arguments
    weights = np.array([s.noun.weight for s in _sources])
    images = np.empty((stop - start, IMAGE_SIZE, IMAGE_SIZE, 3), np.uint8)
    rows = []
    for i in range(start, stop):
        rng = np.random.default_rng([shard, i])
        source = _sources[rng.choice(len(_sources), p=weights / weights.sum())]
        sample = draw_sample(rng, source)
        images[i - start] = np.round(sample.image * 255)
        text = captions.caption(rng, sample.noun, sample.look, sample.azimuth, sample.polar)
        view = {"azimuth": round(sample.azimuth, 4), "polar": round(float(sample.polar), 4)}
        rows.append({"caption": text, "noun": sample.noun.words[0], "look": sample.look, **view})
    return images, rows


def write_shards(work: Path, folder: str, numbers: range, held_out: bool = False) -> None:
    """Write the shards of a folder that are missing, of the training objects or of the held-out ones."""
    place = work / folder
    place.mkdir(parents=True, exist_ok=True)
    missing = [n for n in numbers if not (place / f"{n:03d}.json").exists()]
    if not missing:
        return
    _sources[:] = load_sources(split_entries(work)[held_out])
    if held_out:
        _sources[:] = [s for s in _sources if s.models]
    size = HELD_OUT_SIZE if held_out else SHARD_SIZE
    parts = [(n, i, min(i + 100, size)) for n in missing for i in range(0, size, 100)]
    with (
        multiprocessing.get_context("fork").Pool(os.cpu_count()) as pool,
        Progress(f"dataset {folder}", len(parts)) as progress,
    ):
        done: list[tuple[np.ndarray, list[dict]]] = []
        for i, result in enumerate(pool.imap(_shard_part, parts)):
            done.append(result)
            progress.update(i + 1)
            if parts[i][2] == size:
                np.save(place / f"{parts[i][0]:03d}.npy", np.concatenate([d[0] for d in done]))
                (place / f"{parts[i][0]:03d}.json").write_text(json.dumps([r for d in done for r in d[1]]))
                done = []


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--shards", type=int, default=8, help=f"training shards of {SHARD_SIZE} pictures")
    options = parser.parse_args()
    write_shards(options.work, "held_out", range(1), held_out=True)
    write_shards(options.work, "judge", range(JUDGE_FIRST, JUDGE_FIRST + 6))
    write_shards(options.work, "shards", range(options.shards))


if __name__ == "__main__":
    main()
