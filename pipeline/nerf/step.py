"""One step of score distillation into a latent scene (Metzer et al. 2022, Latent-NeRF; DreamFusion's SDS).

Letters: b cameras a step, h x w latent pixels (square). A view gradient is a function of rendered latents
that says in which direction each should change; there is no loss behind it. The regularisers are losses; both
go through one backward pass.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pipeline.cameras import sample_cameras
from pipeline.nerf import occupancy
from pipeline.nerf.convergence import pace
from pipeline.nerf.field import FieldShape, LatentField
from pipeline.nerf.rendering import RayOutputs, Rays, background_of, make_rays, render_rays
from pipeline.nerf.scene import Scene, density
from pipeline.nerf.sketch_loss import shape_loss
from pipeline.nerf.sketch_start import grow
from pipeline.options.nerf import TrainNerf
from pipeline.sketch.lattice import Sketch, solid_cells
from pipeline.training.adam import Adam, rate_share
from pipeline.training.background import FlatBackground, LearnedBackground
from pipeline.training.backward import backward
from pipeline.training.batch import (
    Batch,
    ViewGradient,
    make_batch,
    require_finite,
    require_steppable,
    root_mean_square_norm,
)

_ENTROPY_CLAMP = 1e-5
_PROBES = 512
"""Points at which a step looks into the cells that rendering skips."""


@dataclass
class State:
    """Everything that a training run carries from step to step."""

    scene: Scene
    optimizer: Adam
    rng: np.random.Generator
    """The only source of random numbers."""
    step: int = 0
    """Steps done."""
    snapshots: list[Float[np.ndarray, "v 4 h w"]] = field(default_factory=list)
    """The last views of the scene, by which `convergence` judges it."""
    converged_at: int | None = None
    """Steps done when it was found converged; None: it was not."""


class NerfMetrics(NamedTuple):
    """What a step tells of itself."""

    gradient_norm: float
    """Euclidean norm of the gradient by the latents of a view, root mean square over views."""
    opacity: float
    """Mean over all pixels."""
    entropy: float
    """Mean binary entropy of the pixels' opacities [nats]."""
    shape: float
    """Mean weighted cross-entropy between the sketch and the scene [nats]; 0 without a sketch."""
    samples: int
    """Evaluations of the field in the last update."""
    seconds: dict[str, float]
    """Split: render, denoiser, backward, rest."""


def initial_state(
    options: TrainNerf, backgrounds: Float[np.ndarray, "k 4"], seed: int, sketch: Sketch | None = None
) -> State:
    """Return the state before the first step. `backgrounds` are the flat latents that views are drawn on.

    With a sketch the scene starts as that, instead of as the blob at the centre, which would hide it.
    """
    rng = np.random.default_rng(seed)
    shape = FieldShape(
        levels=options.grid_levels,
        finest=options.grid_finest,
        table_log2=options.grid_table_log2,
        blob_density=options.blob_density if sketch is None else 0.0,
        blob_radius=options.blob_radius,
        density_bias=options.density_bias,
    )
    latent_field = LatentField(shape, rng)
    learned = options.background == "learned"
    background = LearnedBackground(rng) if learned else FlatBackground(backgrounds)
    scene = Scene(latent_field, occupancy.everywhere(), background, options.samples_per_ray)
    state = State(scene, make_optimizer(scene, options), rng)
    if sketch is not None:
        grow(latent_field, state.optimizer, sketch, rng, options.shape_start)
    return state


def make_optimizer(scene: Scene, options: TrainNerf) -> Adam:
    """Return Adam with the paper's settings: the grid's rate is higher, its entries see few gradients."""
    networks = [p for p in scene.field.parameters() if p is not scene.field.table]
    others = [p for name, part in scene.modules.items() if name != "field" for p in part.parameters()]
    return Adam(
        [([scene.field.table], options.grid_learning_rate), ([*networks, *others], options.learning_rate)]
    )


Draw = Callable[[int], Batch]
"""The steps done -> the next batch."""
Compose = Callable[[Scene, Rays, RayOutputs, Batch], Float[Tensor, "r c"]]
"""What a ray shows of what it met, over its background."""


