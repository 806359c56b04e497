"""What the denoiser's training minimises: the squared error of v, both networks together."""

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from export.everyday_objects.networks.denoiser import Denoiser
from export.everyday_objects.networks.text_encoder import TextEncoder
from export.everyday_objects.train.batches import TIMESTEPS, Batch
from pipeline.diffusion.tokenizer import ClipTokenizer

BETAS = (0.00085, 0.012)
BFLOAT16 = torch.cuda.is_available() or torch.cpu._is_avx512_bf16_supported()


def alphas_cumprod() -> Tensor:
    """Stable Diffusion's scaled-linear schedule, (1000,) float32."""
    betas = torch.linspace(BETAS[0] ** 0.5, BETAS[1] ** 0.5, TIMESTEPS, dtype=torch.float64) ** 2
    return torch.cumprod(1 - betas, 0).float()


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
