"""Training pictures: views of dressed variants of all kinds, encoded, in numbered shards.

`python -m export.everyday_objects.data.pictures WORK --shards 100 [--first 0 --step 2]` writes
WORK/pictures/NNNNN.npy, latents (n, VIEWS, 4, 32, 32) float16, and NNNNN.npz with what they show. A shard
depends on its number and the makers alone; shards that are there are kept, so that several processes can
share the numbers (`--first`, `--step`), and a training reads what is there. WORK/autoencoder.pt encodes
(`train.restore` takes it from the bundle). Looks and cameras that no training sees have a number that none
reaches: `--folder held_out_pictures --first 90000 --shards 1`.
"""

import argparse
import json
import os
import time
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from export.everyday_objects.data.colours import COLOURS, draw_colour
from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.kinds import KINDS
from export.everyday_objects.data.looks import Look, draw_look, dress
from export.everyday_objects.data.materials import MATERIALS
from export.everyday_objects.data.render import Drawable, drawable, render
from export.everyday_objects.data.shapes import assemble
from export.everyday_objects.networks.autoencoder import Encoder
from pipeline.cameras import Camera, orbit_camera

IMAGE_SIZE = 128
OBJECTS = 250
"""Of a shard."""
VIEWS = 8
"""Of an object, one in each eighth of the turn."""
HELD_OUT = 4
"""Shapes of a kind that are kept from training."""
FIRST_DESIGN = 0.9
"""Share of objects in the first shape of their kind, besides its part of the others: a prompt names no shape,
and what the model imagines should be one, not the mean of several."""
DISTANCES, FOVS = (2.4, 2.6), (38.0, 41.0)
"""Of the cameras [scene units], [deg]; bundle.json hands them on to the pipeline."""
POLARS, STEEP_POLARS, STEEP = (40.0, 105.0), (12.0, 40.0), 0.12
"""Angles from the vertical [deg], and from further above in a share of the views."""


class View(NamedTuple):
    """A camera and a flat backdrop."""

    azimuth: float
    polar: float
    distance: float
    fov: float
    """Angles in radians, the distance in scene units."""
    backdrop: np.ndarray
    """(3,) float32 RGB in [0, 1]"""

    def camera(self) -> Camera:
        """The camera itself."""
        return orbit_camera(self.azimuth, self.polar, self.distance, self.fov)


@cache
def variant(kind: int, seed: int) -> Drawable:
    """Return a variant of a kind, made once a process."""
    return drawable(assemble(KINDS[kind].make(np.random.default_rng(seed))))


def draw_backdrop(rng: np.random.Generator) -> np.ndarray:
    """Draw a flat colour (3,): any, a grey, or one with a name."""
    what = rng.random()
    if what < 0.55:
        return rng.uniform(0, 1, 3).astype(np.float32)
    if what < 0.8:
        return np.full(3, rng.choice([rng.uniform(0, 1), 1.0, 2 / 3, 0.0]), np.float32)
    return draw_colour(rng, COLOURS[rng.integers(len(COLOURS))])


def draw_views(rng: np.random.Generator) -> list[View]:
    """Draw VIEWS views, in the order of their azimuths."""
    start = rng.uniform(0, 2 * np.pi)
    views = []
    for i in range(VIEWS):
        azimuth = (start + 2 * np.pi * (i + rng.random()) / VIEWS) % (2 * np.pi)
        polar = np.radians(rng.uniform(*(STEEP_POLARS if rng.random() < STEEP else POLARS)))
        fov = np.radians(rng.uniform(*FOVS))
        views.append(View(azimuth, polar, rng.uniform(*DISTANCES), fov, draw_backdrop(rng)))
    return views


def draw_kind(rng: np.random.Generator, kinds: tuple[Kind, ...] = KINDS) -> int:
    """Draw a row of the kinds by their weights."""
    weights = np.array([k.weight for k in kinds])
    return int(rng.choice(len(kinds), p=weights / weights.sum()))


