"""Train the judge on pictures of its own and on failed ones; measure it on held-out shapes.

`python -m export.everyday_objects.train.train_judge WORK --steps 4000` writes benchmarks/judge.npz; with
`--on` it goes on from the judge that is there. The pictures are drawn once and kept in WORK/judge.
WORK/autoencoder.pt shows half of them as a decoder gives them back after score distillation.
benchmarks/failed holds results of the model that a person found to be no object at all.
"""

import argparse
import json
import multiprocessing
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from PIL import Image
from torch import Tensor
from torch.nn import functional as F

from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.looks import Look
from export.everyday_objects.data.pictures import (
    IMAGE_SIZE,
    draw_backdrop,
    draw_object,
    draw_views,
    load_encoder,
    look_of,
)
from export.everyday_objects.data.render import drawable, render
from export.everyday_objects.networks.autoencoder import Decoder, Encoder
from export.everyday_objects.networks.judge import (
    FAILED,
    KINDS,
    MADE_OF,
    SIDES,
    Judge,
    judge_images,
    judge_sides,
    load_judge,
    save_judge,
    shrink,
    side_of,
)
from export.everyday_objects.train.failures import lump, melt, scatter
from export.everyday_objects.train.train_autoencoder import BFLOAT16, to_batch
from pipeline.progress import Progress

JUDGE = Path(__file__).parents[3] / "benchmarks" / "judge.npz"
FAILURES = JUDGE.parent / "failed"
PICTURES, HELD_OUT_PICTURES = 24_000, 1500
VIEWS = 2
"""Of an object in the pictures."""
DECODED_SHARE = 0.5
LATENT_NOISE = (0.1, 0.5)
"""Standard deviations, where latents have 1."""
FAILED_SHARE = 0.12
TURNED_SHARE = 0.25
"""Of the pictures: in hues that say nothing of their colour."""
PLAIN_WEIGHT = 0.25
"""Of pictures without a material: five in six are."""
LUMPS = 1500
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


def draw_lump(rng: np.random.Generator) -> np.ndarray:
    """A picture (IMAGE_SIZE, IMAGE_SIZE, 3) uint8 of a lump."""
    shape, looks = lump(rng)
    camera = draw_views(rng)[0].camera()
    picture = render(drawable(shape), looks, camera, IMAGE_SIZE, draw_backdrop(rng))
    return np.round(picture * 255).astype(np.uint8)


def move(rng: np.random.Generator, images: torch.Tensor) -> torch.Tensor:
    """Mirror half of the pictures; shift and zoom each a little: few objects are to show as many."""
    count = len(images)
    zoom = rng.uniform(0.85, 1.2, count)
    place = np.zeros((count, 2, 3), np.float32)
    place[:, 0, 0] = zoom * rng.choice([-1, 1], count)
    place[:, 1, 1] = zoom * rng.uniform(0.92, 1.08, count)
    place[:, :, 2] = rng.uniform(-0.12, 0.12, (count, 2))
    grid = F.affine_grid(torch.from_numpy(place), list(images.shape), align_corners=False)
    return F.grid_sample(images, grid, padding_mode="border", align_corners=False)


def blur_and_jitter(rng: np.random.Generator, images: torch.Tensor) -> torch.Tensor:
    """Blur, brightness, contrast and noise, so that a decoder's softness is no sign of anything."""
    small = int(rng.integers(28, 65))
    if small < 60:
        images = F.interpolate(
            F.interpolate(images, (small, small), mode="area"), images.shape[-2:], mode="bilinear"
        )
    gain = torch.from_numpy(rng.uniform(0.85, 1.15, (len(images), 1, 1, 1)).astype(np.float32))
    shift = torch.from_numpy(rng.uniform(-0.06, 0.06, (len(images), 1, 1, 1)).astype(np.float32))
    noise = torch.from_numpy(rng.normal(0, rng.uniform(0, 0.03), images.shape).astype(np.float32))
    return (images * gain + shift + noise).clamp(0, 1)


def shift_hues(rng: np.random.Generator, images: torch.Tensor) -> torch.Tensor:
    """Turn each picture's colours about the grey axis, and pale or deepen them: a kind is its shape.

    The few models of a kind come in few colours, and a kind learned with its colours is not known in others.
    """
    grey = np.full((3, 3), 1 / 3)
    across = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]) / np.sqrt(3)
    angles, depth = rng.uniform(0, 2 * np.pi, len(images)), rng.uniform(0, 1.5, len(images))
    turns = [
        grey + d * (np.cos(a) * (np.eye(3) - grey) + np.sin(a) * across)
        for a, d in zip(angles, depth, strict=True)
    ]
    turned = torch.einsum("bij,bjhw->bihw", torch.from_numpy(np.stack(turns).astype(np.float32)), images)
    return turned.clamp(0, 1)


