"""The denoiser: a UNet on 2 x 2 patches of the latents, told the text, the exact camera and the backdrop.

32 x 32 x 4 latents become 16 x 16 x 16, so the net costs what one on 16 x 16 latents costs. The text comes in
by attention and by its mean; the camera as an embedding beside the time step's (MVDream, Shi et al. 2023) and
as a map of rays, so that convolutions know where they look (Plücker coordinates: CAT3D, Gao et al. 2024).
Self-attention spans the `views` of one object, which stand in consecutive rows, so that they agree on one
object (MVDream).

Letters: b rows, h x w latent pixels, l tokens of width d, c channels.
"""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from export.everyday_objects.networks.autoencoder import LATENT_CHANNELS, zero
from export.everyday_objects.networks.text_encoder import WIDTH

PATCH = 2
GROUPS = 8
CAMERA = (
    "camera_told",
    "azimuth",
    "polar",
    "distance",
    "fov",
    "backdrop_told",
    *["backdrop"] * LATENT_CHANNELS,
)
"""Columns of the camera input: angles in radians, the distance in scene units, the backdrop as flat latents;
1 or 0 says whether what follows is told. A row of zeros tells nothing."""
_HARMONICS = 12


class Norm(nn.GroupNorm):
    """Group normalisation in float32: in bfloat16 with channels last it takes a CPU three times as long."""

    def __init__(self, channels: int) -> None:
        super().__init__(GROUPS, channels)

    def forward(self, x: Tensor) -> Tensor:
        """(b, c, h, w) to the same shape and type."""
        return super().forward(x.float()).to(x.dtype)