def look_row(look: Look) -> list:
    """Return a look as JSON."""
    return [look.colour, look.second, dict(look.parts), look.material.adjective if look.material else ""]


def look_of(row: list) -> Look:
    """Return the look that `look_row` wrote."""
    return Look(row[0], row[1], row[2], MATERIALS[row[3]] if row[3] else None)


def load_encoder(work: Path) -> Encoder:
    """Return the trained encoder."""
    encoder = Encoder()
    encoder.load_state_dict(torch.load(work / "autoencoder.pt", weights_only=True)["encoder"])
    return encoder.eval().to(memory_format=torch.channels_last)  # type: ignore[call-overload]


@torch.inference_mode()
def encode(encoder: Encoder, pictures: np.ndarray) -> np.ndarray:
    """Return the latents (n, 4, h, w) float16 of pictures (n, 4h, 4w, 3) in [0, 1]."""
    batch = torch.from_numpy(np.ascontiguousarray(pictures, np.float32)).permute(0, 3, 1, 2)
    with torch.autocast("cpu", torch.bfloat16, enabled=torch.cpu._is_avx512_bf16_supported()):
        return encoder(batch).half().numpy()


def draw_object(
    rng: np.random.Generator, held_out: bool = False, size: int = IMAGE_SIZE, views: int = VIEWS
) -> tuple[list, list[View], np.ndarray]:
    """Return what an object is ([kind, variant, *look]), its views, and its pictures (views, size, size, 3).

    Held-out objects have shapes of seeds that are never trained on.
    """
    number = draw_kind(rng)
    kind = KINDS[number]
    design = 0 if rng.random() < FIRST_DESIGN else rng.integers(kind.variants)
    seed = int(kind.variants + rng.integers(HELD_OUT) if held_out else design)
    thing = variant(number, seed)
    look, seen = draw_look(rng, kind, {p.role for p in thing.shape.paints}), draw_views(rng)[:views]
    looks = dress(rng, kind, thing.shape, look)
    pictures = np.stack([render(thing, looks, v.camera(), size, v.backdrop) for v in seen])
    return [kind.words[0], seed, *look_row(look)], seen, pictures


def write_shard(folder: Path, number: int, encoder: Encoder) -> None:
    """Draw and encode shard `number`; its description is written last."""
    latents = np.empty((OBJECTS, VIEWS, 4, IMAGE_SIZE // 4, IMAGE_SIZE // 4), np.float16)
    cameras, backdrops = np.empty((OBJECTS, VIEWS, 4), np.float32), np.empty((OBJECTS, VIEWS, 4), np.float32)
    rows = []
    for i in range(OBJECTS):
        row, views, pictures = draw_object(np.random.default_rng([number, i]))
        rows.append(row)
        latents[i] = encode(encoder, pictures)
        cameras[i] = [v[:4] for v in views]
        flat = np.broadcast_to(np.stack([v.backdrop for v in views])[:, None, None], (VIEWS, 16, 16, 3))
        backdrops[i] = encode(encoder, flat)[:, :, 1, 1]
    for name, content in ((f"{number:05d}.npy", latents), (f"{number:05d}.npz", None)):
        partial = folder / f".{name}"
        with open(partial, "wb") as file:
            if content is not None:
                np.save(file, content)
            else:
                np.savez(file, cameras=cameras, backdrops=backdrops, rows=np.array(json.dumps(rows)))
        os.replace(partial, folder / name)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--folder", default="pictures", help="below WORK")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--step", type=int, default=1)
    parser.add_argument(
        "--shards", type=int, default=100, help="numbers first, first + step, ... below first + this"
    )
    options = parser.parse_args()
    folder = options.work / options.folder
    folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    encoder = load_encoder(options.work)
    for number in range(options.first, options.first + options.shards, options.step):
        if not (folder / f"{number:05d}.npz").exists():
            start = time.monotonic()
            write_shard(folder, number, encoder)
            rate = OBJECTS * VIEWS / (time.monotonic() - start)
            print(f"shard {number}: {rate:.0f} pictures a second", flush=True)


if __name__ == "__main__":
    main()
