"""Train the denoiser and the text encoder together on the encoded pictures; keep a moving average of the
weights.

`python -m export.everyday_objects.train.train_denoiser WORK --steps 100000` reads the shards of
WORK/pictures, new ones as they come, writes WORK/denoiser.pt (the average, what is exported), and goes on
from WORK/denoiser.state.pt to the same weights as if it had never been stopped. The rates are constant, with
a fall over the last `--fall` steps where that is given: a longer training goes on from a state that was saved
before its fall. With CUDA it runs there, in bfloat16.
"""

import argparse
import json
import os
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from export.bundle_files import train_tokenizer
from export.everyday_objects.data.captions import caption, example_texts, seen_from
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.pictures import look_of
from export.everyday_objects.networks.denoiser import CAMERA, Denoiser
from export.everyday_objects.networks.text_encoder import MAX_TOKENS, TextEncoder
from export.everyday_objects.train.muon import Muon
from pipeline.diffusion.tokenizer import ClipTokenizer, load_tokenizer

BETAS = (0.00085, 0.012)
TIMESTEPS = 1000
VOCABULARY = 2000
VIEWS = 4
"""Of an object in a step, a quarter of a turn apart."""
OBJECTS = 32
"""Of a step."""
TEXT_DROPOUT, CAMERA_DROPOUT, BACKDROP_DROPOUT, VIEW_WORDS, APART = 0.1, 0.1, 0.1, 0.5, 0.1
"""Shares of objects without text, without camera, without backdrop; of those with view words beside a camera
(all have them without one); of steps in which views do not see each other."""
MUON_RATE, ADAM_RATE, DECAY, WARM_UP = 0.007, 5e-4, 0.01, 200
"""At 0.02 and 1e-3 the first bundle's loss fell from .376 to .366 in its steps 3,000 to 4,000, and to .327 in
the 1,800 over which the rates fell to nothing: they were too high for what comes after the start."""
AVERAGED = 1000
"""Steps that the moving average looks back on."""
SAVE_EVERY, LOOK_FOR_SHARDS_EVERY = 200, 200
FIGURES_AT = (300, 500, 700, 850, 950)
"""Timesteps at which the loss on held-out objects is said."""
BFLOAT16 = torch.cuda.is_available() or torch.cpu._is_avx512_bf16_supported()


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


def alphas_cumprod() -> Tensor:
    """Stable Diffusion's scaled-linear schedule, (1000,) float32."""
    betas = torch.linspace(BETAS[0] ** 0.5, BETAS[1] ** 0.5, TIMESTEPS, dtype=torch.float64) ** 2
    return torch.cumprod(1 - betas, 0).float()


def shard_numbers(folder: Path) -> list[str]:
    """Return the finished shards of a folder, in order."""
    return sorted(p.stem for p in folder.glob("[0-9]*.npz"))


def load_objects(folder: Path, numbers: list[str], known: Objects | None = None) -> Objects:
    """Return the shards `numbers` of a folder, after those that are known already."""
    found = known or Objects([], [], [], [])
    for number in numbers[len(found.rows) :]:
        with np.load(folder / f"{number}.npz") as said:
            found.cameras.append(said["cameras"])
            found.backdrops.append(said["backdrops"])
            found.rows.append(json.loads(str(said["rows"])))
        found.latents.append(np.load(folder / f"{number}.npy", mmap_mode="r"))
    return found


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
    for i in range(count):
        shard = rng.integers(len(objects.rows))
        row = rng.integers(len(objects.rows[shard]))
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


class Model(nn.Module):
    """Both networks and the tokenizer: captions in, v out."""

    def __init__(self, tokenizer: ClipTokenizer, **shape: Any) -> None:
        super().__init__()
        self.tokenizer = tokenizer
        self.text_encoder = TextEncoder(tokenizer.engine.get_vocab_size())
        self.denoiser = Denoiser(**shape).to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(
        self, noised: Tensor, timesteps: Tensor, texts: list[str], cameras: Tensor, views: int
    ) -> Tensor:
        """(b, 4, h, w), (b,), b captions, (b, 10) to v (b, 4, h, w); equal captions are encoded once."""
        distinct = list(dict.fromkeys(texts))
        ids = torch.from_numpy(np.stack([self.tokenizer.encode(t) for t in distinct])).to(noised.device)
        place = {text: i for i, text in enumerate(distinct)}
        text = self.text_encoder(ids)[[place[t] for t in texts]]
        return self.denoiser(noised, timesteps, text, cameras, views)