def latents_over_background(
    scene: Scene, rays: Rays, outputs: RayOutputs, batch: Batch
) -> Float[Tensor, "r 4"]:
    """Return the latents of each ray."""
    transmittance = outputs.log_transmittance.exp()[:, None]
    return outputs.latents + transmittance * background_of(scene, rays, batch.backgrounds)


def training_step(
    state: State,
    options: TrainNerf,
    resolution: int,
    view_gradient: ViewGradient,
    *,
    sketch: Sketch | None = None,
    compose: Compose = latents_over_background,
    noise_size: int | None = None,
    draw: Draw | None = None,
    cooling: float = 0.0,
) -> NerfMetrics:
    """Render views of `resolution`^2 latent pixels, ask for their gradient, update the scene (once, or
    `updates_per_call` times towards what was asked for).

    A `sketch` holds the density of all samples to its shape; rendering never skips its inside, since what is
    not sampled cannot grow. `compose` says what `view_gradient` is shown, `noise_size` the side of its noise
    [latent pixels] where that is not the side of a view. `draw` gives the batch of a step in place of
    `draw_batch`. `cooling`: over this last share of the run the learning rates fall to a tenth.

    Raises:
        FloatingPointError: a NaN or an infinity, named by tensor and step; the state is then not to be used.
    """
    clock = _Clock()
    scene, step = state.scene, state.step
    progress, rate = pace(step, options.steps, state.converged_at)
    rate *= rate_share(cooling, progress)
    scene.field.sharpening = options.density_sharpening ** max(0.0, 2 * progress - 1)
    if occupancy.due(step, options.updates_per_call):
        refresh_occupancy(state, sketch)
    if draw is None:
        batch = draw_batch(options, progress, noise_size or resolution, scene, state.rng)
    else:
        batch = draw(step)
    rays = make_rays(batch.cameras, resolution, state.rng)
    clock.lap("rest")

    first: tuple[Float[np.ndarray, "b c h w"], Float[np.ndarray, "b c h w"]] | None = None
    for update in range(options.updates_per_call):
        outputs = render_rays(scene, rays)
        opacity = -torch.expm1(outputs.log_transmittance)
        pixels = compose(scene, rays, outputs, batch)
        views = pixels.reshape(-1, resolution, resolution, pixels.shape[1]).permute(0, 3, 1, 2)
        require_finite("rendered latents", views, step)
        clock.lap("render")

        shown = np.ascontiguousarray(views.detach().numpy())
        if first is None:
            first = shown.copy(), view_gradient(shown, batch)
            require_finite("view gradient", first[1], step)
        # A gradient is a wish to move the views by its negative. Later updates go on towards the same place:
        # what is still to be moved is the gradient of half its square.
        gradient = first[1] + (shown - first[0])
        clock.lap("denoiser")

        entropy = binary_entropy(opacity).mean()
        roots = [views, regulariser(state, options, progress, opacity, entropy, update)]
        gradients = [torch.from_numpy(gradient / np.float32(len(batch.cameras))), torch.ones(())]
        shape = 0.0
        if sketch is not None and outputs.segments:
            shape, push = sketch_gradient(sketch, options, outputs)
            roots.append(outputs.density)
            gradients.append(push)
        state.optimizer.clear_gradients()
        backward(roots, gradients)
        clock.lap("backward")
        _update(state, rate)
        clock.lap("rest")
    state.step += 1

    assert first is not None  # there is one update at least
    return NerfMetrics(
        gradient_norm=root_mean_square_norm(first[1]),
        opacity=float(opacity.detach().mean()),
        entropy=float(entropy.detach()),
        shape=shape,
        samples=len(outputs.density),
        seconds=clock.seconds,
    )


def refresh_occupancy(state: State, sketch: Sketch | None) -> None:
    """Look again where the scene may hold something; the inside of a sketch stays."""
    scene = state.scene
    kept = None if sketch is None else solid_cells(sketch, len(scene.occupancy.occupied))
    scene.occupancy = occupancy.refresh(
        scene.occupancy, lambda x: density(scene, x), scene.step, state.rng, kept
    )
    # A NaN would empty the grid, and what is not rendered cannot be found faulty.
    require_finite("density", scene.occupancy.density, state.step)


