"""Train the denoiser and the text encoder together on the encoded shards; keeps a moving average of the
weights.

`python -m export.everyday_objects.train_denoiser WORK --steps 10000` writes WORK/denoiser.pt (the average,
what is exported) and resumes from WORK/denoiser.state.pt. The rate is constant, then falls linearly over the
last fifth of `--steps`: a longer training goes on from any state that was saved before its fall, or after it.
"""

import argparse
import json
import os
from collections import Counter
from pathlib import Path

import numpy as np
import torch

from export.bundle_files import train_tokenizer
from export.everyday_objects.captions import caption
from export.everyday_objects.denoiser import Denoiser
from export.everyday_objects.nouns import NOUNS
from export.everyday_objects.text_encoder import MAX_TOKENS, TextEncoder
from pipeline.diffusion.prompts import view_table
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.stage import Progress

BETAS = (0.00085, 0.012)
TIMESTEPS = 1000
CAPTION_DROPOUT = 0.1
VIEWS = view_table("eight")
VIEW_SIZE, VIEW_WEIGHT = 6.0, 0.05
# Several times faster where the processor multiplies bfloat16, ten times slower where it must be emulated.
BFLOAT16 = torch.cpu._is_avx512_bf16_supported()
BY_WORD = {n.words[0]: n for n in NOUNS}


def alphas_cumprod() -> torch.Tensor:
    """Stable Diffusion's scaled-linear schedule, (1000,) float32."""
    betas = torch.linspace(BETAS[0] ** 0.5, BETAS[1] ** 0.5, TIMESTEPS, dtype=torch.float64) ** 2
    return torch.cumprod(1 - betas, 0).float()


def load_pictures(work: Path) -> tuple[np.ndarray, list[dict]]:
    """All latents (n, 4, 32, 32) float16 and what they show."""
    paths = sorted((work / "latents").glob("*.npy"))
    rows = [row for p in paths for row in json.loads((work / "shards" / f"{p.stem}.json").read_text())]
    return np.concatenate([np.load(p) for p in paths]), rows


def cumulative_shares(rows: list[dict]) -> np.ndarray:
    """Cumulative probabilities (n,) of the pictures: nouns by their weights, whatever the shards hold."""
    counts = Counter(row["noun"] for row in rows)
    shares = np.cumsum([BY_WORD[row["noun"]].weight / counts[row["noun"]] for row in rows])
    return shares / shares[-1]


def view_harmonics(text: str) -> np.ndarray:
    """What the view words of a caption say, (5,): sine and cosine of the azimuth and of twice it, and 1 for
    overhead; zeros without view words.
    """
    view = text.rpartition(", ")[2]
    if view not in VIEWS:
        return np.zeros(5, np.float32)
    azimuth = 2 * np.pi * (VIEWS.index(view) % 8) / 8
    turns = np.array([1, 2]) * azimuth
    return np.array([*np.sin(turns), *np.cos(turns), VIEWS.index(view) >= 8], np.float32)


def view_loss(text: torch.Tensor, captions: list[str]) -> torch.Tensor:
    """Mean squared distance of what the mean embedding of (b, l, d) says of the view from what the captions
    say.

    Read through fixed directions, so that the words must move the embedding and not a reader's weights.
    Without this the text encoder settled on kinds and colours alone: after 8,000 steps "front view" and "back
    view" gave the same embedding, and the denoiser was never told which side it saw.
    """
    generator = torch.Generator().manual_seed(3)
    directions, _ = torch.linalg.qr(torch.randn(text.shape[-1], 5, generator=generator))
    wanted = torch.from_numpy(np.stack([view_harmonics(c) for c in captions]))
    return (text.float().mean(dim=1) @ directions / VIEW_SIZE - wanted).square().mean()


def draw_caption(rng: np.random.Generator, row: dict) -> str:
    """A fresh caption of a picture, or none for the unconditional branch."""
    if rng.random() < CAPTION_DROPOUT:
        return ""
    return caption(rng, BY_WORD[row["noun"]], row["look"], row["azimuth"], row["polar"])


def draw_timesteps(rng: np.random.Generator, batch: int) -> np.ndarray:
    """Draw (batch,) int64 timesteps, one in each of `batch` strata: less variance than free draws.

    The lowest fifth, which score distillation never visits and sampling needs least, gets a tenth of them,
    the highest three tenths, where the words and not the picture say what is seen and from where, half.
    """
    strata = (np.arange(batch) + rng.random(batch)) / batch
    return np.interp(strata, [0, 0.1, 0.5, 1], np.array([0, 0.2, 0.7, 1]) * TIMESTEPS).astype(np.int64)