def loss_of(model: Model, batch: Batch, abar: Tensor) -> Tensor:
    """Return the squared error of v, (b,), one number a row."""
    device = abar.device
    clean, noise, cameras = (
        torch.from_numpy(v).to(device) for v in (batch.clean, batch.noise, batch.cameras)
    )
    timesteps = torch.from_numpy(batch.timesteps).to(device)
    a = abar[timesteps].view(-1, 1, 1, 1)
    noised = (a.sqrt() * clean + (1 - a).sqrt() * noise).contiguous(memory_format=torch.channels_last)
    target = a.sqrt() * noise - (1 - a).sqrt() * clean
    with torch.autocast(device.type, torch.bfloat16, enabled=BFLOAT16):
        predicted = model(noised, timesteps, batch.texts, cameras, batch.views)
    return (predicted.float() - target).square().mean((1, 2, 3))


def make_optimisers(model: Model) -> tuple[Muon, torch.optim.AdamW]:
    """Return Muon for what multiplies inside, AdamW for the rest: ends, embeddings, biases, norms."""
    ends = ("denoiser.stem", "denoiser.head", "denoiser.camera.0", "denoiser.time.0", "tokens", "positions")
    inner = [p for n, p in model.named_parameters() if p.ndim >= 2 and not any(e in n for e in ends)]
    chosen = {id(p) for p in inner}
    outer = [p for p in model.parameters() if id(p) not in chosen]
    muon = Muon(inner, MUON_RATE, DECAY, torch.bfloat16 if BFLOAT16 else torch.float32)
    return muon, torch.optim.AdamW(outer, ADAM_RATE, betas=(0.9, 0.99), weight_decay=DECAY)


def held_out_figures(model: Model, objects: Objects, abar: Tensor) -> dict[str, list[float]]:
    """Return the loss at FIGURES_AT on held-out objects: told everything; a wrong or no camera, backdrop,
    text; and with every view alone."""
    count = min(sum(map(len, objects.rows)), 64)
    base = draw_batch(objects, 0, count)
    rng = np.random.default_rng(0)
    whole, texts = [], []
    for i in range(count):  # the same draws as draw_batch would make, with nothing left out
        shard, row = divmod(i * 7 % sum(map(len, objects.rows)), len(objects.rows[0]))
        views = np.arange(0, 2 * VIEWS, 2)
        word, _, *look = objects.rows[shard][row]
        text = caption(rng, BY_WORD[word], look_of(look))
        cameras = objects.cameras[shard][row, views]
        texts += [seen_from(text, float(c[0]), float(c[1])) for c in cameras]
        whole.append((np.asarray(objects.latents[shard][row, views], np.float32), cameras,
                      objects.backdrops[shard][row, views]))  # fmt: skip
    clean, cameras, backdrops = (np.concatenate(part) for part in zip(*whole, strict=True))
    yes, no = np.ones(len(clean), bool), np.zeros(len(clean), bool)
    turned = cameras + np.array([np.pi / 2, 0, 0, 0], np.float32)
    other = [*texts[VIEWS:], *texts[:VIEWS]]
    right = camera_rows(cameras, backdrops, yes, yes)
    arms: dict[str, tuple[list[str], np.ndarray, int]] = {
        "right": (texts, right, VIEWS),
        "wrong camera": (texts, camera_rows(turned, backdrops, yes, yes), VIEWS),
        "no camera": (texts, camera_rows(cameras, backdrops, no, yes), VIEWS),
        "no backdrop": (texts, camera_rows(cameras, backdrops, yes, no), VIEWS),
        "wrong text": (other, right, VIEWS),
        "no text": ([""] * len(texts), right, VIEWS),
        "views apart": (texts, right, 1),
    }
    figures: dict[str, list[float]] = {}
    for name, (said, told, seen) in arms.items():
        figures[name] = []
        for t in FIGURES_AT:
            level = np.full(len(clean), t)
            parts = [
                Batch(clean[s], base.noise[s], level[s], said[s], told[s], seen)
                for s in (slice(i, i + 64) for i in range(0, len(clean), 64))
            ]
            with torch.inference_mode():
                figures[name].append(
                    round(float(torch.cat([loss_of(model, p, abar) for p in parts]).mean()), 4)
                )
    return figures


