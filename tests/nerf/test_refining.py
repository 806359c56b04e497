"""A latent scene as an RGB scene: same shape, colours by the linear map, and normals for light."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from pipeline.cameras import sphere
from pipeline.nerf import occupancy
from pipeline.nerf.checkpoint import decode_state, encode_state
from pipeline.nerf.field import FieldShape, LatentField
from pipeline.nerf.linear_rgb import LinearRgb
from pipeline.nerf.refining import (
    initial_rgb_state,
    plain_compose,
    refinement_options,
    render_rgb,
    rgb_compose,
    rgb_over_background,
    shading,
    surface_normals,
)
from pipeline.nerf.rendering import make_rays, render_rays, render_views
from pipeline.nerf.scene import Scene, density, from_arrays, to_arrays
from pipeline.nerf.step import draw_batch, initial_state, training_step
from pipeline.options.nerf import Refinement, TrainNerf
from pipeline.training.background import FlatBackground, LearnedBackground
from pipeline.training.batch import Batch
from tests.nerf.test_step import BACKGROUNDS, SIZE, SMALL

RANDOM = np.random.default_rng(0)
MATRIX, BIAS = RANDOM.normal(size=(3, 4)), RANDOM.normal(size=3)
TRAIN = TrainNerf(steps=10, density_sharpening=4.0, **SMALL)
OPTIONS = refinement_options(TRAIN, Refinement(fit_steps=3, steps=7))
CAMERAS = sphere(3, 1.25, 1.0)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A ball with colours that vary over it."""
    state = initial_state(TRAIN, BACKGROUNDS, 0)
    with torch.no_grad():
        state.scene.field.weight3[1:] *= 30
        state.scene.field.table.uniform_(-0.3, 0.3, generator=torch.Generator().manual_seed(0))
    state.scene.field.sharpening = 3.0
    return state.scene


def refined(scene: Scene, **options: object) -> Scene:
    refinement = refinement_options(TRAIN, Refinement(**options))
    return initial_rgb_state(scene, LinearRgb(MATRIX, BIAS), refinement, 0).scene


def test_options_are_those_of_the_training_but_for_its_own() -> None:
    assert (OPTIONS.steps, OPTIONS.samples_per_ray, OPTIONS.density_sharpening) == (10, 40, 1.0)
    assert OPTIONS.learning_rate == Refinement().learning_rate
    assert OPTIONS.sparsity_weight == TRAIN.sparsity_weight


def test_nothing_grows_again() -> None:
    grown = refinement_options(TrainNerf(steps=10, sparsity_ramp=0.5, **SMALL), Refinement())
    assert grown.sparsity_ramp == 0


def test_it_starts_as_the_linear_map_of_the_latent_scene(scene: Scene) -> None:
    start = refined(scene)
    points = RANDOM.uniform(-1, 1, (500, 3)).astype(np.float32)
    np.testing.assert_allclose(density(start, points), density(scene, points), rtol=1e-4)
    latent = render_views(scene, CAMERAS, SIZE, np.zeros(4, np.float32))
    colours, opacity = render_rgb(start, CAMERAS, SIZE)
    np.testing.assert_allclose(opacity, latent.opacity, atol=1e-4)
    expected = np.einsum("rc,bchw->brhw", MATRIX, latent.latents) + BIAS[:, None, None] * opacity[:, None]
    np.testing.assert_allclose(colours, expected, atol=2e-3)
    assert opacity.max() > 0.9
    assert isinstance(start.background, FlatBackground)
    torch.testing.assert_close(start.background.colours[0], torch.full((3,), 2 / 3))