def train(work: Path, steps: int, batch: int = 64, rate: float = 6e-4) -> None:
    """Train to `steps` in all; the state is saved every 100."""
    torch.manual_seed(0)
    latents, rows = load_pictures(work)
    if not (work / "tokenizer" / "vocab.json").exists():
        rng = np.random.default_rng(1)
        texts = [draw_caption(rng, rows[i % len(rows)]) for i in range(40000)]
        train_tokenizer(work / "tokenizer", texts, vocabulary_size=900, max_length=MAX_TOKENS)
    tokenizer = load_tokenizer(work / "tokenizer")
    text_encoder = TextEncoder(tokenizer.engine.get_vocab_size())
    denoiser = Denoiser().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    networks = {"text_encoder": text_encoder, "denoiser": denoiser}
    average = {f"{n}.{k}": v.clone() for n, net in networks.items() for k, v in net.state_dict().items()}
    parameters = [p for net in networks.values() for p in net.parameters()]
    optimiser = torch.optim.AdamW(parameters, rate, betas=(0.9, 0.99), weight_decay=0.01, fused=True)
    state, start = work / "denoiser.state.pt", 0
    if state.exists():
        saved = torch.load(state, weights_only=True)
        for n, net in networks.items():
            net.load_state_dict(saved[n])
        average, start = saved["average"], saved["step"]
        if "optimiser" in saved:  # absent after `restore`
            optimiser.load_state_dict(saved["optimiser"])
    shares = cumulative_shares(rows)
    abar = alphas_cumprod()
    running = 0.0
    with Progress("denoiser", steps, "steps") as progress:
        for step in range(start, steps):
            rng = np.random.default_rng([11, step])
            picks = np.searchsorted(shares, rng.random(batch), side="right")
            captions = [draw_caption(rng, rows[i]) for i in picks]
            ids = np.stack([tokenizer.encode(c) for c in captions])
            clean = torch.from_numpy(latents[picks].astype(np.float32))
            t = torch.from_numpy(draw_timesteps(rng, batch))
            noise = torch.from_numpy(rng.standard_normal(clean.shape, np.float32))
            a = abar[t].view(-1, 1, 1, 1)
            noised, target = (
                a.sqrt() * clean + (1 - a).sqrt() * noise,
                a.sqrt() * noise - (1 - a).sqrt() * clean,
            )
            fall = min(1.0, max(0.02, (steps - step) / (0.2 * steps)))
            for group in optimiser.param_groups:
                group["lr"] = rate * min(1.0, (step + 1 - start) / 100) * fall
            with torch.autocast("cpu", torch.bfloat16, enabled=BFLOAT16):
                text = text_encoder(torch.from_numpy(ids))
                predicted = denoiser(noised.contiguous(memory_format=torch.channels_last), t, text)
            loss = (predicted.float() - target).square().mean()
            optimiser.zero_grad()
            (loss + VIEW_WEIGHT * view_loss(text, captions)).backward()
            torch.nn.utils.clip_grad_norm_(parameters, 1.0)
            optimiser.step()
            decay = min(0.9985, (step + 1 - start) / (step + 20 - start))
            for n, net in networks.items():
                for k, v in net.state_dict().items():
                    average[f"{n}.{k}"].lerp_(v, 1 - decay)
            running = 0.99 * running + 0.01 * loss.item() if running else loss.item()
            progress.update(step + 1, f"loss {running:.4f}")
            if (step + 1) % 100 == 0 or step + 1 == steps:
                save(work, networks, average, optimiser, step + 1)


def save(work: Path, networks: dict, average: dict, optimiser: torch.optim.Optimizer, step: int) -> None:
    """Write state and average, each atomically."""
    state = {**{n: net.state_dict() for n, net in networks.items()}, "average": average, "step": step}
    for name, content in (
        ("denoiser.state.pt", {**state, "optimiser": optimiser.state_dict()}),
        ("denoiser.pt", average),
    ):
        torch.save(content, work / f"{name}.new")
        os.replace(work / f"{name}.new", work / name)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--steps", type=int, default=10000)
    options = parser.parse_args()
    train(options.work, options.steps)


if __name__ == "__main__":
    main()
