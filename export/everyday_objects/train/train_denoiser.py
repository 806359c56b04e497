"""Train the denoiser and the text encoder together on the encoded pictures; keep a moving average of the
weights.

`python -m export.everyday_objects.train.train_denoiser WORK --steps 100000` reads the shards of
WORK/pictures, new ones as they come, writes WORK/denoiser.pt (the average, what is exported), and goes on
from WORK/denoiser.state.pt to the same weights as if it had never been stopped. The rates are constant, with
a fall over the last `--fall` steps where that is given: a longer training goes on from a state that was saved
before its fall. With CUDA it runs there, in bfloat16.
"""

import argparse
import os
import time
from pathlib import Path
from typing import Any

import torch
from torch import nn

from export.bundle_files import train_tokenizer
from export.everyday_objects.data.captions import example_texts
from export.everyday_objects.networks.text_encoder import MAX_TOKENS
from export.everyday_objects.train.batches import (
    OBJECTS,
    VIEWS,
    Objects,
    draw_batch,
    halved,
    load_objects,
    shard_numbers,
)
from export.everyday_objects.train.figures import held_out_figures
from export.everyday_objects.train.loss import BFLOAT16, Model, alphas_cumprod, loss_of
from export.everyday_objects.train.muon import Muon
from pipeline.diffusion.tokenizer import load_tokenizer

VOCABULARY = 2000
MUON_RATE, ADAM_RATE, DECAY, WARM_UP = 0.007, 5e-4, 0.01, 200
"""At 0.02 and 1e-3 the first bundle's loss fell from .376 to .366 in its steps 3,000 to 4,000, and to .327 in
the 1,800 over which the rates fell to nothing: they were too high for what comes after the start. From step
23,400 of the second, 350 steps at 3, 1 and 0.35 times these end at .086, .072 and .070 (the first two after
150 more, the rates falling): from there on `--rates 0.35`."""
AVERAGED = 1000
"""Steps that the moving average looks back on."""
SAVE_EVERY, LOOK_FOR_SHARDS_EVERY = 200, 200


def make_optimisers(model: Model) -> tuple[Muon, torch.optim.AdamW]:
    """Return Muon for what multiplies inside, AdamW for the rest: ends, embeddings, biases, norms."""
    ends = ("denoiser.stem", "denoiser.head", "denoiser.camera.0", "denoiser.time.0", "tokens", "positions")
    inner = [p for n, p in model.named_parameters() if p.ndim >= 2 and not any(e in n for e in ends)]
    chosen = {id(p) for p in inner}
    outer = [p for p in model.parameters() if id(p) not in chosen]
    muon = Muon(inner, MUON_RATE, DECAY, torch.bfloat16 if BFLOAT16 else torch.float32)
    return muon, torch.optim.AdamW(outer, ADAM_RATE, betas=(0.9, 0.99), weight_decay=DECAY)


def train(
    work: Path,
    steps: int,
    *,
    fall: int = 0,
    rates: float = 1.0,
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
            shards = len(numbers) if step % LOOK_FOR_SHARDS_EVERY == 0 or not shards else shards
            objects = load_objects(work / "pictures", numbers[:shards], objects)
        batch = draw_batch(objects, step, objects_a_step)
        if step < half_until:
            batch = halved(batch)
        share = rates * min(1.0, (step + 1) / WARM_UP)
        share *= min(1.0, max(0.01, (steps - step) / fall)) if fall else 1.0
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
    parser.add_argument("--rates", type=float, default=1.0, help="times the usual rates; see MUON_RATE")
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
        rates=options.rates,
        minutes=options.minutes,
        half_until=options.half,
        compiled=options.compile,
    )


if __name__ == "__main__":
    main()
