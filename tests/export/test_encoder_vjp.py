"""The exported input gradient of a VAE encoder equals autograd's, and the runtime's scalings are its own."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from diffusers import AutoencoderKL, AutoencoderTiny
from torch import Tensor, nn

from export.encoder_vjp import export_encoder_vjp
from pipeline.diffusion.sessions import vae_encoder_vjp

SIZE, SCALE = 32, 0.3


class Mean(nn.Module):
    """A real VAE encoder, small: convolutions, group norm, attention, a stride-2 convolution with padding."""

    def __init__(self) -> None:
        super().__init__()
        self.vae: Any = AutoencoderKL(
            down_block_types=["DownEncoderBlock2D"] * 2, up_block_types=["UpDecoderBlock2D"] * 2,
            block_out_channels=[8, 16], norm_num_groups=4, layers_per_block=1,
        )  # fmt: skip

    def forward(self, sample: Tensor) -> Tensor:
        mean: Tensor = self.vae.encode(sample).latent_dist.mean
        return mean


class Full(Mean):
    """Stable Diffusion's encoder in full size: 34 million parameters."""

    def __init__(self) -> None:
        nn.Module.__init__(self)
        self.vae = AutoencoderKL(
            down_block_types=["DownEncoderBlock2D"] * 4, up_block_types=["UpDecoderBlock2D"],
            block_out_channels=[128, 256, 512, 512], layers_per_block=2,
        )  # fmt: skip
        assert sum(p.numel() for p in self.vae.encoder.parameters()) > 34e6


class Tiny(nn.Module):
    """TAESD's encoder: ReLU, and stride-2 convolutions of an odd padding."""

    def __init__(self) -> None:
        super().__init__()
        self.vae: Any = AutoencoderTiny(
            encoder_block_out_channels=[8] * 3, decoder_block_out_channels=[8] * 3,
            num_encoder_blocks=[1] * 3, num_decoder_blocks=[1] * 3,
        )  # fmt: skip

    def forward(self, sample: Tensor) -> Tensor:
        latents: Tensor = self.vae.encode(sample).latents
        return latents


class Repeating(nn.Module):
    """Convolutions that repeat the edge, as the default model's encoder has them."""

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.PixelUnshuffle(4), nn.Conv2d(48, 8, 3, padding=1, padding_mode="replicate"), nn.SiLU(),
            nn.Conv2d(8, 4, 3, padding=(1, 2), padding_mode="replicate"),
        )  # fmt: skip

    def forward(self, sample: Tensor) -> Tensor:
        latents: Tensor = self.body(sample)
        return latents


def picture(seed: int) -> Tensor:
    return torch.rand(1, 3, SIZE, SIZE, generator=torch.Generator().manual_seed(seed)) * 2 - 1


@pytest.mark.parametrize("kind", [Mean, pytest.param(Full, marks=pytest.mark.thorough), Tiny, Repeating])
def test_it_equals_autograd_through_the_runtime(kind: type[nn.Module], tmp_path: Path) -> None:
    torch.manual_seed(0)
    encoder = kind().eval()
    folder = tmp_path / "vae_encoder_vjp"
    assert export_encoder_vjp(encoder, picture(0), folder) < 1e-5
    (folder / "config.json").write_text(json.dumps({"scaling_factor": SCALE}))

    image = ((picture(1) + 1) / 2).requires_grad_(True)
    latents = encoder(image * 2 - 1) * SCALE
    cotangent = torch.randn(latents.shape, generator=torch.Generator().manual_seed(2))
    (expected,) = torch.autograd.grad(latents, image, cotangent)
    with vae_encoder_vjp(folder) as pull_back:
        found = pull_back(image.detach().permute(0, 2, 3, 1).numpy(), cotangent.numpy())
    wanted = expected.permute(0, 2, 3, 1).numpy()
    assert np.abs(wanted).max() > 0.005
    np.testing.assert_allclose(found, wanted, atol=1e-5 * np.abs(wanted).max())

    # At 512 pixels, a stored tensor of the size of the first activations would take 134 MB.
    graph = onnx.load(folder / "model.onnx").graph
    largest_weight = max(parameter.numel() for parameter in encoder.parameters())
    assert max(int(np.prod(tensor.dims)) for tensor in graph.initializer) <= largest_weight
