"""The autoencoder: 128 px pictures to 32 x 32 latents of 4 channels and back, by convolutions alone.

Convolutions repeat the picture's edge: with zeros beyond it the two outermost rings of latents were off by
more than their spread, a frame that the denoiser learnt and that no rendered latents have. The latents of a
flat picture are flat now.

The latents have about unit variance (a batch normalisation without parameters ends the encoder; its running
statistics are constants in the exported graph), so the bundle's latent scale is 1. Three of their four
directions are a colour; the fourth is detail below a latent pixel, and is kept quiet (`quieten_detail`).
"""

import torch
from torch import Tensor, nn
from torch.nn import functional as F

LATENT_CHANNELS = 4
FACTOR = 4  # picture pixels a latent pixel
LARGEST = 3.0
"""Absolute latents that pictures should stay below: outliers are bounded away in score distillation."""
DETAIL = 0.25
"""Standard deviation of latents along the direction that is no colour."""


def zero(layer: nn.Conv2d | nn.Linear) -> None:
    """Let a layer start as nothing, so that the block around it starts as the identity."""
    for parameter in layer.parameters():
        nn.init.zeros_(parameter)


class Residual(nn.Module):
    """Two 3 x 3 convolutions beside the identity; starts as the identity."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1, padding_mode="replicate")
        self.second = nn.Conv2d(channels, channels, 3, padding=1, padding_mode="replicate")
        zero(self.second)

    def forward(self, x: Tensor) -> Tensor:
        """(b, c, h, w) to the same shape."""
        return x + self.second(F.silu(self.first(F.silu(x))))


class Encoder(nn.Module):
    """Pictures (b, 3, 4h, 4w) in [0, 1] to latents (b, 4, h, w) of unit variance."""

    def __init__(self, channels: int = 64, blocks: int = 3) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.PixelUnshuffle(FACTOR),
            nn.Conv2d(3 * FACTOR**2, channels, 3, padding=1, padding_mode="replicate"),
            *(Residual(channels) for _ in range(blocks)),
            nn.Conv2d(channels, LATENT_CHANNELS, 1),
        )
        self.whiten = nn.BatchNorm2d(LATENT_CHANNELS, affine=False, momentum=0.02)

    def forward(self, images: Tensor) -> Tensor:
        """Encode."""
        return self.whiten(self.body(images * 2 - 1).float())


class Decoder(nn.Module):
    """Latents (b, 4, h, w) to pictures (b, 3, 4h, 4w), about [0, 1] but not clamped."""

    def __init__(self, channels: int = 64, blocks: int = 3, fine_channels: int = 32) -> None:
        super().__init__()
        self.coarse = nn.Sequential(
            nn.Conv2d(LATENT_CHANNELS, channels, 3, padding=1, padding_mode="replicate"),
            *(Residual(channels) for _ in range(blocks)),
            nn.Conv2d(channels, 4 * fine_channels, 3, padding=1, padding_mode="replicate"),
            nn.PixelShuffle(2),
        )
        self.fine = nn.Sequential(
            Residual(fine_channels),
            nn.Conv2d(fine_channels, 12, 3, padding=1, padding_mode="replicate"),
            nn.PixelShuffle(2),
        )
        self.linear = nn.Conv2d(LATENT_CHANNELS, 3, 1)

    def forward(self, latents: Tensor) -> Tensor:
        """Decode: a linear picture of the latents, enlarged, plus the detail."""
        base = F.interpolate(self.linear(latents), scale_factor=FACTOR, mode="bilinear", align_corners=False)
        return base + self.fine(self.coarse(latents))


def no_colour(decoder: Decoder) -> Tensor:
    """Return the unit vector (4,) of latents that the linear picture does not show."""
    return torch.linalg.svd(decoder.linear.weight.detach()[:, :, 0, 0].float())[2][-1]


@torch.no_grad()
def quieten_detail(encoder: Encoder, decoder: Decoder, images: Tensor) -> None:
    """Scale the latents along `no_colour` to a standard deviation of DETAIL on images (b, 3, h, w), and undo
    it in the decoder: pictures stay what they are.

    At unit variance like the colours, this direction was white noise to the denoiser (neighbours correlate by
    .2, colours by .95) and three quarters of what it minimised; leaving it out altogether costs the decoder
    3.4 of 31.7 dB. Quiet, it drowns in the noise of all levels but the lowest.
    """
    direction = no_colour(decoder)
    scale = DETAIL / float(torch.einsum("c,bchw->bhw", direction, encoder.eval()(images)).std())
    outer = torch.outer(direction, direction)
    there, back = (
        torch.eye(len(direction)) + (scale - 1) * outer,
        torch.eye(len(direction)) + (1 / scale - 1) * outer,
    )
    last, first, whiten = encoder.body[-1], decoder.coarse[0], encoder.whiten
    assert isinstance(last, nn.Conv2d)
    assert isinstance(first, nn.Conv2d)
    assert whiten.running_mean is not None
    assert whiten.running_var is not None
    assert last.bias is not None
    there = there / (whiten.running_var + whiten.eps).sqrt()
    last.weight.copy_(torch.einsum("ij,jchw->ichw", there, last.weight))
    last.bias.copy_(there @ (last.bias - whiten.running_mean))
    whiten.running_mean.zero_()
    whiten.running_var.fill_(1 - whiten.eps)
    first.weight.copy_(torch.einsum("ojhw,ji->oihw", first.weight, back))


def blur_detail(decoder: Decoder, latents: Tensor) -> Tensor:
    """Return latents (b, 4, h, w) as score distillation knows them: along `no_colour` weakened to a random
    share, and off by some; a fifth of them as they are.

    A scene's latents were off by more than a standard deviation in this direction, where colours were right,
    and a decoder that had not met such latents made black of brown.
    """
    b, _, h, w = latents.shape
    direction = no_colour(decoder).view(1, -1, 1, 1)
    detail = (latents * direction).sum(1, keepdim=True)
    waves = F.interpolate(torch.randn(b, 1, 4, 4), (h, w), mode="bilinear", align_corners=False)
    off = DETAIL * (0.8 * torch.randn(b, 1, 1, 1) + 0.4 * waves)
    change = off - (1 - torch.rand(b, 1, 1, 1)) * detail
    return latents + (torch.rand(b, 1, 1, 1) < 0.8) * change * direction


def autoencoder_loss(
    encoder: Encoder, decoder: Decoder, images: Tensor, noise: float = 0.08
) -> tuple[Tensor, Tensor]:
    """Return the training loss and the plain mean squared error of one batch (b, 3, h, w).

    L1 + 2 MSE + 0.5 L1 of the gradients + 2 linear latent -> RGB + 0.05 correlation between latent
    channels + 0.1 of what latents exceed LARGEST, squared; the decoder sees latents with noise, their detail
    blurred, since those of score distillation are never clean.
    """
    latents = encoder(images)
    decoded = decoder(blur_detail(decoder, latents) + noise * torch.randn_like(latents)).float()
    error = decoded - images
    slopes = error.diff(dim=-1).abs().mean() + error.diff(dim=-2).abs().mean()
    linear = decoder.linear(latents).float() - F.avg_pool2d(images, FACTOR)
    flat = latents.float().permute(1, 0, 2, 3).flatten(1)
    covariance = (flat @ flat.T) / flat.shape[1]
    correlation = (covariance - torch.diag(torch.diag(covariance))).square().sum()
    mse = error.square().mean()
    excess = F.relu(latents.float().abs() - LARGEST).square().mean()
    loss = (
        error.abs().mean()
        + 2 * mse
        + 0.5 * slopes
        + 2 * linear.abs().mean()
        + 0.05 * correlation
        + 0.1 * excess
    )
    return loss, mse.detach()
