"""The VAE as graphs: decoder, encoder, and the encoder's input gradient.

AutoencoderKL has a distribution for latents, of which the graph gives mean and log-variance (Optimum's
`latent_parameters`, 2 c channels); AutoencoderTiny (TAESD) has plain latents (`latent_sample`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from export.attention import fuse_attention
from export.encoder_vjp import export_encoder_vjp
from export.graph import export_graph


class DecoderGraph(nn.Module):
    """Latents (b, c, h, w), without the latent scale, to pictures (b, 3, H, W) in [-1, 1]."""

    def __init__(self, vae: Any) -> None:
        super().__init__()
        self.vae = vae

    def forward(self, latent_sample: Tensor) -> Tensor:
        """Decode."""
        picture: Tensor = self.vae.decode(latent_sample, return_dict=False)[0]
        return picture


class EncoderGraph(nn.Module):
    """Pictures in [-1, 1] to mean and log-variance, or to plain latents."""

    def __init__(self, vae: Any) -> None:
        super().__init__()
        self.vae = vae

    def forward(self, sample: Tensor) -> Tensor:
        """Encode."""
        result = self.vae.encode(sample, return_dict=False)[0]
        # The distribution's own parameters, before it clamps the log-variance.
        return getattr(result, "parameters", result)


class MeanEncoder(nn.Module):
    """Pictures in [-1, 1] to the mean latents: what the runtime's `vae_encoder` takes of the graph."""

    def __init__(self, vae: Any) -> None:
        super().__init__()
        self.graph = EncoderGraph(vae)
        self.channels = vae.config.latent_channels

    def forward(self, sample: Tensor) -> Tensor:
        """Encode."""
        return self.graph(sample)[:, : self.channels]


def downsampling(vae: Any) -> int:
    """Return the image pixels a latent pixel, along a side."""
    config = vae.config
    blocks = config.get("block_out_channels") or config.get("encoder_block_out_channels")
    return 2 ** (len(config.get("encoder_block_out_channels") or blocks) - 1)


def export_decoder(
    vae: Any,
    size: int,
    folder: Path,
    *,
    fixed: bool = False,
    half_weights: bool = False,
    tolerance: float = 1e-4,
) -> float:
    """Write `vae_decoder`; return its largest difference from torch. `size`: side of the latents, pixels.

    `fixed`: one picture of that size alone. Errors as `export_graph`. Attention layers are replaced.
    """
    fuse_attention(vae)
    channels = vae.config.latent_channels
    generator = torch.Generator().manual_seed(0)
    count = 1 if fixed else 2
    # Dynamic sizes are traced at a small picture: the graph is the same, the check cheaper.
    side = size if fixed else min(size, 16)
    example = torch.randn(count, channels, side, side, generator=generator)
    other = torch.randn(1, channels, side // 2, side, generator=generator)
    return export_graph(
        DecoderGraph(vae),
        {"latent_sample": example},
        ["sample"],
        folder,
        dynamic_axes={} if fixed else {"latent_sample": {0: "batch", 2: "height", 3: "width"}},
        check_inputs=[] if fixed else [{"latent_sample": other}],
        half_weights=half_weights,
        tolerance=tolerance,
    )


def export_encoder(
    vae: Any,
    size: int,
    folder: Path,
    *,
    fixed: bool = False,
    half_weights: bool = False,
    tolerance: float = 1e-4,
) -> float:
    """Write `vae_encoder`; as `export_decoder`, but `size` is the side of the pictures."""
    fuse_attention(vae)
    generator = torch.Generator().manual_seed(0)
    side = size if fixed else min(size, 16 * downsampling(vae))
    count = 1 if fixed else 2
    example = torch.rand(count, 3, side, side, generator=generator) * 2 - 1
    other = torch.rand(1, 3, side // 2, side, generator=generator) * 2 - 1
    output = "latent_parameters" if hasattr(vae, "quant_conv") else "latent_sample"
    return export_graph(
        EncoderGraph(vae),
        {"sample": example},
        [output],
        folder,
        dynamic_axes={} if fixed else {"sample": {0: "batch", 2: "height", 3: "width"}},
        check_inputs=[] if fixed else [{"sample": other}],
        half_weights=half_weights,
        tolerance=tolerance,
    )


def export_vjp(
    vae: Any, size: int, folder: Path, *, half_weights: bool = False, tolerance: float = 1e-4
) -> float:
    """Write `vae_encoder_vjp` for one picture of side `size`; see encoder_vjp.py."""
    fuse_attention(vae)  # its torch branch is attention that the tracer can differentiate
    sample = torch.rand(1, 3, size, size, generator=torch.Generator().manual_seed(0)) * 2 - 1
    return export_encoder_vjp(
        MeanEncoder(vae), sample, folder, half_weights=half_weights, tolerance=tolerance
    )
