"""One step of Latent-Paint (Metzer et al. 2022, section 3.3): score distillation of a fixed mesh's colours.

Letters: b cameras a step, h x w latent pixels, n colours (seen texels or faces), k flat backgrounds.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import nn

from pipeline.cameras import Camera, camera_rays, sample_cameras
from pipeline.mesh.mesh import Mesh
from pipeline.options.paint import TrainPaint
from pipeline.paint.view_weights import ViewWeights, seen_columns, view_weights
from pipeline.training.adam import Adam, rate_share
from pipeline.training.background import Background, FlatBackground, LearnedBackground
from pipeline.training.backward import backward
from pipeline.training.batch import (
    Batch,
    ViewGradient,
    make_batch,
    require_finite,
    require_steppable,
    root_mean_square_norm,
)


class Pool(NamedTuple):
    """The views of a run, in groups of one step each. They depend on the seed alone, not on the steps."""

    groups: list[tuple[list[Camera], Float[np.ndarray, " b"], Float[np.ndarray, " b"]]]
    """Cameras, azimuths and polar angles [rad]."""
    views: list[list[ViewWeights]]
    """Of every group; columns are the colours that are optimised."""
    seen: Int[np.ndarray, " n"]
    """The texel or face that each of these colours belongs to."""
    resolution: int


@dataclass
class PaintState:
    """Everything that a run carries from step to step."""

    colours: nn.Parameter
    """(n, 4) latents; (n, 3) RGB while being refined."""
    background: Background
    optimizer: Adam
    rng: np.random.Generator
    step: int = 0


class PaintMetrics(NamedTuple):
    """What a step tells of itself."""

    gradient_norm: float
    """Euclidean norm of the gradient by the latents of a view, root mean square over views."""
    coverage: float
    """Mean share of a view that the mesh covers."""
    seconds: dict[str, float]
    """Split: render, denoiser, backward and the rest."""


def make_pool(mesh: Mesh, options: TrainPaint, texture: int | None, resolution: int, seed: int) -> Pool:
    """Draw the views of a run and compute what each reads of a latent texture of that side (None: of the
    faces' colours)."""
    rng = np.random.default_rng([seed, 1])
    fov, polar = ([math.radians(v) for v in pair] for pair in (options.fov_degrees, options.polar_degrees))
    count = max(1, options.views // options.cameras_per_step)
    groups = [sample_cameras(rng, options.cameras_per_step, options.radius, fov, polar) for _ in range(count)]
    cameras = [camera for group in groups for camera in group[0]]
    seen, views = seen_columns(
        [view_weights(mesh, camera, resolution, texture, options.supersampling) for camera in cameras]
    )
    size = options.cameras_per_step
    return Pool(groups, [views[i : i + size] for i in range(0, len(views), size)], seen, resolution)


def shown_views(pool: Pool) -> list[ViewWeights]:
    """Return the four views that a preview shows: of all of the pool those nearest to the front, the left
    side, the back and the right side, which differ."""
    azimuths = np.concatenate([group[1] for group in pool.groups])
    views = [view for group in pool.views for view in group]
    sides = np.arange(min(4, len(views))) * np.pi / 2
    away = 1 - np.cos(azimuths[:, None] - sides)
    chosen: list[int] = []
    for side in range(len(sides)):
        nearest = np.argsort(away[:, side], kind="stable")
        chosen.append(next(int(i) for i in nearest if i not in chosen))
    return [views[i] for i in chosen]


def initial_paint(
    options: TrainPaint,
    pool: Pool,
    backgrounds: Float[np.ndarray, "k 4"],
    seed: int,
    start: Float[np.ndarray, "n 4"] | None = None,
) -> PaintState:
    """Return the state before the first step, with the colours of a `start`, else with noise."""
    rng = np.random.default_rng([seed, 2])
    background = LearnedBackground(rng) if options.background == "learned" else FlatBackground(backgrounds)
    drawn = options.initial_noise * rng.standard_normal((len(pool.seen), 4), np.float32)
    colours = nn.Parameter(torch.from_numpy((drawn if start is None else start).astype(np.float32)))
    return PaintState(colours, background, paint_optimizer(colours, background, options), rng)


def paint_optimizer(colours: nn.Parameter, background: Background, options: TrainPaint) -> Adam:
    """Return Adam; a learned background has a network's rate, a tenth of the colours'."""
    rate = options.learning_rate
    return Adam([([colours], rate), ([*background.parameters()], rate / 10)])


def paint_step(
    state: PaintState,
    options: TrainPaint,
    pool: Pool,
    view_gradient: ViewGradient,
    noise_size: int | None = None,
) -> PaintMetrics:
    """Render one group of views, ask for their gradient, update the colours they show.

    `noise_size`: side of the noise [latent pixels] where that is not the side of a view.

    Raises:
        FloatingPointError: a NaN or an infinity, named by tensor and step; the state is then not to be used.
    """
    clock = [time.perf_counter()]
    progress = state.step / max(options.steps - 1, 1)
    group = int(state.rng.integers(len(pool.groups)))
    views = pool.views[group]
    flat = None
    if isinstance(state.background, FlatBackground):
        known = state.background.colours.numpy()
        flat = known[state.rng.integers(len(known), size=len(views))]
    batch = make_batch(pool.groups[group], flat, options, progress, noise_size or pool.resolution, state.rng)
    backdrop = _backdrop(state.background, batch, pool.resolution)
    colours = state.colours.detach().numpy()
    latents = np.stack(
        [view.render(colours, b) for view, b in zip(views, backdrop.detach().numpy(), strict=True)]
    )
    require_finite("rendered latents", latents, state.step)
    clock.append(time.perf_counter())

    gradient = view_gradient(latents, batch)
    require_finite("view gradient", gradient, state.step)
    clock.append(time.perf_counter())

    state.optimizer.clear_gradients()
    share = gradient / np.float32(len(views))
    total = np.zeros_like(colours)
    for view, by_pixel in zip(views, share, strict=True):
        total += view.gradient(by_pixel)
    state.colours.grad = torch.from_numpy(total)
    if backdrop.requires_grad:
        open_share = np.stack([(1 - view.covered)[..., None] for view in views])
        backward([backdrop], [torch.from_numpy(share.transpose(0, 2, 3, 1) * open_share)])
    parameters = {"colours": state.colours, **dict(state.background.named_parameters("background"))}
    for name, parameter in parameters.items():
        require_steppable(name, parameter.grad, state.step)
    state.optimizer.step(rate_share(options.cooling, progress))
    for name, parameter in parameters.items():
        require_finite(name, parameter, state.step)
    state.step += 1
    clock.append(time.perf_counter())

    seconds = dict(zip(("render", "denoiser", "backward"), np.diff(clock).tolist(), strict=True))
    norm = root_mean_square_norm(gradient)
    return PaintMetrics(norm, float(np.mean([view.covered.mean() for view in views])), seconds)


def _backdrop(background: Background, batch: Batch, size: int) -> torch.Tensor:
    """Return what is behind the mesh, (b, h, w, 4) or, flat, (b, 1, 1, 4)."""
    if batch.backgrounds is not None:
        return torch.from_numpy(batch.backgrounds[:, None, None])
    directions = np.concatenate([camera_rays(camera, size)[1] for camera in batch.cameras])
    seen: torch.Tensor = background(torch.from_numpy(directions))
    return seen.reshape(len(batch.cameras), size, size, -1)
