"""Batches of the denoiser's training: views of objects from the encoded shards, captions, noise."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from export.everyday_objects.data.captions import caption, seen_from
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.pictures import look_of
from export.everyday_objects.networks.denoiser import CAMERA

TIMESTEPS = 1000
VIEWS = 4
"""Of an object in a step, a quarter of a turn apart."""
OBJECTS = 32
"""Of a step."""
TEXT_DROPOUT, CAMERA_DROPOUT, BACKDROP_DROPOUT, VIEW_WORDS, APART = 0.1, 0.1, 0.1, 0.5, 0.1
"""Shares of objects without text, without camera, without backdrop; of those with view words beside a camera
(all have them without one); of steps in which views do not see each other."""


class Objects(NamedTuple):
    """What there is to train on: one entry a shard."""

    latents: list[np.ndarray]
    """(n, 8, 4, 32, 32) float16, mapped"""
    cameras: list[np.ndarray]
    """(n, 8, 4) float32: azimuth, polar, distance, fov"""
    backdrops: list[np.ndarray]
    """(n, 8, 4) float32"""
    rows: list[list[list]]
    """Kind, variant and look of every object"""


class Batch(NamedTuple):
    """One step's rows, the views of an object in consecutive ones."""

    clean: np.ndarray
    """(b, 4, 32, 32) float32"""
    noise: np.ndarray
    timesteps: np.ndarray
    """(b,) int64, the same for all views of an object"""
    texts: list[str]
    cameras: np.ndarray
    """(b, 10) float32, see `networks.denoiser.CAMERA`"""
    views: int
    """How many rows see each other."""


def shard_numbers(folder: Path) -> list[str]:
    """Return the finished shards of a folder, in order."""
    return sorted(p.stem for p in folder.glob("[0-9]*.npz"))


def load_objects(folder: Path, numbers: list[str], known: Objects | None = None) -> Objects:
    """Return the shards `numbers` of a folder, after those that are known already; objects of designs that
    are not trained on any more are left out."""
    found = known or Objects([], [], [], [])
    for number in numbers[len(found.rows) :]:
        with np.load(folder / f"{number}.npz") as said:
            rows, cameras, backdrops = json.loads(str(said["rows"])), said["cameras"], said["backdrops"]
        latents = np.load(folder / f"{number}.npy", mmap_mode="r")
        kept = [i for i, (word, design, *_) in enumerate(rows) if design < BY_WORD[word].variants]
        if len(kept) < len(rows):
            latents, cameras, backdrops = latents[kept], cameras[kept], backdrops[kept]
            rows = [rows[i] for i in kept]
        found.latents.append(latents)
        found.cameras.append(cameras)
        found.backdrops.append(backdrops)
        found.rows.append(rows)
    return found


def locate(ends: np.ndarray, number: int) -> tuple[int, int]:
    """Return shard and row of an object by its number. `ends` (shards,): objects up to the end of each."""
    shard = int(np.searchsorted(ends, number, side="right"))
    return shard, number - (int(ends[shard - 1]) if shard else 0)


def camera_rows(
    cameras: np.ndarray, backdrops: np.ndarray, told: np.ndarray, behind: np.ndarray
) -> np.ndarray:
    """Return camera inputs (b, 10) of cameras (b, 4) and backdrops (b, 4) where these are told, (b,) each."""
    rows = np.zeros((len(cameras), len(CAMERA)), np.float32)
    rows[:, 0], rows[:, 5] = told, behind
    rows[:, 1:5], rows[:, 6:] = told[:, None] * cameras, behind[:, None] * backdrops
    return rows


def draw_timesteps(rng: np.random.Generator, count: int) -> np.ndarray:
    """Draw (count,) int64 timesteps, one in each of `count` strata: less variance than free draws.

    The lowest fifth, which score distillation never visits and sampling needs least, gets a tenth of them,
    the highest three tenths, where the words and not the picture say what is seen, half.
    """
    strata = rng.permutation(np.arange(count) + rng.random(count)) / count
    return np.interp(strata, [0, 0.1, 0.5, 1], np.array([0, 0.2, 0.7, 1]) * TIMESTEPS).astype(np.int64)


def draw_batch(objects: Objects, step: int, count: int = OBJECTS) -> Batch:
    """Draw `count` objects, four views each, with captions and noise; everything follows from the step."""
    rng = np.random.default_rng([11, step])
    clean, cameras, backdrops, texts = [], [], [], []
    no_text, told, behind = (
        rng.random(count) >= p for p in (1 - TEXT_DROPOUT, CAMERA_DROPOUT, BACKDROP_DROPOUT)
    )
    ends = np.cumsum([len(rows) for rows in objects.rows])
    for i in range(count):
        shard, row = locate(ends, int(rng.integers(ends[-1])))
        views = np.arange(rng.integers(2), 2 * VIEWS, 2)
        clean.append(np.asarray(objects.latents[shard][row, views], np.float32))
        cameras.append(objects.cameras[shard][row, views])
        backdrops.append(objects.backdrops[shard][row, views])
        word, _, *look = objects.rows[shard][row]
        text = "" if no_text[i] else caption(rng, BY_WORD[word], look_of(look))
        said = text and (not told[i] or rng.random() < VIEW_WORDS)
        texts += [seen_from(text, float(c[0]), float(c[1])) if said else text for c in cameras[-1]]
    timesteps = np.repeat(draw_timesteps(rng, count), VIEWS)
    noise = rng.standard_normal((count * VIEWS, *clean[0].shape[1:]), np.float32)
    rows = camera_rows(
        np.concatenate(cameras), np.concatenate(backdrops), np.repeat(told, VIEWS), np.repeat(behind, VIEWS)
    )
    return Batch(np.concatenate(clean), noise, timesteps, texts, rows, 1 if rng.random() < APART else VIEWS)


def halved(batch: Batch) -> Batch:
    """Return a batch of half the size: a quarter of the work."""
    small = batch.clean.reshape(*batch.clean.shape[:2], 16, 2, 16, 2).mean((3, 5))
    return batch._replace(clean=small, noise=np.ascontiguousarray(batch.noise[:, :, ::2, ::2]))
