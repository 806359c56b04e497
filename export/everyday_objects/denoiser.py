"""The denoiser: a UNet on 2 x 2 patches of the latents, conditioned on text by attention and by its mean.

32 x 32 x 4 latents become 16 x 16 x 16, so the net costs what one on 16 x 16 latents costs.
"""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from export.everyday_objects.autoencoder import LATENT_CHANNELS, zero
from export.everyday_objects.text_encoder import WIDTH

PATCH = 2
GROUPS = 8


class ResidualBlock(nn.Module):
    """Norm, SiLU, convolution, twice; the embedding scales and shifts in between."""

    def __init__(self, inputs: int, outputs: int, embedding: int) -> None:
        super().__init__()
        self.norm1, self.norm2 = nn.GroupNorm(GROUPS, inputs), nn.GroupNorm(GROUPS, outputs)
        self.conv1 = nn.Conv2d(inputs, outputs, 3, padding=1)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, padding=1)
        self.modulation = nn.Linear(embedding, 2 * outputs)
        self.skip = nn.Conv2d(inputs, outputs, 1) if inputs != outputs else nn.Identity()
        zero(self.conv2)

    def forward(self, x: Tensor, embedding: Tensor) -> Tensor:
        """(b, inputs, h, w), (b, embedding) to (b, outputs, h, w)."""
        scale, shift = self.modulation(embedding)[:, :, None, None].chunk(2, dim=1)
        h = self.conv1(F.silu(self.norm1(x)))
        h = self.conv2(F.silu(self.norm2(h) * (1 + scale) + shift))
        return self.skip(x) + h


class Attention(nn.Module):
    """Multi-head attention of tokens on a context."""

    def __init__(self, width: int, context: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.q = nn.Linear(width, width, bias=False)
        self.kv = nn.Linear(context, 2 * width, bias=False)
        self.out = nn.Linear(width, width)
        zero(self.out)

    def forward(self, x: Tensor, context: Tensor) -> Tensor:
        """(b, n, width), (b, l, context) to (b, n, width)."""
        b, n, width = x.shape
        q = self.q(x).view(b, n, self.heads, -1).transpose(1, 2)
        k, v = self.kv(context).view(b, context.shape[1], 2, self.heads, -1).permute(2, 0, 3, 1, 4)
        # Spelled out: torch's fused attention takes four times as long backwards on a CPU at these sizes.
        y = torch.softmax(q @ k.transpose(-1, -2) * (q.shape[-1] ** -0.5), dim=-1) @ v
        return self.out(y.transpose(1, 2).reshape(b, n, width))


class Transformer(nn.Module):
    """Self-attention, attention on the text, a perceptron; each beside the identity."""

    def __init__(self, width: int, context: int, heads: int) -> None:
        super().__init__()
        self.norm1, self.norm2, self.norm3 = (nn.LayerNorm(width) for _ in range(3))
        self.to_self, self.to_text = Attention(width, width, heads), Attention(width, context, heads)
        self.mlp = nn.Sequential(nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width))

    def forward(self, x: Tensor, text: Tensor) -> Tensor:
        """(b, c, h, w), (b, l, context) to (b, c, h, w)."""
        b, c, h, w = x.shape
        tokens = x.flatten(2).transpose(1, 2)
        normed = self.norm1(tokens)
        tokens = tokens + self.to_self(normed, normed)
        tokens = tokens + self.to_text(self.norm2(tokens), text)
        tokens = tokens + self.mlp(self.norm3(tokens))
        return tokens.transpose(1, 2).reshape(b, c, h, w)


class Level(nn.Module):
    """One residual block and, at the coarse levels, one transformer."""

    def __init__(self, inputs: int, outputs: int, embedding: int, text: int, heads: int) -> None:
        super().__init__()
        self.residual = ResidualBlock(inputs, outputs, embedding)
        self.transformer = Transformer(outputs, text, heads) if heads else None

    def forward(self, x: Tensor, embedding: Tensor, text: Tensor) -> Tensor:
        """(b, inputs, h, w) to (b, outputs, h, w)."""
        x = self.residual(x, embedding)
        return x if self.transformer is None else self.transformer(x, text)


class Denoiser(nn.Module):
    """Predicts v = sqrt(abar) noise - sqrt(1 - abar) latents."""

    def __init__(
        self,
        channels: tuple[int, ...] = (64, 160, 256),
        heads: tuple[int, ...] = (0, 4, 8),
        text: int = WIDTH,
    ) -> None:
        super().__init__()
        self.width, embedding = channels[0], 256
        self.time = nn.Sequential(
            nn.Linear(self.width, embedding), nn.SiLU(), nn.Linear(embedding, embedding)
        )
        self.text = nn.Linear(text, embedding)
        patch = LATENT_CHANNELS * PATCH**2
        self.stem = nn.Conv2d(patch, channels[0], 3, padding=1)
        self.down, self.shrink, self.up, self.grow = (nn.ModuleList() for _ in range(4))
        previous = channels[0]
        for c, h in zip(channels, heads, strict=True):
            self.down.append(
                nn.ModuleList([Level(previous, c, embedding, text, h), Level(c, c, embedding, text, h)])
            )
            self.shrink.append(
                nn.Conv2d(c, c, 3, padding=1, stride=2) if c != channels[-1] else nn.Identity()
            )
            previous = c
        self.middle = nn.ModuleList([Level(previous, previous, embedding, text, heads[-1]) for _ in range(2)])
        for c, h in zip(channels[::-1], heads[::-1], strict=True):
            self.up.append(
                nn.ModuleList(
                    [Level(previous + c, c, embedding, text, h), Level(2 * c, c, embedding, text, h)]
                )
            )
            self.grow.append(nn.Conv2d(c, c, 3, padding=1) if c != channels[0] else nn.Identity())
            previous = c
        self.norm = nn.GroupNorm(GROUPS, channels[0])
        self.head = nn.Conv2d(channels[0], patch, 3, padding=1)
        zero(self.head)

    def forward(self, sample: Tensor, timestep: Tensor, encoder_hidden_states: Tensor) -> Tensor:
        """Latents (b, 4, h, w), h and w multiples of 8, timesteps (b,) integer, text (b, l, d) to v of the
        latents' shape.
        """
        steps = torch.arange(self.width // 2, dtype=torch.float32, device=sample.device)
        phase = timestep.float()[:, None] * torch.exp(-math.log(10000.0) * steps / (self.width // 2))
        embedding = self.time(torch.cat([phase.sin(), phase.cos()], dim=1))
        embedding = F.silu(embedding + self.text(encoder_hidden_states.mean(dim=1)))
        x = self.stem(F.pixel_unshuffle(sample, PATCH))
        skips = []
        for levels, shrink in zip(self.down, self.shrink, strict=True):
            for level in levels.children():
                x = level(x, embedding, encoder_hidden_states)
                skips.append(x)
            x = shrink(x)
        for level in self.middle:
            x = level(x, embedding, encoder_hidden_states)
        for i, (levels, grow) in enumerate(zip(self.up, self.grow, strict=True)):
            for level in levels.children():
                x = level(torch.cat([x, skips.pop()], dim=1), embedding, encoder_hidden_states)
            if i + 1 < len(self.up):
                x = grow(F.interpolate(x, scale_factor=2.0, mode="nearest"))
        return F.pixel_shuffle(self.head(F.silu(self.norm(x))), PATCH)
