"""What may be done to a picture without changing what it shows. Pictures are (b, 3, h, w) in [0, 1]."""

import numpy as np
import torch
from torch.nn import functional as F


def move(rng: np.random.Generator, images: torch.Tensor) -> torch.Tensor:
    """Mirror half of the pictures; shift and zoom each a little: few objects are to show as many."""
    count = len(images)
    zoom = rng.uniform(0.85, 1.2, count)
    place = np.zeros((count, 2, 3), np.float32)
    place[:, 0, 0] = zoom * rng.choice([-1, 1], count)
    place[:, 1, 1] = zoom * rng.uniform(0.92, 1.08, count)
    place[:, :, 2] = rng.uniform(-0.12, 0.12, (count, 2))
    grid = F.affine_grid(torch.from_numpy(place), list(images.shape), align_corners=False)
    return F.grid_sample(images, grid, padding_mode="border", align_corners=False)


def blur_and_jitter(rng: np.random.Generator, images: torch.Tensor) -> torch.Tensor:
    """Blur, brightness, contrast and noise, so that a decoder's softness is no sign of anything."""
    small = int(rng.integers(28, 65))
    if small < 60:
        images = F.interpolate(
            F.interpolate(images, (small, small), mode="area"), images.shape[-2:], mode="bilinear"
        )
    gain = torch.from_numpy(rng.uniform(0.85, 1.15, (len(images), 1, 1, 1)).astype(np.float32))
    shift = torch.from_numpy(rng.uniform(-0.06, 0.06, (len(images), 1, 1, 1)).astype(np.float32))
    noise = torch.from_numpy(rng.normal(0, rng.uniform(0, 0.03), images.shape).astype(np.float32))
    return (images * gain + shift + noise).clamp(0, 1)


def shift_hues(rng: np.random.Generator, images: torch.Tensor) -> torch.Tensor:
    """Turn each picture's colours about the grey axis, and pale or deepen them: a kind is its shape.

    The few models of a kind come in few colours, and a kind learned with its colours is not known in others.
    """
    grey = np.full((3, 3), 1 / 3)
    across = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]) / np.sqrt(3)
    angles, depth = rng.uniform(0, 2 * np.pi, len(images)), rng.uniform(0, 1.5, len(images))
    turns = [
        grey + d * (np.cos(a) * (np.eye(3) - grey) + np.sin(a) * across)
        for a, d in zip(angles, depth, strict=True)
    ]
    turned = torch.einsum("bij,bjhw->bihw", torch.from_numpy(np.stack(turns).astype(np.float32)), images)
    return turned.clamp(0, 1)


def sharpen(rng: np.random.Generator, images: torch.Tensor) -> torch.Tensor:
    """Exaggerate edges as strong guidance does: up to twice what a blur takes away, added again."""
    width = int(rng.choice([3, 5, 7]))
    soft = F.avg_pool2d(images, width, stride=1, padding=width // 2, count_include_pad=False)
    strength = torch.from_numpy(rng.uniform(0, 2, (len(images), 1, 1, 1)).astype(np.float32))
    return (images + strength * (images - soft)).clamp(0, 1)