def train(
    work: Path,
    steps: int,
    *,
    fall: int = 0,
    minutes: float = 0.0,
    figures_every: int = 2000,
    objects_a_step: int = OBJECTS,
    half_until: int = 0,
    state: str = "denoiser",
    compiled: bool = False,
    **shape: Any,
) -> None:
    """Train to `steps` in all, or for `minutes`; the state is saved every SAVE_EVERY."""
    torch.manual_seed(0)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    if not (work / "tokenizer" / "vocab.json").exists():
        train_tokenizer(
            work / "tokenizer", example_texts(60000), vocabulary_size=VOCABULARY, max_length=MAX_TOKENS
        )
    model = Model(load_tokenizer(work / "tokenizer"), **shape).to(device)
    average = {k: v.clone() for k, v in model.state_dict().items()}
    optimisers = make_optimisers(model)
    path, start, shards = work / f"{state}.state.pt", 0, 0
    if path.exists():
        saved = torch.load(path, weights_only=True, map_location=device)
        model.load_state_dict(saved["model"])
        for optimiser, content in zip(
            optimisers, saved.get("optimisers", ()), strict=False
        ):  # none after `restore`
            optimiser.load_state_dict(content)
        average, start, shards = saved["average"], saved["step"], saved["shards"]
    held_out = load_objects(work / "held_out_pictures", shard_numbers(work / "held_out_pictures"))
    if compiled:
        model.denoiser.compile()
    objects, abar = Objects([], [], [], []), alphas_cumprod().to(device)
    running, began, log = 0.0, time.monotonic(), work / f"{state}.log"
    for step in range(start, steps):
        if step % LOOK_FOR_SHARDS_EVERY == 0 or not objects.rows:
            numbers = shard_numbers(work / "pictures")
            shards = len(numbers) if step % LOOK_FOR_SHARDS_EVERY == 0 else shards
            objects = load_objects(work / "pictures", numbers[:shards], objects)
        batch = draw_batch(objects, step, objects_a_step)
        if step < half_until:
            batch = halved(batch)
        share = min(1.0, (step + 1) / WARM_UP) * (min(1.0, max(0.01, (steps - step) / fall)) if fall else 1.0)
        for optimiser, rate in zip(optimisers, (MUON_RATE, ADAM_RATE), strict=True):
            for group in optimiser.param_groups:
                group["lr"] = rate * share
        model.zero_grad(set_to_none=True)
        loss = loss_of(model, batch, abar).mean()
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        for optimiser in optimisers:
            optimiser.step()
        keep = min(1 - 1 / AVERAGED, (step + 1) / (step + 20))
        with torch.no_grad():
            for name, value in model.state_dict().items():
                average[name].lerp_(value, 1 - keep)
        running = 0.99 * running + 0.01 * float(loss.detach()) if running else float(loss.detach())
        done, spent = step + 1, time.monotonic() - began
        last = done == steps or (minutes > 0 and spent > 60 * minutes)
        if done % SAVE_EVERY == 0 or last:
            content = {"model": model.state_dict(), "optimisers": [o.state_dict() for o in optimisers],
                       "average": average, "step": done, "shards": shards}  # fmt: skip
            for target, value in ((path, content), (work / f"{state}.pt", average)):
                torch.save(value, f"{target}.new")
                os.replace(f"{target}.new", target)
            pace = (done - start) * objects_a_step * VIEWS / spent
            left = (steps - done) * spent / (done - start) / 60
            say(
                log,
                f"step {done} of {steps}, {shards} shards, loss {running:.4f}, {pace:.0f} rows a second, "
                f"{spent / 60:.1f} min, {left:.0f} left",
            )
        if held_out.rows and (done % figures_every == 0 or last):
            own = {k: v.clone() for k, v in model.state_dict().items()}
            model.load_state_dict(average)
            for name, values in held_out_figures(model, held_out, abar).items():
                say(log, f"step {done} {name}: " + " ".join(f"{v:.4f}" for v in values))
            model.load_state_dict(own)
        if last:
            break


def say(log: Path, text: str) -> None:
    """Print a line and keep it."""
    print(text, flush=True)
    with log.open("a") as file:
        file.write(text + "\n")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--fall", type=int, default=0, help="last steps over which the rates fall")
    parser.add_argument(
        "--half", type=int, default=0, help="first steps, at half the size and twice the pace"
    )
    parser.add_argument("--minutes", type=float, default=0.0, help="stop after so many; 0: at the last step")
    parser.add_argument("--threads", type=int, default=0, help="0: one a core")
    parser.add_argument(
        "--compile", action="store_true", help="with torch.compile: minutes at first, then an eighth faster"
    )
    options = parser.parse_args()
    if options.threads:
        torch.set_num_threads(options.threads)
    train(
        options.work,
        options.steps,
        fall=options.fall,
        minutes=options.minutes,
        half_until=options.half,
        compiled=options.compile,
    )


if __name__ == "__main__":
    main()
