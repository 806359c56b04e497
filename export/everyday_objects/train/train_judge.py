"""Train the judge on pictures of its own and on failed ones; measure it on held-out shapes.

`python -m export.everyday_objects.train.train_judge WORK --steps 4000` writes benchmarks/judge.npz; with
`--on` it goes on from the judge that is there. The pictures are drawn once and kept in WORK/judge.
WORK/autoencoder.pt shows half of them as a decoder gives them back after score distillation.
benchmarks/failed holds results of the model that a person found to be no object at all.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor
from torch.nn import functional as F

from export.everyday_objects.data.pictures import IMAGE_SIZE, draw_backdrop, draw_views
from export.everyday_objects.data.render import drawable, render
from export.everyday_objects.networks.judge import (
    FAILED,
    MADE_OF,
    SIDES,
    Judge,
    judge_images,
    judge_sides,
    load_judge,
    save_judge,
    shrink,
)
from export.everyday_objects.train.augment import blur_and_jitter, move, sharpen, shift_hues
from export.everyday_objects.train.failures import lump, melt, scatter
from export.everyday_objects.train.judge_pictures import (
    HELD_OUT_PICTURES,
    PICTURES,
    Labels,
    Pool,
    draw_pool,
    labels_of,
)
from pipeline.progress import Progress

JUDGE = Path(__file__).parents[3] / "benchmarks" / "judge.npz"
FAILURES = JUDGE.parent / "failed"
FAILED_SHARE = 0.12
TURNED_SHARE = 0.25
"""Of the pictures: in hues that say nothing of their colour."""
PLAIN_WEIGHT = 0.25
"""Of pictures without a material: five in six are."""
LUMPS = 1500


def draw_lump(rng: np.random.Generator) -> np.ndarray:
    """A picture (IMAGE_SIZE, IMAGE_SIZE, 3) uint8 of a lump."""
    shape, looks = lump(rng)
    camera = draw_views(rng)[0].camera()
    picture = render(drawable(shape), looks, camera, IMAGE_SIZE, draw_backdrop(rng))
    return np.round(picture * 255).astype(np.uint8)


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