def test_mapping_pixels_is_mapping_samples(scene: Scene) -> None:
    """The reason why the layer may follow the compositing: by hand along one ray."""
    start = refined(scene)
    rays = make_rays(CAMERAS[:1], 3)
    with torch.no_grad():
        seen = render_rays(start, rays)
        whole = rgb_over_background(start, rays, seen, np.array([[0.1, 0.2, 0.3]], np.float32))[4].numpy()
    distances = np.arange(0, 4, start.step / 50) + 1e-3
    points = (rays.origins[4] + distances[:, None] * rays.directions[4]).astype(np.float32)
    keep = (np.abs(points) < 1).all(1)
    segment = start.field.evaluate(torch.from_numpy(points[keep]))
    optical = segment.density.numpy().astype(np.float64) * start.step / 50
    light = np.exp(-np.concatenate([[0], np.cumsum(optical)]))
    colours = segment.latents.numpy() @ MATRIX.T + BIAS
    expected = ((light[:-1] - light[1:])[:, None] * colours).sum(0) + light[-1] * np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(whole, expected, atol=0.05 * np.abs(colours).max())


def test_it_survives_its_file_and_a_checkpoint(scene: Scene) -> None:
    for background in ("random", "learned"):
        options = refinement_options(TRAIN, Refinement(background=background))
        state = initial_rgb_state(scene, LinearRgb(MATRIX, BIAS), options, 0)
        training_step(state, options, SIZE, lambda pictures, batch: np.ones_like(pictures),
                      compose=rgb_compose(Refinement(), state.rng), noise_size=4)  # fmt: skip
        again = from_arrays(to_arrays(state.scene))
        for (name, value), (same, other) in zip(
            to_arrays(state.scene).items(), to_arrays(again).items(), strict=True
        ):
            assert name == same
            np.testing.assert_array_equal(value, other)
        found, _ = decode_state(encode_state(state, []), options)
        assert found.scene.rgb is not None
        assert found.rng.random() == state.rng.random()


def test_the_layer_is_trained_with_the_field(scene: Scene) -> None:
    state = initial_rgb_state(scene, LinearRgb(MATRIX, BIAS), OPTIONS, 0)
    before = {name: p.detach().clone() for name, part in state.scene.modules.items()
              for name, p in part.named_parameters(prefix=name)}  # fmt: skip

    def up(pictures: np.ndarray, batch: Batch) -> np.ndarray:
        assert pictures.shape == (4, 3, SIZE, SIZE)
        assert batch.noise.shape == (4, 4, 5, 5)
        assert batch.backgrounds is not None
        assert batch.backgrounds.shape == (4, 3)
        return -np.ones_like(pictures)

    once = replace(OPTIONS, updates_per_call=1)
    training_step(state, once, SIZE, up, compose=rgb_compose(Refinement(), state.rng), noise_size=5)
    for name, part in state.scene.modules.items():
        for parameter, value in part.named_parameters(prefix=name):
            assert not torch.equal(value, before[parameter]), parameter
    assert state.scene.rgb is not None
    moved = state.scene.rgb.bias.detach() - torch.tensor(BIAS, dtype=torch.float32)
    torch.testing.assert_close(moved, torch.full((3,), OPTIONS.learning_rate), rtol=1e-3, atol=0)


def test_a_learned_background_goes_through_the_layer_too(scene: Scene) -> None:
    start = refined(scene, background="learned")
    assert isinstance(start.background, LearnedBackground)
    rays = make_rays(CAMERAS[:1], 4)
    with torch.no_grad():
        clear = render_rays(start, rays)
        empty = clear._replace(
            latents=torch.zeros_like(clear.latents),
            log_transmittance=torch.zeros_like(clear.log_transmittance),
        )
        seen = rgb_over_background(start, rays, empty, None).numpy()
        latents = start.background(torch.from_numpy(rays.directions)).numpy()
    np.testing.assert_allclose(seen, latents @ MATRIX.T + BIAS, rtol=1e-4, atol=1e-4)


