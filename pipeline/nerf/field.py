"""The latent radiance field: hash grid -> small ReLU network -> density and four latent channels.

Letters: n points in [-1, 1]^3, k of them in one segment. Density [1 / scene unit] is
    sharpening * exp(h0 + bias + blob * exp(-r^2 / (2 radius^2))),
the blob centring the geometry (Metzer et al. 2022, Latent-NeRF, after DreamFusion); the latents have no
activation. The gradient is written by hand: it follows the segments in which the renderer asked for
samples, so that nothing is evaluated twice or concatenated, and the hash grid's gradient is accumulated in
one place.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from pipeline.kernels import activation, parallel
from pipeline.kernels import hashgrid as kernels
from pipeline.nerf import grid_levels
from pipeline.training.batch import LATENT_CHANNELS

# Work is divided into blocks of points by `parallel`. A pool of torch's own would spin against its threads,
# and sums would depend on their number. The setting belongs to a thread, so each piece of work repeats it.
torch.set_num_threads(1)

_HIDDEN = 64
_BLOCK = 2048
"""Points that go through the network together, at most: what a block needs stays in the cache."""
_MAX_EXPONENT = 15.0
"""Log densities are clamped here, and their gradient too (torch-ngp's trunc_exp): exp(15) is 3e6."""
LEAST_DENSITY = math.exp(-_MAX_EXPONENT)
"""The field's gradient takes densities below this as this, and so has whatever is made of a density: its
logarithm's gradient would else grow without end."""
_ENCODED_BLOCK = 1024
"""Points encoded together, at least."""


class FieldShape(NamedTuple):
    """What fixes the layout of a field's parameters and its density bias."""

    levels: int = 16
    coarsest: int = 16
    finest: int = 512
    table_log2: int = 16
    blob_density: float = 5.0
    """Height of the blob added to the log density at the centre."""
    blob_radius: float = 0.2
    """Standard deviation of the blob [scene units]."""
    density_bias: float = 0.0
    """Added to the log density everywhere; negative starts from empty space around the blob."""


class Segment(NamedTuple):
    """One evaluation of the field with what its gradient needs."""

    points: Float[Tensor, "k 3"]
    features: Float[Tensor, "k f"]
    hidden1: Float[Tensor, "k h"]
    hidden2: Float[Tensor, "k h"]
    density: Float[Tensor, " k"]
    latents: Float[Tensor, "k 4"]
    memory: Float[Tensor, " m"]
    """What features and hidden units lie in; its field uses it again after the gradient."""


class LatentField(nn.Module):
    """The trainable field. Parameters: `table` (e, 2), and weights and biases of three linear layers."""

    def __init__(self, shape: FieldShape, rng: np.random.Generator) -> None:
        """Initialise as the paper's code does: table U(-1e-4, 1e-4), layers U(-1, 1) / sqrt(fan in)."""
        super().__init__()
        self.shape = shape
        self.grid = grid_levels.hash_grid(shape.levels, shape.coarsest, shape.finest, shape.table_log2)
        self.sharpening = 1.0
        self.active_levels = shape.levels
        """Levels of the grid that count; the features of finer ones are 0, and they get no gradient."""
        self.spare: list[Tensor] = []
        """Memory of segments whose gradient was taken. Fresh memory costs a page fault every 4 KiB: a third
        of the time of an evaluation."""

        def uniform(bound: float, *size: int) -> nn.Parameter:
            return nn.Parameter(torch.from_numpy(rng.uniform(-bound, bound, size).astype(np.float32)))

        self.table = uniform(1e-4, self.grid.entries, grid_levels.FEATURES)
        widths = [self.grid.width, _HIDDEN, _HIDDEN, 1 + LATENT_CHANNELS]
        bounds = [w**-0.5 for w in widths]
        self.weight1, self.bias1 = uniform(bounds[0], widths[1], widths[0]), uniform(bounds[0], widths[1])
        self.weight2, self.bias2 = uniform(bounds[1], widths[2], widths[1]), uniform(bounds[1], widths[2])
        self.weight3, self.bias3 = uniform(bounds[2], widths[3], widths[2]), uniform(bounds[2], widths[3])

    def evaluate(self, points: Float[Tensor, "k 3"]) -> Segment:
        """Evaluate the field at `points` (float32, contiguous) without recording for autograd."""
        count = len(points)
        widths = (self.grid.width, _HIDDEN, _HIDDEN)
        memory = self._memory(count * sum(widths))
        parts = memory[: count * sum(widths)].split([count * width for width in widths])
        features, hidden1, hidden2 = (part.view(count, -1) for part in parts)
        density, latents = torch.empty(count), torch.empty(count, LATENT_CHANNELS)
        table, weight1, bias1, weight2, bias2, weight3, bias3 = (p.detach() for p in self.parameters())

        shape = self.shape
        falloff = -0.5 / shape.blob_radius**2
        by_place = (shape.blob_density, falloff, shape.density_bias)
        constants = np.array([*by_place, self.sharpening, _MAX_EXPONENT], np.float32)
        places, dense, shown = points.numpy(), density.numpy(), latents.numpy()

        def work(first: int, last: int) -> None:
            torch.set_num_threads(1)
            for rows in _blocks(first, last, count):
                torch.mm(features[rows], weight1.T, out=hidden1[rows])
                activation.relu(hidden1[rows].numpy(), bias1.numpy())
                torch.mm(hidden1[rows], weight2.T, out=hidden2[rows])
                output = np.empty((rows.stop - rows.start, 1 + LATENT_CHANNELS), np.float32)
                activation.relu_linear(
                    hidden2[rows].numpy(), bias2.numpy(), weight3.numpy(), bias3.numpy(), output
                )
                activation.activate(output, places[rows], constants, dense[rows], shown[rows])

        active = self.active_levels
        features[:, grid_levels.FEATURES * active :] = 0
        levels = (places, table.numpy(), self.grid.resolutions[:active], self.grid.offsets)
        parallel.run(kernels.encode, count, *levels, features.numpy(), block=_ENCODED_BLOCK)
        parallel.run(work, _pieces(count))
        return Segment(points, features, hidden1, hidden2, density, latents, memory)

    def _memory(self, size: int) -> Float[Tensor, " m"]:
        """Return at least `size` numbers, spare ones if there are such."""
        large = [i for i, memory in enumerate(self.spare) if len(memory) >= size]
        if large:
            return self.spare.pop(min(large, key=lambda i: len(self.spare[i])))
        if self.spare:  # the next one will be as large: what is too small would never be used again
            self.spare.pop(min(range(len(self.spare)), key=lambda i: len(self.spare[i])))
        return torch.empty(size + size // 8)

    def attach(self, segments: list[Segment]) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 4"]]:
        """Return density and latents of evaluated segments, in order, as differentiable by the parameters.

        Once: the backward pass takes the segments' memory back.
        """
        parameters = dict(self.named_parameters()).values()
        density, latents = _Attach.apply(self, segments, *parameters)
        return density, latents

    def _accumulate(
        self,
        segment: Segment,
        density_gradient: Float[Tensor, " k"],
        latent_gradient: Float[Tensor, "k 4"],
        gradients: dict[str, Tensor],
    ) -> None:
        """Add the segment's share to the parameter gradients (sums over blocks, in their order).

        The gradient of the features takes their place.
        """
        count = len(segment.points)
        lowest = np.float32(self.sharpening * np.exp(-_MAX_EXPONENT))
        by_density, by_latents = density_gradient.contiguous().numpy(), latent_gradient.contiguous().numpy()
        density = segment.density.numpy()
        weight1, weight2, weight3 = self.weight1.detach(), self.weight2.detach(), self.weight3.detach()
        layers = {n: g for n, g in gradients.items() if n != "table"}
        shares = {n: torch.empty(_pieces(count), *g.shape) for n, g in layers.items()}

        def work(first: int, last: int) -> None:
            torch.set_num_threads(1)
            for block, rows in enumerate(_blocks(first, last, count), first):
                share = {name: values[block] for name, values in shares.items()}
                output = torch.empty(rows.stop - rows.start, 1 + LATENT_CHANNELS)
                given = by_density[rows], by_latents[rows], density[rows]
                activation.activate_backward(*given, lowest, output.numpy())
                torch.mm(output.T, segment.hidden2[rows], out=share["weight3"])
                torch.sum(output, 0, out=share["bias3"])
                hidden = output @ weight3
                units = segment.hidden2[rows].numpy()
                activation.relu_backward(hidden.numpy(), units, share["bias2"].numpy())
                torch.mm(hidden.T, segment.hidden1[rows], out=share["weight2"])
                hidden = hidden @ weight2
                units = segment.hidden1[rows].numpy()
                activation.relu_backward(hidden.numpy(), units, share["bias1"].numpy())
                torch.mm(hidden.T, segment.features[rows], out=share["weight1"])
                torch.mm(hidden, weight1, out=segment.features[rows])

        parallel.run(work, _pieces(count))
        for name, gradient in layers.items():
            gradient += shares[name].sum(0)
        levels = (segment.points.numpy(), segment.features.numpy(), *self.grid, gradients["table"].numpy())
        parallel.run(kernels.encode_backward, self.active_levels, *levels)


def _pieces(count: int) -> int:
    """Return the number of blocks of `count` points: even, so that two threads have as much to do each. It
    does not depend on the number of threads, and neither does the order of sums.
    """
    return 2 * -(-count // (2 * _BLOCK)) if count > _BLOCK // 2 else min(count, 1)


def _blocks(first: int, last: int, count: int) -> Iterator[slice]:
    """Yield the rows of blocks `first` to `last` of `count` points."""
    size = -(-count // _pieces(count))
    for block in range(first, last):
        yield slice(min(block * size, count), min((block + 1) * size, count))


class _Attach(torch.autograd.Function):
    """Joins evaluated segments into the autograd graph."""

    @staticmethod
    def forward(
        ctx: Any, field: LatentField, segments: list[Segment], *parameters: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the densities (n,) and latents (n, 4) of all segments, one after the other."""
        ctx.field, ctx.segments = field, segments
        if not segments:
            return torch.zeros(0), torch.zeros(0, LATENT_CHANNELS)
        return torch.cat([s.density for s in segments]), torch.cat([s.latents for s in segments])

    @staticmethod
    def backward(ctx: Any, *output_gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Return the gradients by the parameters."""
        density_gradient, latent_gradient = output_gradients
        field: LatentField = ctx.field
        gradients = {name: torch.zeros_like(p) for name, p in field.named_parameters()}
        if ctx.segments is None:
            raise RuntimeError("the gradient of these segments was taken already: evaluate the field again")
        first = 0
        for segment in ctx.segments:
            rows = slice(first, first := first + len(segment.points))
            field._accumulate(segment, density_gradient[rows], latent_gradient[rows], gradients)
            field.spare.append(segment.memory)
        ctx.segments = None
        return None, None, *gradients.values()
