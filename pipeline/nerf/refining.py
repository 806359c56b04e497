"""A latent scene as an RGB scene: the start of refinement, and what its rays show.

Letters: b cameras, r rays, h x w pixels, n points, k flat colours. Shading (Lambertian, as in DreamFusion) is
defined in RGB only: colour times ambient + (1 - ambient) max(0, normal . light), normals being those of the
density's level sets where a ray is expected to end.
"""

import copy
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from pipeline.cameras import Camera
from pipeline.nerf.field import LEAST_DENSITY
from pipeline.nerf.linear_rgb import LinearRgb
from pipeline.nerf.rendering import RayOutputs, Rays, background_of, render_views
from pipeline.nerf.scene import Scene
from pipeline.nerf.step import Compose, State, make_optimizer
from pipeline.options.nerf import Refinement, TrainNerf, refined
from pipeline.training.background import FlatBackground, LearnedBackground
from pipeline.training.batch import Batch
from pipeline.training.flat_colours import flat_colours

_GREY = 2 / 3
_LEAST_OPACITY = 0.05
"""What is less opaque has no surface to light."""
_LIGHT_SPREAD = 0.8
_TETRAHEDRON = torch.tensor([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 3**0.5


def refinement_options(train: TrainNerf, refinement: Refinement) -> TrainNerf:
    """Return the options of refinement's steps: its own, and for the rest those that the field was trained
    with; what grew over that training stays as it ended."""
    steps = refinement.fit_steps + refinement.steps
    return refined(train, refinement, steps=steps, sparsity_ramp=0.0, density_sharpening=1.0)


def initial_rgb_state(scene: Scene, rgb: LinearRgb, options: TrainNerf, seed: int) -> State:
    """Return the state before the first step in RGB: a copy of the latent scene, seen through `rgb`."""
    rng = np.random.default_rng([seed, 3])
    field = copy.deepcopy(scene.field)
    with torch.no_grad():  # density is exp(raw + ...) sharpened: the sharpening moves into the bias
        field.bias3[0] += float(np.log(field.sharpening))
    field.sharpening = 1.0
    background = scene.background
    if options.background == "random":
        colours = flat_colours()
        background = FlatBackground(np.roll(colours, -np.abs(colours - _GREY).sum(1).argmin(), axis=0))
    elif not isinstance(background, LearnedBackground):
        background = LearnedBackground(rng)
    refined = Scene(field, scene.occupancy, copy.deepcopy(background), scene.samples_per_ray, rgb)
    return State(refined, make_optimizer(refined, options), rng)


def rgb_over_background(
    scene: Scene,
    rays: Rays,
    outputs: RayOutputs,
    flat: Float[np.ndarray, "b 3"] | None,
    light: Tensor | None = None,
) -> Float[Tensor, "r 3"]:
    """Return the colour of each ray of an RGB scene, multiplied by `light` (r, 1) where that is given."""
    assert scene.rgb is not None
    transmittance = outputs.log_transmittance.exp()[:, None]
    colours = scene.rgb(outputs.latents, 1 - transmittance)
    if light is not None:
        colours = colours * light
    back = background_of(scene, rays, flat)
    if isinstance(scene.background, LearnedBackground):
        back = scene.rgb(back, torch.ones_like(transmittance))
    return colours + transmittance * back


def plain_compose(scene: Scene, rays: Rays, outputs: RayOutputs, batch: Batch) -> Float[Tensor, "r 3"]:
    """Return what the fit is shown, whose targets are not lit: plain colours."""
    return rgb_over_background(scene, rays, outputs, batch.backgrounds)


def rgb_compose(refinement: Refinement, rng: np.random.Generator) -> Compose:
    """Return what refinement's guidance is shown: plain colours, or in a share of the steps lit ones. The
    light of a batch stays for all updates towards what was asked of it."""
    lit: Batch | None = None
    towards: Float[np.ndarray, "b 3"] | None = None

    def compose(scene: Scene, rays: Rays, outputs: RayOutputs, batch: Batch) -> Float[Tensor, "r 3"]:
        nonlocal lit, towards
        if batch is not lit:
            lit, towards = batch, None
            if refinement.shading and rng.random() < refinement.shading:
                towards = np.stack([camera.pose[:3, 2] for camera in batch.cameras])
                towards = towards + _LIGHT_SPREAD * rng.standard_normal(towards.shape)
                towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        light = None
        if towards is not None:
            light = shading(scene, rays, outputs, towards.astype(np.float32), refinement.ambient)
        return rgb_over_background(scene, rays, outputs, batch.backgrounds, light)

    return compose


def shading(
    scene: Scene, rays: Rays, outputs: RayOutputs, lights: Float[np.ndarray, "b 3"], ambient: float
) -> Float[Tensor, "r 1"]:
    """Return how lit each ray's surface is, in [ambient, 1]; `lights`: unit vectors towards the light, one a
    camera. Differentiable by the field's parameters through the normals."""
    opacity = -torch.expm1(outputs.log_transmittance.detach())
    hit = torch.nonzero(opacity > _LEAST_OPACITY)[:, 0]
    lit = torch.ones(len(opacity), 1)
    if not len(hit):
        return lit
    distance = (outputs.depth.detach() / opacity.clamp(min=_LEAST_OPACITY))[hit, None]
    rows = hit.numpy()
    points = torch.from_numpy(rays.origins[rows]) + distance * torch.from_numpy(rays.directions[rows])
    towards = torch.from_numpy(lights[rows // (len(opacity) // len(lights))])
    facing = (surface_normals(scene, points) * towards).sum(1, keepdim=True).clamp(min=0)
    return lit.index_put((hit,), ambient + (1 - ambient) * facing)


def surface_normals(scene: Scene, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
    """Return unit vectors against the gradient of the log density, from four points half a sample away."""
    corners = (points[:, None] + scene.step / 2 * _TETRAHEDRON).reshape(-1, 3).clamp(-1, 1).contiguous()
    density, _ = scene.field.attach([scene.field.evaluate(corners)])
    logarithm = density.clamp(min=LEAST_DENSITY).log().reshape(-1, 4)
    return -functional.normalize(logarithm @ _TETRAHEDRON, dim=1, eps=1e-6)


def render_rgb(
    scene: Scene, cameras: Sequence[Camera], size: int
) -> tuple[Float[np.ndarray, "b 3 h w"], Float[np.ndarray, "b h w"]]:
    """Return `size` x `size` pictures of an RGB scene over black, unlit, not clipped, and their opacity."""
    assert scene.rgb is not None
    views = render_views(scene, cameras, size, np.zeros(4, np.float32))
    matrix, bias = (p.detach().numpy() for p in (scene.rgb.matrix, scene.rgb.bias))
    colours = np.einsum("rc,bchw->brhw", matrix, views.latents) + bias[:, None, None] * views.opacity[:, None]
    return colours.astype(np.float32), views.opacity
