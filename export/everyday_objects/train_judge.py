"""Train the judge on the pictures in WORK/judge and on failed ones; measure it on held-out objects.

`python -m export.everyday_objects.train_judge WORK --steps 4000` writes benchmarks/judge.npz; with `--on` it
goes on from the judge that is there. benchmarks/failed holds results of the model that a person found to be
no object at all.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch.nn import functional as F

from export.everyday_objects.captions import COLOURS
from export.everyday_objects.dataset import IMAGE_SIZE, draw_background
from export.everyday_objects.failures import lump, melt, scatter
from export.everyday_objects.judge import FAILED, KINDS, Judge, judge_images, load_judge, save_judge, shrink
from export.everyday_objects.render import Light, render
from pipeline.scene.cameras import orbit_camera
from pipeline.stage import Progress

FAILED_SHARE = 0.12
TURNED_SHARE = 0.4  # of the pictures: in hues that say nothing of their colour
LUMPS = 1500
JUDGE = Path(__file__).parents[2] / "benchmarks" / "judge.npz"
FAILURES = JUDGE.parent / "failed"


def colour_label(look: str) -> int:
    """Index of a single colour, else -1: two colours, wood and none are not judged."""
    return COLOURS.index(look) if look in COLOURS else -1


def draw_lump(rng: np.random.Generator) -> np.ndarray:
    """A picture (size, size, 3) uint8 of a lump."""
    model = lump(rng)
    camera = orbit_camera(rng.uniform(0, 6.3), rng.uniform(0.5, 1.8), 2.5, np.radians(40))
    light = Light(0.7, 0.25, 0.15, orbit_camera(rng.uniform(-1.2, 1.2), 0.7, 1, 1).pose[:3, 2])
    wood = np.zeros(len(model.colours), np.float32)
    picture = render(model, wood, camera, IMAGE_SIZE, light, draw_background(rng, 2 * IMAGE_SIZE))
    return np.round(picture.image * 255).astype(np.uint8)


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


def train(
    work: Path, failed: list[np.ndarray], steps: int, judge: Judge, batch: int = 64, rate: float = 2e-3
) -> Judge:
    """Train a judge on, at a rate that rises for 100 steps and falls as a cosine."""
    torch.manual_seed(0)
    paths = sorted((work / "judge").glob("*.npy"))
    images = np.concatenate([np.load(p) for p in paths])
    rows = [row for p in paths for row in json.loads(p.with_suffix(".json").read_text())]
    kinds = np.array([KINDS.index(row["noun"]) for row in rows])
    colours = np.array([colour_label(row["look"]) for row in rows])
    lumps = [draw_lump(np.random.default_rng([1, i])) for i in range(LUMPS)]
    judge = judge.train().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimiser = torch.optim.AdamW(judge.parameters(), rate, weight_decay=0.02)
    with Progress("judge", steps, "steps") as progress:
        for step in range(steps):
            rng = np.random.default_rng([13, step])
            picks = rng.integers(len(images), size=batch)
            pictures, kind, colour = images[picks].copy(), kinds[picks], colours[picks]
            for i in range(round(FAILED_SHARE * batch)):
                way = rng.random()
                if way < 0.35:
                    pictures[i] = melt(rng, pictures[i])
                elif way < 0.5:
                    pictures[i] = scatter(rng, pictures[i])
                elif way < 0.75 or not failed:
                    pictures[i], colour[i] = lumps[rng.integers(len(lumps))], -1
                else:
                    pictures[i], colour[i] = failed[rng.integers(len(failed))], -1
                kind[i] = FAILED
            for group in optimiser.param_groups:
                group["lr"] = rate * min(1, (step + 1) / 100) * (0.5 + 0.5 * np.cos(np.pi * step / steps))
            x = shrink(pictures)
            turned = rng.random(batch) < TURNED_SHARE
            x[turned], colour[turned] = shift_hues(rng, x[turned]), -1
            x = blur_and_jitter(rng, move(rng, x))
            if step % 2:
                x = sharpen(rng, x)
            x = x.contiguous(memory_format=torch.channels_last)
            kind_logits, colour_logits = judge(x)
            loss = F.cross_entropy(kind_logits, torch.from_numpy(kind), label_smoothing=0.05)
            loss = loss + F.cross_entropy(colour_logits, torch.from_numpy(colour), ignore_index=-1)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            progress.update(step + 1, f"loss {loss.item():.3f}")
    return judge.eval()


def held_out_figures(judge: Judge, work: Path) -> dict[str, float]:
    """How often the judge is right: about objects it has never seen, and about failed pictures."""
    images = np.load(work / "held_out" / "000.npy")
    rows = json.loads((work / "held_out" / "000.json").read_text())
    kinds, colours = judge_images(judge, images)
    truth = np.array([KINDS.index(row["noun"]) for row in rows])
    look = np.array([colour_label(row["look"]) for row in rows])
    rng = np.random.default_rng(99)
    broken = np.stack(
        [melt(rng, x) for x in images[:200]] + [draw_lump(np.random.default_rng([2, i])) for i in range(100)]
    )
    return {
        "kind_top1": round(float((kinds.argmax(1) == truth).mean()), 4),
        "kind_top5": round(float((np.argsort(-kinds, axis=1)[:, :5] == truth[:, None]).any(1).mean()), 4),
        "colour_top1": round(float((colours.argmax(1) == look)[look >= 0].mean()), 4),
        "failed_found": round(float((judge_images(judge, broken)[0].argmax(1) == FAILED).mean()), 4),
        "failed_by_mistake": round(float((kinds.argmax(1) == FAILED).mean()), 4),
    }


def read_failed(folder: Path) -> list[np.ndarray]:
    """The PNG files of a folder as (size, size, 3) uint8 pictures."""
    paths = sorted(folder.glob("*.png"))
    return [np.asarray(Image.open(p).convert("RGB").resize((IMAGE_SIZE, IMAGE_SIZE))) for p in paths]


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--failed", type=Path, default=FAILURES, help="folder of PNG files")
    parser.add_argument("--on", action="store_true", help="go on from the judge there is, at half the rate")
    options = parser.parse_args()
    start, rate = (load_judge(JUDGE)[0], 1e-3) if options.on else (Judge(), 2e-3)
    judge = train(options.work, read_failed(options.failed), options.steps, start, rate=rate)
    figures = held_out_figures(judge, options.work)
    print(json.dumps(figures))
    save_judge(JUDGE, judge, figures)


if __name__ == "__main__":
    main()