def sharpen(rng: np.random.Generator, images: torch.Tensor) -> torch.Tensor:
    """Exaggerate edges as strong guidance does: up to twice what a blur takes away, added again."""
    width = int(rng.choice([3, 5, 7]))
    soft = F.avg_pool2d(images, width, stride=1, padding=width // 2, count_include_pad=False)
    strength = torch.from_numpy(rng.uniform(0, 2, (len(images), 1, 1, 1)).astype(np.float32))
    return (images + strength * (images - soft)).clamp(0, 1)


def head_loss(
    logits: Tensor, truth: np.ndarray, weight: Tensor | None = None, smoothing: float = 0.0
) -> Tensor:
    """Return the mean cross entropy of logits (b, classes) where the truth (b,) is not -1; else 0."""
    known = torch.from_numpy(truth >= 0)
    if not known.any():
        return logits.sum() * 0
    target = torch.from_numpy(truth)[known]
    return F.cross_entropy(logits[known], target, weight, label_smoothing=smoothing)


def spoil(
    rng: np.random.Generator,
    pictures: np.ndarray,
    labels: Labels,
    lumps: list[np.ndarray],
    failed: list[np.ndarray],
) -> None:
    """Make FAILED_SHARE of a batch failures, in place: melted, scattered, lumps, results that failed."""
    for i in range(round(FAILED_SHARE * len(pictures))):
        way = rng.random()
        if way < 0.35:
            pictures[i] = melt(rng, pictures[i])
        elif way < 0.5:
            pictures[i] = scatter(rng, pictures[i])
        elif way < 0.75 or not failed:
            pictures[i], labels.colour[i] = lumps[rng.integers(len(lumps))], -1
        else:
            pictures[i], labels.colour[i] = failed[rng.integers(len(failed))], -1
        labels.kind[i], labels.material[i], labels.side[i] = FAILED, -1, -1


def train(
    pool: Pool, failed: list[np.ndarray], steps: int, judge: Judge, batch: int = 64, rate: float = 2e-3
) -> Judge:
    """Train a judge on, at a rate that rises for 100 steps and falls as a cosine."""
    torch.manual_seed(0)
    truth = labels_of(pool.rows)
    lumps = [draw_lump(np.random.default_rng([1, i])) for i in range(LUMPS)]
    weight = torch.tensor([PLAIN_WEIGHT] + [1.0] * (len(MADE_OF) - 1))
    judge = judge.train().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimiser = torch.optim.AdamW(judge.parameters(), rate, weight_decay=0.02)
    with Progress("judge", steps, "steps") as progress:
        for step in range(steps):
            rng = np.random.default_rng([13, step])
            picks = rng.integers(len(pool.images), size=batch)
            pictures, labels = np.array(pool.images[picks]), Labels(*(values[picks] for values in truth))
            spoil(rng, pictures, labels, lumps, failed)
            for group in optimiser.param_groups:
                group["lr"] = rate * min(1, (step + 1) / 100) * (0.5 + 0.5 * np.cos(np.pi * step / steps))
            x = shrink(pictures)
            turned = rng.random(batch) < TURNED_SHARE
            x[turned] = shift_hues(rng, x[turned])
            labels.colour[turned] = labels.material[turned] = -1  # gold in blue is steel
            x = blur_and_jitter(rng, move(rng, x))
            if step % 2:
                x = sharpen(rng, x)
            kind, colour, material, side = judge(x.contiguous(memory_format=torch.channels_last))
            loss = head_loss(kind, labels.kind, smoothing=0.05) + head_loss(colour, labels.colour)
            loss = loss + head_loss(material, labels.material, weight) + head_loss(side, labels.side)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            progress.update(step + 1, f"loss {loss.item():.3f}")
    return judge.eval()


def held_out_figures(judge: Judge, pool: Pool) -> dict[str, float]:
    """How often the judge is right: about shapes it has never seen, and about failed pictures.

    `material_top1` counts pictures with a material, `plain_top1` those without. `back_as_front`: share of the
    back views of kinds with a front that it takes for the front; no model can be found to have fewer.
    """
    truth, decoded = labels_of(pool.rows), np.array([row[7] for row in pool.rows])
    kinds, colours, materials = judge_images(judge, pool.images)
    sides = judge_sides(judge, pool.images).argmax(1)
    rng = np.random.default_rng(99)
    broken = np.stack(
        [melt(rng, x) for x in np.array(pool.images[:200])]
        + [draw_lump(np.random.default_rng([2, i])) for i in range(100)]
    )
    right, made_of = kinds.argmax(1) == truth.kind, materials.argmax(1) == truth.material
    first = np.argsort(-kinds, axis=1)[:, :5]
    found = {
        "kind_top1": right,
        "kind_top1_decoded": right[decoded],
        "kind_top5": (first == truth.kind[:, None]).any(1),
        "colour_top1": (colours.argmax(1) == truth.colour)[truth.colour >= 0],
        "material_top1": made_of[truth.material > 0],
        "plain_top1": made_of[truth.material == 0],
        "side_top1": (sides == truth.side)[truth.side >= 0],
        "back_as_front": (sides == SIDES.index("front"))[truth.side == SIDES.index("back")],
        "failed_found": judge_images(judge, broken)[0].argmax(1) == FAILED,
        "failed_by_mistake": kinds.argmax(1) == FAILED,
    }
    return {name: round(float(hits.mean()), 4) for name, hits in found.items() if len(hits)}


def read_failed(folder: Path) -> list[np.ndarray]:
    """The PNG files of a folder as (IMAGE_SIZE, IMAGE_SIZE, 3) uint8 pictures."""
    paths = sorted(folder.glob("*.png"))
    return [np.asarray(Image.open(p).convert("RGB").resize((IMAGE_SIZE, IMAGE_SIZE))) for p in paths]


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--pictures", type=int, default=PICTURES, help="to draw, where there are none yet")
    parser.add_argument("--failed", type=Path, default=FAILURES, help="folder of PNG files")
    parser.add_argument("--on", action="store_true", help="go on from the judge there is, at half the rate")
    parser.add_argument("--threads", type=int, default=0, help="0: one a core")
    options = parser.parse_args()
    if options.threads:
        torch.set_num_threads(options.threads)
    training = draw_pool(options.work, "training", options.pictures)
    held_out = draw_pool(options.work, "held_out", HELD_OUT_PICTURES)
    start, rate = (load_judge(JUDGE)[0], 1e-3) if options.on else (Judge(), 2e-3)
    judge = train(training, read_failed(options.failed), options.steps, start, rate=rate)
    figures = held_out_figures(judge, held_out)
    print(json.dumps(figures))
    save_judge(JUDGE, judge, figures)


if __name__ == "__main__":
    main()
