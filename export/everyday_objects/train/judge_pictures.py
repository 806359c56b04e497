"""Pictures for the judge, and what is true of them: drawn once, half of them as score distillation leaves a
scene."""

import json
import multiprocessing
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.looks import Look
from export.everyday_objects.data.pictures import IMAGE_SIZE, draw_object, load_encoder, look_of
from export.everyday_objects.networks.autoencoder import Decoder, Encoder
from export.everyday_objects.networks.judge import KINDS, MADE_OF, SIDES, side_of
from export.everyday_objects.train.train_autoencoder import BFLOAT16, to_batch
from pipeline.progress import Progress

PICTURES, HELD_OUT_PICTURES = 24_000, 1500
VIEWS = 2
"""Of an object in the pictures."""
DECODED_SHARE = 0.5
LATENT_NOISE = (0.1, 0.5)
"""Standard deviations, where latents have 1."""
_SEEDS = {"training": 500_000, "held_out": 500_001}  # beyond those of all shards
_BLOCK = 20


class Pool(NamedTuple):
    """Pictures and what they show."""

    images: np.ndarray
    """(n, IMAGE_SIZE, IMAGE_SIZE, 3) uint8"""
    rows: list[list]
    """Kind, variant, look (four columns, see `pictures.look_of`), azimuth [rad], whether it was decoded"""


class Labels(NamedTuple):
    """What is true of pictures, (n,) int64 each; -1 where nothing is to be said."""

    kind: np.ndarray
    colour: np.ndarray
    material: np.ndarray
    side: np.ndarray


class Block(NamedTuple):
    """What a drawing process returns."""

    pictures: np.ndarray
    """(n, IMAGE_SIZE, IMAGE_SIZE, 3) uint8"""
    backdrops: np.ndarray
    """(n, 3) uint8"""
    rows: list[list]
    """As in a pool, none decoded"""


def colour_label(look: Look) -> int:
    """Index of a single colour, else -1: two colours, natural ones and a material's own are not judged."""
    own = look.material is not None and look.material.colour is not None
    return COLOURS.index(look.colour) if look.colour and not look.second and not own else -1


def material_label(look: Look) -> int:
    """Index of the first role's material in MADE_OF."""
    return MADE_OF.index(look.material.adjective) if look.material else 0


def labels_of(rows: list[list]) -> Labels:
    """Return the labels of a pool's rows; kinds without a front have no side."""
    looks = [look_of(row[2:6]) for row in rows]
    return Labels(
        np.array([KINDS.index(row[0]) for row in rows]),
        np.array([colour_label(look) for look in looks]),
        np.array([material_label(look) for look in looks]),
        np.array([SIDES.index(side_of(row[6])) if BY_WORD[row[0]].front else -1 for row in rows]),
    )


def load_autoencoder(work: Path) -> tuple[Encoder, Decoder]:
    """Return the trained encoder and decoder."""
    decoder = Decoder()
    decoder.load_state_dict(torch.load(work / "autoencoder.pt", weights_only=True)["decoder"])
    return load_encoder(work), decoder.eval()


@torch.inference_mode()
def distilled(
    rng: np.random.Generator,
    autoencoder: tuple[Encoder, Decoder],
    pictures: np.ndarray,
    backdrops: np.ndarray,
) -> np.ndarray:
    """Return pictures (n, h, w, 3) uint8 much as score distillation leaves them: decoded from latents that
    were blurred and have noise, fine and coarse.

    Half of them stand before their flat backdrop (n, 3) uint8 again, as scenes are shown; samples do not.
    """
    encoder, decoder = autoencoder
    with torch.autocast("cpu", torch.bfloat16, enabled=BFLOAT16):
        latents = encoder(to_batch(pictures)).float()
        n, c, h, w = latents.shape

        def share(low: float, high: float) -> Tensor:
            return torch.from_numpy(rng.uniform(low, high, (n, 1, 1, 1)).astype(np.float32))

        soft = F.avg_pool2d(F.pad(latents, (1, 1, 1, 1), mode="replicate"), 3, stride=1)
        fine = torch.from_numpy(rng.standard_normal((n, c, h, w), np.float32))
        small = torch.from_numpy(rng.standard_normal((n, c, h // 4, w // 4), np.float32))
        coarse = F.interpolate(small, (h, w), mode="bilinear", align_corners=False)
        mixed, blurred = share(0, 0.5), share(0, 1)
        noise = (1 - mixed).sqrt() * fine + mixed.sqrt() * coarse / coarse.std()
        latents = latents + blurred * (soft - latents) + share(*LATENT_NOISE) * noise
        decoded = decoder(latents).float().clamp(0, 1).permute(0, 2, 3, 1).numpy()
    decoded = np.round(decoded * 255).astype(np.uint8)
    behind = (pictures == backdrops[:, None, None]).all(-1) & (rng.random(n) < 0.5)[:, None, None]
    return np.where(behind[..., None], pictures, decoded)


def _draw_block(arguments: tuple[str, int, int]) -> Block:
    name, first, last = arguments
    pictures, backdrops, rows = [], [], []
    for i in range(first, last):
        rng = np.random.default_rng([_SEEDS[name], i])
        row, views, drawn = draw_object(rng, name == "held_out", views=VIEWS)
        pictures.append(np.round(drawn * 255).astype(np.uint8))
        backdrops += [np.round(view.backdrop * 255).astype(np.uint8) for view in views]
        rows += [[*row, round(float(view.azimuth), 4), False] for view in views]
    return Block(np.concatenate(pictures), np.stack(backdrops), rows)


def draw_pool(work: Path, name: str, count: int) -> Pool:
    """Return `count` pictures, "training" or "held_out", DECODED_SHARE of them `distilled`.

    They are drawn once and kept in WORK/judge.
    """
    folder = work / "judge"
    images, described = folder / f"{name}.npy", folder / f"{name}.json"
    if not described.exists():
        folder.mkdir(parents=True, exist_ok=True)
        autoencoder, rows, objects = load_autoencoder(work), list[list](), count // VIEWS
        partial = np.lib.format.open_memmap(
            f"{images}.new", "w+", np.uint8, (objects * VIEWS, IMAGE_SIZE, IMAGE_SIZE, 3)
        )
        calls = [(name, i, min(i + _BLOCK, objects)) for i in range(0, objects, _BLOCK)]
        with (
            multiprocessing.get_context("fork").Pool(os.cpu_count()) as workers,
            Progress(f"judge's {name} pictures", objects * VIEWS) as progress,
        ):
            for call, block in zip(calls, workers.imap(_draw_block, calls), strict=True):
                rng = np.random.default_rng([_SEEDS[name], *call[1:], 1])
                chosen = np.flatnonzero(rng.random(len(block.rows)) < DECODED_SHARE)
                if len(chosen):
                    block.pictures[chosen] = distilled(
                        rng, autoencoder, block.pictures[chosen], block.backdrops[chosen]
                    )
                for i in chosen:
                    block.rows[i][-1] = True
                partial[len(rows) : len(rows) + len(block.rows)] = block.pictures
                rows += block.rows
                progress.update(len(rows))
        partial.flush()
        os.replace(f"{images}.new", images)
        described.with_suffix(".new").write_text(json.dumps(rows))
        os.replace(described.with_suffix(".new"), described)
    return Pool(np.load(images, mmap_mode="r"), json.loads(described.read_text()))
