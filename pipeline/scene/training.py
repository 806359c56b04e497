"""One step of score distillation into a latent scene (Metzer et al. 2022, Latent-NeRF; DreamFusion's SDS).

Letters: b cameras a step, h x w latent pixels (square). The guidance is a function that looks at rendered
latents and says in which direction each should change; it returns that gradient, there is no loss behind
it. The regularisers are losses; both go through one backward pass.
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

from pipeline.nerf_options import TrainNerf
from pipeline.scene import occupancy
from pipeline.scene.adam import Adam
from pipeline.scene.background import FlatBackground, LearnedBackground
from pipeline.scene.batch import Batch, Guidance, make_batch, require_finite, require_steppable
from pipeline.scene.cameras import sample_cameras
from pipeline.scene.convergence import pace
from pipeline.scene.field import FieldShape, LatentField
from pipeline.scene.rendering import Rays, Seen, behind, make_rays, render_rays
from pipeline.scene.scene import Scene, density
from pipeline.scene.shape_loss import shape_loss
from pipeline.scene.sketch import Sketch, solid_cells
from pipeline.scene.sketch_start import grow

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
    looks: list[Float[np.ndarray, "v 4 h w"]] = field(default_factory=list)
    """The last looks at the scene, by which `convergence` judges it."""
    rest_at: int | None = None
    """Steps done when it was found at rest; None: it was not."""


class Figures(NamedTuple):
    """What a step tells of itself."""

    gradient_norm: float
    """Euclidean norm of the guidance's gradient by the latents of a view, root mean square over views."""
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


Compose = Callable[[Scene, Rays, Seen, Batch], Float[Tensor, "r c"]]
"""What a ray shows of what it met, over its background."""


def latents_over_background(scene: Scene, rays: Rays, seen: Seen, batch: Batch) -> Float[Tensor, "r 4"]:
    """Return the latents of each ray."""
    return seen.latents + seen.log_transmittance.exp()[:, None] * behind(scene, rays, batch.backgrounds)


def training_step(
    state: State,
    options: TrainNerf,
    resolution: int,
    guidance: Guidance,
    sketch: Sketch | None = None,
    compose: Compose = latents_over_background,
    noise_size: int | None = None,
) -> Figures:
    """Render views of `resolution`^2 latent pixels, ask the guidance about them, update the scene (once, or
    `updates_per_call` times towards what the guidance asked for).

    A `sketch` holds the density of all samples to its shape; rendering never skips its inside, since what is
    not sampled cannot grow. `compose` says what the guidance is shown, `noise_size` the side of its noise
    [latent pixels] where that is not the side of a view.

    Raises:
        FloatingPointError: a NaN or an infinity, named by tensor and step; the state is then not to be used.
    """
    clock = _Clock()
    scene, step = state.scene, state.step
    progress, rate = pace(step, options.steps, state.rest_at)
    scene.field.sharpening = options.density_sharpening ** max(0.0, 2 * progress - 1)
    scene.field.active_levels = active_levels(options, progress)
    size = max(1, resolution // 2) if progress < options.coarse_share else resolution
    if step % occupancy.REFRESH_EVERY == 0:
        kept = None if sketch is None else solid_cells(sketch, len(scene.occupancy.occupied))
        scene.occupancy = occupancy.refresh(
            scene.occupancy, lambda x: density(scene, x), scene.step, state.rng, kept
        )
        # A NaN would empty the grid, and what is not rendered cannot be found faulty.
        require_finite("density", scene.occupancy.density, step)
    batch = draw_batch(options, progress, noise_size or resolution, scene, state.rng)
    rays = make_rays(batch.cameras, size, state.rng)
    clock.lap("rest")

    asked: tuple[Float[np.ndarray, "b c h w"], Float[np.ndarray, "b c h w"]] | None = None
    for update in range(options.updates_per_call):
        seen = render_rays(scene, rays)
        opacity = -torch.expm1(seen.log_transmittance)
        pixels = compose(scene, rays, seen, batch)
        latents = pixels.reshape(-1, size, size, pixels.shape[1]).permute(0, 3, 1, 2)
        if size != resolution:
            latents = torch.nn.functional.interpolate(latents, (resolution, resolution), mode="bilinear")
        require_finite("rendered latents", latents, step)
        clock.lap("render")

        shown = np.ascontiguousarray(latents.detach().numpy())
        if asked is None:
            asked = shown.copy(), guidance(shown, batch)
            require_finite("guidance gradient", asked[1], step)
        # A gradient is a wish to move the views by its negative. Later updates go on towards the same place:
        # what is still to be moved is the gradient of half its square.
        gradient = asked[1] + (shown - asked[0])
        clock.lap("denoiser")

        entropy = binary_entropy(opacity).mean()
        growth = min(1.0, progress / options.sparsity_ramp) if options.sparsity_ramp else 1.0
        regulariser = growth * options.sparsity_weight * entropy + options.opacity_weight * opacity.mean()
        if options.emptiness_weight and update == 0:  # once a step is enough, for all of its updates
            weight = options.emptiness_weight * options.updates_per_call
            regulariser = regulariser + weight * unseen_thickness(scene, state.rng)
        roots = [latents, regulariser]
        gradients = [torch.from_numpy(gradient / np.float32(len(batch.cameras))), None]
        shape = 0.0
        if sketch is not None and seen.segments:
            points = torch.cat([segment.points for segment in seen.segments])
            values = seen.density.detach().numpy()
            shape, push = shape_loss(sketch, options.shape_sigma, points.numpy(), values)
            roots.append(seen.density)
            gradients.append(torch.from_numpy(push * np.float32(options.shape_weight)))
        state.optimizer.clear_gradients()
        torch.autograd.backward(roots, gradients)
        clock.lap("backward")
        _update(state, rate)
        clock.lap("rest")
    state.step += 1

    assert asked is not None  # there is one update at least
    norm = math.sqrt(float(np.square(asked[1], dtype=np.float64).sum()) / len(asked[1]))
    return Figures(
        norm,
        float(opacity.detach().mean()),
        float(entropy.detach()),
        shape,
        len(seen.density),
        clock.seconds,
    )


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


def active_levels(options: TrainNerf, progress: float) -> int:
    """Return how many levels of the grid count at `progress` in [0, 1] of the run: half of them at the start
    of the ramp, all from its end."""
    if progress >= options.level_ramp:
        return options.grid_levels
    share = 0.5 + 0.5 * progress / options.level_ramp
    return min(options.grid_levels, math.ceil(share * options.grid_levels))


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
