"""Train the autoencoder on the rendered shards, then encode all of them: WORK/autoencoder.pt,
WORK/latents/NNN.npy.

`python -m export.everyday_objects.train_autoencoder WORK --steps 6000`; resumes from
WORK/autoencoder.state.pt. An autoencoder that `restore` took from the bundle is kept and only encodes.
"""

import argparse
import math
import os
from pathlib import Path

import numpy as np
import torch

from export.everyday_objects.autoencoder import Decoder, Encoder, autoencoder_loss
from pipeline.stage import Progress


def to_batch(images: np.ndarray) -> torch.Tensor:
    """(b, h, w, 3) uint8 to (b, 3, h, w) float32 in [0, 1], channels last in memory."""
    return (torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255).contiguous(
        memory_format=torch.channels_last
    )


def train(work: Path, steps: int, batch: int = 16, rate: float = 1.5e-3) -> tuple[Encoder, Decoder]:
    """Train for `steps` in all (cosine decay), saving the state every 500."""
    torch.manual_seed(0)
    encoder = Encoder().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    decoder = Decoder().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    parameters = [*encoder.parameters(), *decoder.parameters()]
    optimiser = torch.optim.AdamW(parameters, rate, weight_decay=1e-4)
    state, start = work / "autoencoder.state.pt", 0
    if state.exists():
        saved = torch.load(state, weights_only=True)
        encoder.load_state_dict(saved["encoder"])
        decoder.load_state_dict(saved["decoder"])
        optimiser.load_state_dict(saved["optimiser"])
        start = saved["step"]
    shards = [np.load(p, mmap_mode="r") for p in sorted((work / "shards").glob("*.npy"))]
    average = 0.0
    with Progress("autoencoder", steps, "steps") as progress:
        for step in range(start, steps):
            rng = np.random.default_rng([7, step])
            shard = shards[rng.integers(len(shards))]
            images = to_batch(shard[np.sort(rng.choice(len(shard), batch, replace=False))])
            for group in optimiser.param_groups:
                group["lr"] = (
                    rate * min(1.0, (step + 1) / 100) * (0.51 + 0.49 * math.cos(math.pi * step / steps))
                )
            with torch.autocast("cpu", torch.bfloat16, enabled=torch.cpu._is_avx512_bf16_supported()):
                loss, mse = autoencoder_loss(encoder, decoder, images)
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(parameters, 1.0)
            optimiser.step()
            average = 0.98 * average + 0.02 * mse.item() if average else mse.item()
            progress.update(step + 1, f"loss {loss.item():.4f} psnr {-10 * np.log10(average):.2f} dB")
            if (step + 1) % 500 == 0 or step + 1 == steps:
                saved = {"encoder": encoder.state_dict(), "decoder": decoder.state_dict(),
                         "optimiser": optimiser.state_dict(), "step": step + 1}  # fmt: skip
                torch.save(saved, f"{state}.new")
                os.replace(f"{state}.new", state)
    return encoder.eval(), decoder.eval()


@torch.no_grad()
def encode_shards(encoder: Encoder, work: Path) -> None:
    """Write the latents of every shard as (n, 4, 32, 32) float16."""
    (work / "latents").mkdir(exist_ok=True)
    for path in sorted((work / "shards").glob("*.npy")):
        target = work / "latents" / path.name
        if target.exists() or not path.with_suffix(".json").exists():
            continue
        images = np.load(path, mmap_mode="r")
        parts = [encoder(to_batch(images[i : i + 64])).half().numpy() for i in range(0, len(images), 64)]
        with open(f"{target}.new", "wb") as file:
            np.save(file, np.concatenate(parts))
        os.replace(f"{target}.new", target)


@torch.no_grad()
def held_out_psnr(encoder: Encoder, decoder: Decoder, work: Path) -> float:
    """Mean over pictures of the PSNR [dB] of held-out objects."""
    images = np.load(work / "held_out" / "000.npy")
    psnr = []
    for i in range(0, len(images), 50):
        batch = to_batch(images[i : i + 50])
        mse = (decoder(encoder(batch)).clamp(0, 1) - batch).square().mean((1, 2, 3))
        psnr.append(-10 * torch.log10(mse))
    return float(torch.cat(psnr).mean())


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--steps", type=int, default=6000)
    options = parser.parse_args()
    finished, state = options.work / "autoencoder.pt", options.work / "autoencoder.state.pt"
    if finished.exists() and not state.exists():  # as `restore` leaves it: nothing to train on from
        saved = torch.load(finished, weights_only=True)
        encoder, decoder = Encoder(), Decoder()
        encoder.load_state_dict(saved["encoder"])
        decoder.load_state_dict(saved["decoder"])
        encoder, decoder = encoder.eval(), decoder.eval()
    else:
        encoder, decoder = train(options.work, options.steps)
        torch.save({"encoder": encoder.state_dict(), "decoder": decoder.state_dict()}, finished)
    print(f"held-out objects: {held_out_psnr(encoder, decoder, options.work):.2f} dB")
    encode_shards(encoder, options.work)


if __name__ == "__main__":
    main()