class ResidualBlock(nn.Module):
    """Norm, SiLU, convolution, twice; the embedding scales and shifts in between."""

    def __init__(self, inputs: int, outputs: int, embedding: int) -> None:
        super().__init__()
        self.norm1, self.norm2 = Norm(inputs), Norm(outputs)
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
        q = self.q(x).view(b, n, self.heads, -1).transpose(1, 2) * ((width // self.heads) ** -0.5)
        k, v = self.kv(context).view(b, context.shape[1], 2, self.heads, -1).permute(2, 0, 3, 1, 4)
        # Spelled out: torch's fused attention takes four times as long backwards on a CPU at these sizes.
        y = torch.softmax(q @ k.transpose(-1, -2), dim=-1) @ v
        return self.out(y.transpose(1, 2).reshape(b, n, width))


class Transformer(nn.Module):
    """Self-attention across the views of an object, attention on the text, a perceptron; each beside the
    identity.
    """

    def __init__(self, width: int, context: int, heads: int) -> None:
        super().__init__()
        self.norm1, self.norm2, self.norm3 = (nn.LayerNorm(width) for _ in range(3))
        self.to_self, self.to_text = Attention(width, width, heads), Attention(width, context, heads)
        self.mlp = nn.Sequential(nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width))

    def forward(self, x: Tensor, text: Tensor, views: int) -> Tensor:
        """(b, c, h, w), (b, l, d) to (b, c, h, w)."""
        _, c, h, w = x.shape
        tokens = x.flatten(2).transpose(1, 2)
        joint = self.norm1(tokens).reshape(-1, views * h * w, c)
        tokens = tokens + self.to_self(joint, joint).reshape(-1, h * w, c)
        tokens = tokens + self.to_text(self.norm2(tokens), text)
        tokens = tokens + self.mlp(self.norm3(tokens))
        return tokens.transpose(1, 2).reshape(-1, c, h, w)


class Level(nn.Module):
    """One residual block and, at the coarse levels, one transformer."""

    def __init__(self, inputs: int, outputs: int, embedding: int, text: int, heads: int) -> None:
        super().__init__()
        self.residual = ResidualBlock(inputs, outputs, embedding)
        self.transformer = Transformer(outputs, text, heads) if heads else None

    def forward(self, x: Tensor, embedding: Tensor, text: Tensor, views: int) -> Tensor:
        """(b, inputs, h, w) to (b, outputs, h, w)."""
        x = self.residual(x, embedding)
        return x if self.transformer is None else self.transformer(x, text, views)


class Denoiser(nn.Module):
    """Predicts v = sqrt(abar) noise - sqrt(1 - abar) latents."""

    def __init__(
        self,
        channels: tuple[int, ...] = (64, 128, 192),
        heads: tuple[int, ...] = (0, 4, 6),
        text: int = WIDTH,
        embedding: int = 256,
        views: int = 4,
    ) -> None:
        super().__init__()
        self.width, self.views = channels[0], views
        self.time = nn.Sequential(
            nn.Linear(self.width, embedding), nn.SiLU(), nn.Linear(embedding, embedding)
        )
        self.text = nn.Linear(text, embedding)
        self.camera = nn.Sequential(
            nn.Linear(_HARMONICS + 2 + LATENT_CHANNELS, embedding), nn.SiLU(), nn.Linear(embedding, embedding)
        )
        self.mix = nn.Linear(embedding, embedding)
        patch = LATENT_CHANNELS * PATCH**2
        self.stem = nn.Conv2d(patch + 6 + LATENT_CHANNELS, channels[0], 3, padding=1)
        self.down, self.shrink, self.up, self.grow = (nn.ModuleList() for _ in range(4))
        previous, last = channels[0], len(channels) - 1
        for i, (c, h) in enumerate(zip(channels, heads, strict=True)):
            self.down.append(Level(previous, c, embedding, text, h))
            self.shrink.append(nn.Conv2d(c, c, 3, padding=1, stride=2) if i < last else nn.Identity())
            previous = c
        self.middle = nn.ModuleList([Level(previous, previous, embedding, text, heads[-1]) for _ in range(2)])
        for i, (c, h) in enumerate(zip(channels[::-1], heads[::-1], strict=True)):
            self.up.append(
                nn.ModuleList([Level(previous + c, c, embedding, text, h), Level(c, c, embedding, text, h)])
            )
            self.grow.append(nn.Conv2d(c, c, 3, padding=1) if i < last else nn.Identity())
            previous = c
        self.norm = Norm(channels[0])
        self.head = nn.Conv2d(channels[0], patch, 3, padding=1)
        zero(self.head)

    def forward(
        self,
        sample: Tensor,
        timestep: Tensor,
        encoder_hidden_states: Tensor,
        camera: Tensor,
        views: int | None = None,
    ) -> Tensor:
        """Latents (b, 4, h, w), h and w multiples of 8, timesteps (b,) integer, text (b, l, d) and cameras
        (b, 10; see CAMERA) to v of the latents' shape. `views` rows at a time show one object; None: what the
        net was made for.
        """
        views = self.views if views is None else views
        steps = torch.arange(self.width // 2, dtype=torch.float32, device=sample.device)
        phase = timestep.float()[:, None] * torch.exp(-math.log(10000.0) * steps / (self.width // 2))
        embedding = self.time(torch.cat([phase.sin(), phase.cos()], dim=1))
        embedding = (
            embedding + self.text(encoder_hidden_states.mean(dim=1)) + self.camera(camera_features(camera))
        )
        embedding = F.silu(embedding + self.mix(F.silu(embedding)))
        x = F.pixel_unshuffle(sample, PATCH)
        told = (camera[:, 5:6] * camera[:, 6:])[:, :, None, None].expand(-1, -1, *x.shape[2:])
        maps = [x, ray_map(camera, x.shape[2], x.shape[3]), told]
        x = self.stem(torch.cat([m.to(x.dtype) for m in maps], dim=1))
        text, skips = encoder_hidden_states, []
        for level, shrink in zip(self.down, self.shrink, strict=True):
            x = level(x, embedding, text, views)
            skips.append(x)
            x = shrink(x)
        for level in self.middle:
            x = level(x, embedding, text, views)
        for i, (levels, grow) in enumerate(zip(self.up, self.grow, strict=True)):
            first, second = levels.children()
            x = first(torch.cat([x, skips.pop()], dim=1), embedding, text, views)
            x = second(x, embedding, text, views)
            if i + 1 < len(self.up):
                x = grow(F.interpolate(x, scale_factor=2.0, mode="nearest"))
        return F.pixel_shuffle(self.head(F.silu(self.norm(x))), PATCH)


def camera_features(camera: Tensor) -> Tensor:
    """Return smooth functions (b, 18) of camera rows (b, 10): harmonics of the angles, what is told, the
    backdrop.
    """
    told, azimuth, polar, distance, fov = (camera[:, i] for i in range(5))
    turns = [f(k * azimuth) for k in (1, 2, 3) for f in (torch.sin, torch.cos)]
    heights = [f(k * polar) for k in (1, 2) for f in (torch.sin, torch.cos)]
    smooth = torch.stack([*turns, *heights, 4 * (distance - 2.5), 15 * (fov - 0.68)], dim=1)
    backdrop = camera[:, 5:6] * camera[:, 6:]
    return torch.cat([told[:, None] * smooth, told[:, None], camera[:, 5:6], backdrop], dim=1)


def ray_map(camera: Tensor, height: int, width: int) -> Tensor:
    """Return the Plücker coordinates (b, 6, height, width) of rays through a picture's cells: unit direction
    and origin x direction, world axes; zeros where no camera is told. Cameras as in
    `pipeline.cameras.orbit_camera`.
    """
    azimuth, polar, distance, fov = (camera[:, i, None, None] for i in range(1, 5))
    sin_a, cos_a, sin_p, cos_p = azimuth.sin(), azimuth.cos(), polar.sin(), polar.cos()
    half = torch.tan(fov / 2)
    across = ((torch.arange(width, dtype=torch.float32, device=camera.device) + 0.5) / width * 2 - 1)[
        None, None
    ]
    down = ((torch.arange(height, dtype=torch.float32, device=camera.device) + 0.5) / height * 2 - 1)[
        None, :, None
    ]
    x, y = half * across + 0 * down, 0 * across - half * down
    # Of the pose: right (cos a, 0, -sin a), backward (sin p sin a, cos p, sin p cos a), up is their product.
    dx = x * cos_a - y * cos_p * sin_a - sin_p * sin_a
    dy = y * sin_p - cos_p + 0 * x
    dz = -x * sin_a - y * cos_p * cos_a - sin_p * cos_a
    length = torch.rsqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx * length, dy * length, dz * length
    ox, oy, oz = distance * sin_p * sin_a, distance * cos_p, distance * sin_p * cos_a
    moment = [oy * dz - oz * dy, oz * dx - ox * dz, ox * dy - oy * dx]
    return camera[:, :1, None, None] * torch.stack([dx, dy, dz, *moment], dim=1)
