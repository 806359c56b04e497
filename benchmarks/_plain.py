"""The field and its rendering in straightforward torch: what the kernels are measured against.

Vectorised over all points or rays, one autograd operation a line of the formulas, no kernel of our own and
nothing skipped but what is outside the box. Letters: r rays, s samples a ray, n points, c colours.
"""

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pipeline.nerf.field import LatentField
from pipeline.nerf.grid_levels import HashGrid
from pipeline.nerf.rendering import NEAR, Rays
from pipeline.nerf.scene import BOX_DIAGONAL, Scene

_PRIMES = (1, 2654435761, 805459861)
_WORD = 2**32 - 1


class Marched(NamedTuple):
    """Sample distances, padded, and which of them are meant."""

    distances: Float[Tensor, "r s"]
    kept: Bool[Tensor, "r s"]


def encode(points: Float[Tensor, "n 3"], table: Float[Tensor, "e 2"], grid: HashGrid) -> Float[Tensor, "n f"]:
    """Return the hash grid's features, differentiable by the table."""
    features = []
    for level, resolution in enumerate(grid.resolutions.tolist()):
        first, entries = int(grid.offsets[level]), int(grid.offsets[level + 1] - grid.offsets[level])
        scaled = ((points * 0.5 + 0.5) * resolution).clamp(0, resolution)
        cell = scaled.long().clamp(max=resolution - 1)
        inside = scaled - cell
        total = torch.zeros(len(points), 2)
        for corner in range(8):
            step = torch.tensor([corner & 1, corner >> 1 & 1, corner >> 2])
            x, y, z = (cell + step).unbind(1)
            if (resolution + 1) ** 3 <= entries:
                index = x + (resolution + 1) * (y + (resolution + 1) * z)
            else:
                index = (x * _PRIMES[0] ^ y * _PRIMES[1] ^ z * _PRIMES[2]) & _WORD & (entries - 1)
            weight = torch.where(step.bool(), inside, 1 - inside).prod(1)
            total = total + weight[:, None] * table[first + index]
        features.append(total)
    return torch.cat(features, 1)


def evaluate(
    field: LatentField, points: Float[Tensor, "n 3"]
) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 4"]]:
    """Return density and latents, differentiable by the field's parameters."""
    hidden = torch.relu(
        torch.nn.functional.linear(encode(points, field.table, field.grid), field.weight1, field.bias1)
    )
    hidden = torch.relu(torch.nn.functional.linear(hidden, field.weight2, field.bias2))
    raw = torch.nn.functional.linear(hidden, field.weight3, field.bias3)
    shape = field.shape
    blob = shape.blob_density * torch.exp(points.square().sum(1) / (-2 * shape.blob_radius**2))
    logarithm = (raw[:, 0] + blob + shape.density_bias).clamp(max=15.0)
    return field.sharpening * torch.exp(logarithm), raw[:, 1:]


def march(rays: Rays, samples_per_ray: int, occupied: Bool[np.ndarray, "g g g"] | None = None) -> Marched:
    """Return the samples of all rays that lie in the box and (if given) in occupied cells."""
    origins, directions, jitter = (torch.from_numpy(values) for values in rays)
    step = BOX_DIAGONAL / samples_per_ray
    low, high = (-1 - origins) / directions, (1 - origins) / directions
    enter = torch.minimum(low, high).amax(1).clamp(min=NEAR)
    leave = torch.maximum(low, high).amin(1)
    distances = enter[:, None] + (torch.arange(samples_per_ray + 1) + jitter[:, None]) * step
    kept = distances < leave[:, None]
    if occupied is not None:
        points = origins[:, None] + distances[..., None] * directions[:, None]
        side = len(occupied)
        cells = ((points * 0.5 + 0.5) * side).long().clamp(0, side - 1)
        kept = kept & torch.from_numpy(occupied)[tuple(cells.unbind(-1))]
    return Marched(distances, kept)


def composite(
    density: Float[Tensor, "r s"], latents: Float[Tensor, "r s 4"], step: float
) -> tuple[Float[Tensor, "r 4"], Float[Tensor, " r"]]:
    """Return latents and log transmittance of every ray (the quadrature of Max 1995)."""
    optical = density * step
    dimmed = -torch.cumsum(optical, 1)
    before = torch.cat([torch.zeros(len(optical), 1), dimmed[:, :-1]], 1)
    weights = torch.exp(before) * -torch.expm1(-optical)
    return (weights[..., None] * latents).sum(1), dimmed[:, -1]


def render(
    scene: Scene, rays: Rays, everything: bool = False
) -> tuple[Float[Tensor, "r 4"], Float[Tensor, " r"], int]:
    """Return latents, log transmittance and how often the field was evaluated.

    `everything`: rays that miss the box, and samples beyond it, are evaluated too, and then hidden.
    """
    marched = march(rays, scene.samples_per_ray)
    origins, directions, _ = (torch.from_numpy(values) for values in rays)
    points = origins[:, None] + marched.distances[..., None] * directions[:, None]
    if everything:
        density, latents = evaluate(scene.field, points.reshape(-1, 3).nan_to_num(0, 1e3, -1e3))
        density = density.reshape(marched.kept.shape) * marched.kept
        latents = latents.reshape(*marched.kept.shape, 4)
        count = density.numel()
    else:
        found, colours = evaluate(scene.field, points[marched.kept])
        density = torch.zeros(marched.kept.shape).masked_scatter(marched.kept, found)
        latents = torch.zeros(*marched.kept.shape, 4).masked_scatter(marched.kept[..., None], colours)
        count = len(found)
    pixels, dimmed = composite(density, latents, scene.step)
    return pixels, dimmed, count


def gather(
    latents: Float[Tensor, "c 4"],
    pixels: Int[Tensor, " n"],
    columns: Int[Tensor, " n"],
    shares: Float[Tensor, " n"],
    count: int,
) -> Float[Tensor, "p 4"]:
    """Return what `count` pixels read of the texels: one entry (pixel, column, share) a tap."""
    return torch.zeros(count, 4).index_add(0, pixels, shares[:, None] * latents[columns])
