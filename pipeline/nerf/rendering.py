"""Volume rendering of a scene: march, evaluate what can be seen, composite.

Letters: b cameras, r rays, n samples of all rays (a ray's are consecutive), h x w pixels. Rays carry unit
directions. Rays are clipped to the box [-1, 1]^3 and sampled at a fixed step; samples in empty cells are
skipped, and so are those behind an opaque surface: the field is evaluated in rounds of a few samples a ray,
and a ray whose transmittance fell below 1e-4 takes no part in the next round, which leaves the picture as it
would be to 1e-4. An empty cell hides less than 1 % a sample, which adds up along a ray: at most 0.03 of its
opacity where that was measured (`benchmarks/results/skip.md`), more where thin fog fills a scene.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pipeline.cameras import Camera, camera_rays
from pipeline.kernels import march as kernels
from pipeline.kernels import parallel
from pipeline.nerf.field import LatentField, Segment
from pipeline.nerf.scene import Scene
from pipeline.training.batch import LATENT_CHANNELS

NEAR = 0.1
"""Nothing closer to the camera than this is seen [scene units]."""
_LEAST_OPACITY = 1e-3
"""A ray that is less opaque hits nothing."""
_ROUND = 8
"""Samples a ray in the first evaluation of the field; in the next twice as many, as long as few rays end."""
_FEW = 1 / 16
"""Of the rays of a round: fewer are not worth stopping for (on eight scenes 1 % more was evaluated, at
most)."""
_RAYS_PER_TASK = 256
_RAYS_PER_CHUNK = 16_384


class Rays(NamedTuple):
    """Rays with the position of their samples within the step."""

    origins: Float[np.ndarray, "r 3"]
    directions: Float[np.ndarray, "r 3"]
    """Unit length."""
    jitter: Float[np.ndarray, " r"]
    """In [0, 1): where in its first step a ray is sampled; .5 for the midpoint rule."""


class Samples(NamedTuple):
    """Where rays are sampled."""

    distances: Float[np.ndarray, " n"]
    offsets: Int[np.ndarray, " r+1"]
    """int64; ray i has the samples from `offsets[i]` to `offsets[i + 1]`."""
    step: float


class RayOutputs(NamedTuple):
    """What rays met, before any background."""

    latents: Float[Tensor, "r 4"]
    log_transmittance: Float[Tensor, " r"]
    depth: Float[Tensor, " r"]
    """Sum of the distances weighted as the latents are [scene units]."""
    density: Float[Tensor, " m"]
    """Of every evaluation of the field, in the order of `segments`; differentiable [1 / scene unit]."""
    segments: list[Segment]
    """The evaluations."""


class SampleCounts(NamedTuple):
    """Samples of some views: each number is left of the one before by one more kind of skipping."""

    all: int
    """Of every ray, as many as through the whole box."""
    in_box: int
    """Less those outside the box."""
    occupied: int
    """Less those in empty cells."""
    evaluated: int
    """Less those behind an opaque surface: what is done."""

    def skipped(self) -> dict[str, float]:
        """Return the share of all samples that each kind of skipping leaves out."""
        names = ("outside the box", "in empty cells", "behind a surface")
        return {
            name: round((more - less) / max(self.all, 1), 4)
            for name, more, less in zip(names, self[:-1], self[1:], strict=True)
        }


class Views(NamedTuple):
    """Rendered pictures."""

    latents: Float[np.ndarray, "b 4 h w"]
    opacity: Float[np.ndarray, "b h w"]
    depth: Float[np.ndarray, "b h w"]
    """Expected distance of what a ray hits, 0 where it hits nothing [scene units]."""


def make_rays(cameras: Sequence[Camera], size: int, rng: np.random.Generator | None = None) -> Rays:
    """Return the rays of all pixels of all cameras, sampled at random offsets or (no `rng`) at midpoints."""
    pairs = [camera_rays(camera, size) for camera in cameras]
    origins = np.repeat(np.stack([origin for origin, _ in pairs]), size * size, axis=0)
    directions = np.concatenate([direction for _, direction in pairs])
    count = len(directions)
    jitter = np.full(count, 0.5, np.float32) if rng is None else rng.random(count, np.float32)
    return Rays(origins, directions, jitter)


def march(rays: Rays, occupied: Bool[np.ndarray, "g g g"], step: float) -> Samples:
    """Return the samples of `rays` that lie in occupied cells."""
    count = len(rays.origins)
    arguments = (*rays, np.float32(NEAR), np.float32(step), occupied)
    counts = np.empty(count, np.int64)
    parallel.run(kernels.count, count, *arguments, counts, block=_RAYS_PER_TASK)
    offsets = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])
    distances = np.empty(offsets[-1], np.float32)
    parallel.run(kernels.fill, count, *arguments, offsets, distances, block=_RAYS_PER_TASK)
    return Samples(distances, offsets, float(np.float32(step)))


def evaluate_visible(
    field: LatentField, rays: Rays, samples: Samples, log_stop: float = kernels.LOG_STOP
) -> tuple[list[Segment], Int[np.ndarray, " n"]]:
    """Evaluate the field front to back, until each ray ends or its log transmittance is below `log_stop`.

    Returns the evaluations, one segment a round, and for every sample its row among them (int32; -1: unseen).
    """
    count = len(rays.origins)
    rows = np.full(len(samples.distances), -1, np.int32)
    cursor = samples.offsets[:-1].copy()
    dimmed = np.zeros(count)
    segments: list[Segment] = []
    base, at_once = 0, _ROUND
    while True:
        take = np.minimum(samples.offsets[1:] - cursor, at_once)
        take[dimmed < log_stop] = 0
        total = int(take.sum())
        if total == 0:
            return segments, rows
        first = base + np.cumsum(take) - take
        points = np.empty((total, 3), np.float32)
        where = (rays.origins, rays.directions, samples.distances, cursor, take, first, base, rows, points)
        parallel.run(kernels.gather, count, *where, block=_RAYS_PER_TASK)
        segment = field.evaluate(torch.from_numpy(points))
        segments.append(segment)
        light = (segment.density.numpy(), take, first, base, samples.step, dimmed)
        parallel.run(kernels.attenuate, count, *light, block=_RAYS_PER_TASK)
        cursor += take
        base += total
        stopped = np.count_nonzero((dimmed < log_stop) & (take > 0))
        at_once = 2 * at_once if stopped < _FEW * np.count_nonzero(take) else _ROUND


def composite(
    density: Float[Tensor, " m"],
    latents: Float[Tensor, "m 4"],
    samples: Samples,
    rows: Int[np.ndarray, " n"],
    log_stop: float = kernels.LOG_STOP,
) -> tuple[Float[Tensor, "r 4"], Float[Tensor, " r"], Float[Tensor, " r"]]:
    """Integrate along rays; return latents, depth, log transmittance, differentiable by the first two.

    `rows` says which row of `density` and `latents` a sample is, see `evaluate_visible`.
    """
    pixels, depth, log_transmittance = _Composite.apply(density, latents, samples, rows, log_stop)
    return pixels, depth, log_transmittance


def render_rays(scene: Scene, rays: Rays, log_stop: float = kernels.LOG_STOP) -> RayOutputs:
    """Render without background; differentiable by the field's parameters unless gradients are off.

    A ray is followed until the log of its transmittance is below `log_stop`; -inf: to its end.
    """
    samples = march(rays, scene.occupancy.occupied, scene.step)
    segments, rows = evaluate_visible(scene.field, rays, samples, log_stop)
    density, latents = scene.field.attach(segments)
    pixels, depth, log_transmittance = composite(density, latents, samples, rows, log_stop)
    return RayOutputs(pixels, log_transmittance, depth, density, segments)


def count_samples(scene: Scene, cameras: Sequence[Camera], size: int) -> SampleCounts:
    """Return what rendering these views takes, and would take if it skipped less."""
    rays = make_rays(cameras, size)
    box = march(rays, np.ones((1, 1, 1), np.bool_), scene.step)
    occupied = march(rays, scene.occupancy.occupied, scene.step)
    with torch.no_grad():
        segments, _ = evaluate_visible(scene.field, rays, occupied)
    return SampleCounts(
        len(rays.origins) * scene.samples_per_ray,
        len(box.distances),
        len(occupied.distances),
        sum(len(segment.points) for segment in segments),
    )


def background_of(scene: Scene, rays: Rays, flat: Float[np.ndarray, "b c"] | None) -> Float[Tensor, "r c"]:
    """Return the background of each ray: flat latents (or RGB) a camera, or (None) the scene's own."""
    if flat is None:
        own: Tensor = scene.background(torch.from_numpy(rays.directions))
        return own
    return torch.from_numpy(flat).repeat_interleave(len(rays.origins) // len(flat), dim=0)


def render_views(
    scene: Scene, cameras: Sequence[Camera], size: int, background: Float[np.ndarray, " 4"] | None = None
) -> Views:
    """Render `size` x `size` latents, opacity and depth, without gradients and without jitter.

    `background` are flat latents; None takes the scene's own (its first flat colour, or its network), which a
    refined scene has in RGB only: see `refining.render_rgb`.
    """
    pixels = size * size
    latents = np.empty((len(cameras), pixels, LATENT_CHANNELS), np.float32)
    opacity, depth = np.empty((2, len(cameras), pixels), np.float32)
    at_once = max(1, _RAYS_PER_CHUNK // pixels)
    with torch.no_grad():
        for first in range(0, len(cameras), at_once):
            chosen = slice(first, min(first + at_once, len(cameras)))
            rays = make_rays(cameras[chosen], size)
            outputs = render_rays(scene, rays)
            flat = None if background is None else np.asarray(background, np.float32)[None]
            transmittance = outputs.log_transmittance.exp()[:, None]
            shaded = outputs.latents + transmittance * background_of(scene, rays, flat)
            latents[chosen] = shaded.reshape(-1, pixels, LATENT_CHANNELS).numpy()
            hit = -torch.expm1(outputs.log_transmittance)
            opacity[chosen] = hit.reshape(-1, pixels).numpy()
            known = torch.where(hit > _LEAST_OPACITY, outputs.depth / hit.clamp(min=_LEAST_OPACITY), 0)
            depth[chosen] = known.reshape(-1, pixels).numpy()
    pictures = latents.reshape(-1, size, size, LATENT_CHANNELS).transpose(0, 3, 1, 2)
    shape = (len(cameras), size, size)
    return Views(np.ascontiguousarray(pictures), opacity.reshape(shape), depth.reshape(shape))


class _Composite(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, density: Tensor, latents: Tensor, samples: Samples, rows: np.ndarray, log_stop: float
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return latents, log transmittance and depth of each ray; see `kernels.march.composite`."""
        count = len(samples.offsets) - 1
        pixels = np.empty((count, latents.shape[1]), np.float32)
        depth, log_transmittance = np.empty((2, count), np.float32)
        used = np.empty(count, np.int64)
        ctx.inputs = (
            density.detach().numpy(),
            latents.detach().numpy(),
            samples.distances,
            rows,
            samples.offsets,
            samples.step,
        )
        outputs = (log_stop, pixels, depth, log_transmittance, used)
        parallel.run(kernels.composite, count, *ctx.inputs, *outputs, block=_RAYS_PER_TASK)
        ctx.used = used
        return torch.from_numpy(pixels), torch.from_numpy(depth), torch.from_numpy(log_transmittance)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Return the gradients by density and latents of the samples."""
        density, latents, *_ = ctx.inputs
        results = (np.zeros_like(density), np.zeros_like(latents))
        given = [g.contiguous().numpy() for g in gradients]
        count = len(ctx.used)
        parallel.run(
            kernels.composite_backward, count, *ctx.inputs, ctx.used, *given, *results, block=_RAYS_PER_TASK
        )
        return torch.from_numpy(results[0]), torch.from_numpy(results[1]), None, None, None