def test_normals_of_a_ball_point_outwards_and_light_falls_on_one_side() -> None:
    scene = copy.deepcopy(initial_state(TrainNerf(**{**SMALL, "blob_density": 12.0}), BACKGROUNDS, 0).scene)
    with torch.no_grad():
        scene.field.table.zero_()
    points = RANDOM.normal(size=(50, 3))
    points = (0.4 * points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32)
    normals = surface_normals(scene, torch.from_numpy(points)).detach().numpy()
    np.testing.assert_allclose(normals, points / 0.4, atol=0.08)
    rays = make_rays(CAMERAS[:1], 17)
    with torch.no_grad():
        seen = render_rays(scene, rays)
        towards = CAMERAS[0].pose[:3, 2].astype(np.float32)[None]
        front = shading(scene, rays, seen, towards, 0.3)[:, 0].numpy().reshape(17, 17)
        back = shading(scene, rays, seen, -towards, 0.3)[:, 0].numpy().reshape(17, 17)
    hit = (-torch.expm1(seen.log_transmittance)).reshape(17, 17).numpy() > 0.5
    assert front[8, 8] > 0.95
    assert back[hit].mean() < 0.32
    assert back[8, 8] == pytest.approx(0.3)
    missed = (-torch.expm1(seen.log_transmittance)).reshape(17, 17).numpy() < 0.04
    assert (front[missed] == 1).all()


@pytest.mark.parametrize("bias", [0.0, -5.0, -12.0, -20.0, -40.0])
def test_the_normals_gradient_is_that_of_finite_differences_and_ends_where_nothing_is(bias: float) -> None:
    rng = np.random.default_rng(0)
    field = LatentField(
        FieldShape(levels=4, finest=32, table_log2=10, blob_density=0.0, density_bias=bias), rng
    )
    with torch.no_grad():
        field.table.mul_(3e3)
    scene = Scene(field, occupancy.everywhere(16), FlatBackground(np.zeros((1, 4), np.float32)), 48)
    points = torch.from_numpy(rng.uniform(-0.7, 0.7, (50, 3)).astype(np.float32))
    towards = torch.from_numpy(rng.standard_normal((50, 3)).astype(np.float32))
    (surface_normals(scene, points) * towards).sum().backward()
    weight = field.weight3
    assert weight.grad is not None
    if bias < -15:
        assert float(weight.grad.abs().max()) == 0
        return
    way = weight.grad / weight.grad.norm()

    def shown(move: float) -> float:
        with torch.no_grad():
            kept = weight.clone()
            weight.add_(move * way)
            value = float((surface_normals(scene, points).double() * towards).sum())
            weight.copy_(kept)
        return value

    slope = (shown(1e-3) - shown(-1e-3)) / 2e-3
    assert float(weight.grad.norm()) == pytest.approx(slope, rel=0.05)


def test_shading_reaches_the_shape(scene: Scene) -> None:
    start = refined(scene)
    rays = make_rays(CAMERAS[:1], 9)
    seen = render_rays(start, rays)
    light = shading(start, rays, seen, CAMERAS[0].pose[:3, 2].astype(np.float32)[None], 0.5)
    light.sum().backward()
    assert start.field.weight3.grad is not None
    assert float(start.field.weight3.grad[0].abs().sum()) > 0
    assert float(start.field.weight3.grad[1:].abs().sum()) == 0


def test_the_light_stays_for_all_updates_of_a_batch_and_the_fit_has_none(scene: Scene) -> None:
    start = refined(scene)
    rng = np.random.default_rng(0)
    compose = rgb_compose(Refinement(shading=1.0), rng)
    batches = [draw_batch(OPTIONS, 0.0, 9, start, rng) for _ in range(2)]
    shown = []
    for batch in (batches[0], batches[0], batches[1]):
        rays = make_rays(batch.cameras, 9)
        seen = render_rays(start, rays)
        shown.append(compose(start, rays, seen, batch).detach())
    assert torch.equal(shown[0], shown[1])
    rays = make_rays(batches[0].cameras, 9)
    plain = plain_compose(start, rays, render_rays(start, rays), batches[0]).detach()
    assert (plain - shown[0]).abs().max() > 0.05