def regulariser(
    state: State,
    options: TrainNerf,
    progress: float,
    opacity: Float[Tensor, " r"],
    entropy: Float[Tensor, ""],
    update: int,
) -> Float[Tensor, ""]:
    """Return what is minimised beside the distillation: sparsity (the mean binary entropy of opacities),
    opacity, and density where rendering skips, which is enough once a step, for all of its updates."""
    growth = min(1.0, progress / options.sparsity_ramp) if options.sparsity_ramp else 1.0
    loss = growth * options.sparsity_weight * entropy + options.opacity_weight * opacity.mean()
    if options.emptiness_weight and update == 0:
        weight = options.emptiness_weight * options.updates_per_call
        loss = loss + weight * unseen_thickness(state.scene, state.rng)
    return loss


def sketch_gradient(
    sketch: Sketch, options: TrainNerf, outputs: RayOutputs
) -> tuple[float, Float[Tensor, " n"]]:
    """Return the shape loss at the samples of rays, and its weighted gradient by their densities."""
    points = torch.cat([segment.points for segment in outputs.segments])
    loss, push = shape_loss(sketch, options.sigma_s, points.numpy(), outputs.density.detach().numpy())
    return loss, torch.from_numpy(push * np.float32(options.shape_weight))


class _Clock:
    """How long the parts of a step take."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(("render", "denoiser", "backward", "rest"), 0.0)
        self.last = time.perf_counter()

    def lap(self, part: str) -> None:
        """Count the time since the last call for `part`."""
        now = time.perf_counter()
        self.seconds[part] += now - self.last
        self.last = now


def _update(state: State, rate: float) -> None:
    """Let the optimiser act on the gradients, which must be finite, as must what it makes, at that share of
    its rates."""
    modules = state.scene.modules.items()
    parameters = {f"{m}.{n}": p for m, part in modules for n, p in part.named_parameters()}
    for name, parameter in parameters.items():
        require_steppable(name, parameter.grad, state.step)
    state.optimizer.step(rate)
    for name, parameter in parameters.items():
        require_finite(name, parameter, state.step)


def draw_batch(
    options: TrainNerf, progress: float, resolution: int, scene: Scene, rng: np.random.Generator
) -> Batch:
    """Draw cameras, backgrounds, noise levels and noise of the step at `progress` in [0, 1] of the run."""
    count = options.cameras_per_step
    fov, polar = ([math.radians(v) for v in pair] for pair in (options.fov_degrees, options.polar_degrees))
    views = sample_cameras(rng, count, options.radius, fov, polar)
    backgrounds = None
    if isinstance(scene.background, FlatBackground):
        colours = scene.background.colours.numpy()
        backgrounds = colours[rng.integers(len(colours), size=count)]
    return make_batch(views, backgrounds, options, progress, resolution, rng)


def unseen_thickness(scene: Scene, rng: np.random.Generator) -> Float[Tensor, ""]:
    """Return the optical thickness of the box, across its width, due to the cells that rendering skips.

    Estimated at random points. No ray sees these cells, so nothing else would hold their density down while
    the network they share with the object moves: haze would gather there and appear everywhere at once.
    """
    points = rng.uniform(-1, 1, (_PROBES, 3)).astype(np.float32)
    cells = len(scene.occupancy.occupied)
    index = np.minimum(((points + 1) * (cells / 2)).astype(np.int64), cells - 1)
    hidden = torch.from_numpy(points[~scene.occupancy.occupied[tuple(index.T)]])
    density, _ = scene.field.attach([scene.field.evaluate(hidden)] if len(hidden) else [])
    return density.sum() * (2 / _PROBES)


def binary_entropy(opacity: Float[Tensor, " r"]) -> Float[Tensor, " r"]:
    """Return -o log o - (1 - o) log(1 - o) [nats], clamped 1e-5 from both ends as in the paper's code."""
    clamped = opacity.clamp(_ENTROPY_CLAMP, 1 - _ENTROPY_CLAMP)
    return -clamped * clamped.log() - (1 - clamped) * torch.log1p(-clamped)
