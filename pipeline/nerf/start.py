"""A latent scene that shows what an asset shows: the start of a training that goes on from it.

A field of other latents (of another model, or of RGB) keeps its density: only its last layer, and then its
colours, change. A mesh is grown as a sketch is. Both are fitted to encoded views.
"""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from jaxtyping import Float

from pipeline.cameras import sample_cameras
from pipeline.nerf import occupancy
from pipeline.nerf.scene import Scene, density
from pipeline.nerf.step import NerfMetrics, State, initial_state, make_optimizer, training_step
from pipeline.options.nerf import TrainNerf
from pipeline.sketch.lattice import Sketch
from pipeline.training.background import FlatBackground, LearnedBackground
from pipeline.training.encoded import Group, KnownViews

COOLING = 0.5
"""Last share of the fit, over which the rates fall to a tenth."""
STARTED_COOLING = 0.4
"""Last share of a training that goes on from a scene, over which the rates fall: it begins near its end."""
_STRICT = 0.05
"""SIGMA_S of the fit to a mesh, whose shape is known."""


def fit_options(train: TrainNerf, steps: int) -> TrainNerf:
    """Return the options of the fit: those of the training, without what drives a scene that is not known."""
    return replace(
        train,
        steps=steps,
        sparsity_weight=0.0,
        opacity_weight=0.0,
        density_sharpening=1.0,
        updates_per_call=1,
        sigma_s=_STRICT,
    )


def view_groups(train: TrainNerf, count: int, rng: np.random.Generator) -> list[Group]:
    """Draw `count` cameras, or a few more, as training does: in groups of one step each."""
    fov, polar = (np.radians(pair) for pair in (train.fov_degrees, train.polar_degrees))
    size = train.cameras_per_step
    ranges = train.radius, (float(fov[0]), float(fov[1])), (float(polar[0]), float(polar[1]))
    return [sample_cameras(rng, size, *ranges) for _ in range(-(-count // size))]


def linear_map(
    from_rgb: Float[np.ndarray, "3 4"], to_rgb: Float[np.ndarray, "3 4"]
) -> Float[np.ndarray, "4 4"]:
    """Return the map of latents to other latents that shows the same colours, of all such the shortest.

    Both are the linear parts of maps to RGB.
    """
    return np.asarray(np.linalg.pinv(to_rgb) @ from_rgb, np.float64)


def scene_in_other_latents(
    scene: Scene,
    matrix: Float[np.ndarray, "4 4"],
    offset: Float[np.ndarray, " 4"],
    backgrounds: Float[np.ndarray, "k 4"],
    options: TrainNerf,
) -> Scene:
    """Return a copy of a scene whose latents z are matrix @ z + offset, before flat `backgrounds`: a field's
    last layer is linear. The sharpening of its density becomes a part of it."""
    field = copy.deepcopy(scene.field)
    with torch.no_grad():
        weight, bias = field.weight3.numpy(), field.bias3.numpy()
        weight[1:] = matrix @ weight[1:]
        bias[1:] = matrix @ bias[1:] + offset
        bias[0] += np.log(field.sharpening)
    field.sharpening = 1.0
    return Scene(field, scene.occupancy, FlatBackground(backgrounds), options.samples_per_ray)


def fit_state(scene: Scene, options: TrainNerf, seed: int) -> State:
    """Return the state before the first step of a fit that begins with a scene."""
    return State(scene, make_optimizer(scene, options), np.random.default_rng([seed, 4]))


def mesh_state(sketch: Sketch, backgrounds: Float[np.ndarray, "k 4"], options: TrainNerf, seed: int) -> State:
    """Return the state before the first step of a fit to a mesh: its shape, in no particular colour."""
    flat = replace(options, background="random", shape_start=max(options.shape_start, 100))
    return initial_state(flat, backgrounds, seed, sketch)


def fit_step(
    state: State, options: TrainNerf, known: KnownViews, sketch: Sketch | None, size: int
) -> NerfMetrics:
    """Take one step towards known views of `size`^2 latent pixels."""
    return training_step(
        state, options, size, known.gradient, sketch=sketch, draw=known.draw, cooling=COOLING
    )


def settled(state: State) -> Scene:
    """Return the scene of a fit that has ended."""
    scene = state.scene
    scene.occupancy = occupancy.settle(
        scene.occupancy.occupied, partial(density, scene), scene.step, state.rng
    )
    return scene


def started_state(
    scene: Scene, options: TrainNerf, backgrounds: Float[np.ndarray, "k 4"], seed: int
) -> State:
    """Return the state before the first step of a training that goes on from `scene`, before flat
    `backgrounds` unless one is learned."""
    rng = np.random.default_rng(seed)
    scene.samples_per_ray = options.samples_per_ray
    if options.background == "random":
        scene.background = FlatBackground(backgrounds)
    elif not isinstance(scene.background, LearnedBackground):
        scene.background = LearnedBackground(rng)
    return State(scene, make_optimizer(scene, options), rng)
