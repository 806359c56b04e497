"""Train the autoencoder on pictures of the objects: `python -m
export.everyday_objects.train.train_autoencoder WORK`.

Writes WORK/autoencoder.pt and goes on from WORK/autoencoder.state.pt, or else from the weights of a
WORK/autoencoder.pt that is there already (`train.restore` takes one from the bundle). What a scene shows are
latents that were rendered, also at twice the training size, when its texture is baked: so the decoder learns
to make a picture of 256 pixels out of enlarged latents of one of 128, beside giving back pictures of 128.
With `--decoder` it alone is trained, from WORK/decoder.state.pt or WORK/autoencoder.pt on.
"""

import argparse
import math
import multiprocessing
import os
import time
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from export.everyday_objects.data.pictures import IMAGE_SIZE, draw_object
from export.everyday_objects.networks.autoencoder import (
    Decoder,
    Encoder,
    autoencoder_loss,
    blur_detail,
    quieten_detail,
)
from export.everyday_objects.train.muon import Muon

MUON_RATE, ADAM_RATE, DECAY = 0.01, 1e-3, 1e-4
ENLARGED = 2
"""Pictures of a batch that are also decoded at twice the size."""
QUIETENED_ON = 200
"""Pictures by which the spread of detail is known."""
SAVE_EVERY = 250
BFLOAT16 = torch.cpu._is_avx512_bf16_supported()


def _draw(seed: int) -> np.ndarray:
    """Two views of an object, (2, 256, 256, 3) uint8."""
    pictures = draw_object(np.random.default_rng([3, seed]), size=2 * IMAGE_SIZE, views=2)[2]
    return np.round(pictures * 255).astype(np.uint8)


def draw_pool(path: Path, count: int) -> np.ndarray:
    """Return (count, 256, 256, 3) uint8 pictures, drawn once and kept in a file."""
    if not path.exists():
        with multiprocessing.get_context("fork").Pool(os.cpu_count()) as pool:
            pictures = np.concatenate(list(pool.imap(_draw, range(count // 2), chunksize=20)))
        np.save(f"{path}.new.npy", pictures)
        os.replace(f"{path}.new.npy", path)
    return np.load(path, mmap_mode="r")


def to_batch(pictures: np.ndarray) -> Tensor:
    """(n, h, w, 3) uint8 to (n, 3, h, w) float32 in [0, 1], channels last in memory."""
    return torch.from_numpy(np.array(pictures)).permute(0, 3, 1, 2).float() / 255


def loss_of(encoder: Encoder, decoder: Decoder, large: Tensor) -> tuple[Tensor, Tensor]:
    """Return the loss of pictures (b, 3, 256, 256) and the squared error of the plain reconstruction at half
    the size.
    """
    small = F.avg_pool2d(large, 2)
    loss, mse = autoencoder_loss(encoder, decoder, small)
    latents = encoder(small[:ENLARGED])
    latents = blur_detail(decoder, latents)
    enlarged = F.interpolate(latents, scale_factor=2.0, mode="bilinear", align_corners=False)
    error = decoder(enlarged + 0.05 * torch.randn_like(enlarged)).float() - large[:ENLARGED]
    return loss + 0.25 * (error.abs().mean() + 2 * error.square().mean()), mse


def train(
    work: Path, steps: int, batch: int = 16, pool: int = 12_000, decoder_alone: bool = False
) -> tuple[Encoder, Decoder]:
    """Train for `steps` in all, the rates falling as a cosine; `decoder_alone`: latents stay as they are."""
    torch.manual_seed(0)
    encoder = Encoder().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    decoder = Decoder().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    if decoder_alone:
        encoder.eval().requires_grad_(False)
    named = [*encoder.named_parameters(), *decoder.named_parameters()]
    named = [(name, p) for name, p in named if p.requires_grad]
    inner = [
        p for n, p in named if p.ndim == 4 and p.shape[2] == 3 and p.shape[1] != 48 and "fine.1" not in n
    ]
    chosen = {id(p) for p in inner}
    muon = Muon(inner, MUON_RATE, DECAY, torch.float32)
    adam = torch.optim.AdamW([p for _, p in named if id(p) not in chosen], ADAM_RATE, weight_decay=DECAY)
    state, start = work / ("decoder.state.pt" if decoder_alone else "autoencoder.state.pt"), 0
    if state.exists():
        saved = torch.load(state, weights_only=True)
        encoder.load_state_dict(saved["encoder"])
        decoder.load_state_dict(saved["decoder"])
        muon.load_state_dict(saved["muon"])
        adam.load_state_dict(saved["adam"])
        start = saved["step"]
    elif (work / "autoencoder.pt").exists():
        encoder.load_state_dict(torch.load(work / "autoencoder.pt", weights_only=True)["encoder"])
        decoder.load_state_dict(torch.load(work / "autoencoder.pt", weights_only=True)["decoder"])
    pictures = draw_pool(work / "autoencoder_pictures.npy", pool)
    average, began = 0.0, time.monotonic()
    for step in range(start, steps):
        rng = np.random.default_rng([7, step])
        large = to_batch(pictures[np.sort(rng.choice(len(pictures), batch, replace=False))])
        share = min(1.0, (step + 1) / 100) * (0.51 + 0.49 * math.cos(math.pi * step / steps))
        for optimiser, rate in ((muon, MUON_RATE), (adam, ADAM_RATE)):
            for group in optimiser.param_groups:
                group["lr"] = rate * share
            optimiser.zero_grad()
        with torch.autocast("cpu", torch.bfloat16, enabled=BFLOAT16):
            loss, mse = loss_of(encoder, decoder, large)
        loss.backward()
        torch.nn.utils.clip_grad_norm_([p for _, p in named], 1.0)
        muon.step()
        adam.step()
        average = 0.98 * average + 0.02 * float(mse) if average else float(mse)
        if (step + 1) % SAVE_EVERY == 0 or step + 1 == steps:
            parts = {"encoder": encoder, "decoder": decoder, "muon": muon, "adam": adam}
            saved = {name: part.state_dict() for name, part in parts.items()}
            torch.save({**saved, "step": step + 1}, f"{state}.new")
            os.replace(f"{state}.new", state)
            quality, minutes = -10 * math.log10(average), (time.monotonic() - began) / 60
            loss_now = float(loss.detach())
            print(
                f"step {step + 1} of {steps}: loss {loss_now:.4f}, {quality:.2f} dB, {minutes:.1f} min",
                flush=True,
            )
    if not decoder_alone:
        examples = to_batch(pictures[:: max(1, len(pictures) // QUIETENED_ON)])
        quieten_detail(encoder, decoder, F.avg_pool2d(examples, 2))
    return encoder.eval(), decoder.eval()


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--threads", type=int, default=0, help="0: one a core")
    parser.add_argument(
        "--decoder",
        action="store_true",
        help="the decoder alone: latents, and what was trained on them, stay",
    )
    options = parser.parse_args()
    if options.threads:
        torch.set_num_threads(options.threads)
    options.work.mkdir(parents=True, exist_ok=True)
    encoder, decoder = train(options.work, options.steps, decoder_alone=options.decoder)
    torch.save(
        {"encoder": encoder.state_dict(), "decoder": decoder.state_dict()}, options.work / "autoencoder.pt"
    )


if __name__ == "__main__":
    main()
