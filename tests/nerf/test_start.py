"""A scene in other latents shows the same colours, and a fit brings a scene to known views."""

from dataclasses import replace

import numpy as np

from pipeline.cameras import sphere
from pipeline.nerf.rendering import render_views
from pipeline.nerf.start import (
    fit_options,
    fit_state,
    fit_step,
    linear_map,
    scene_in_other_latents,
    settled,
    started_state,
    view_groups,
)
from pipeline.nerf.step import initial_state
from pipeline.options.nerf import TrainNerf
from pipeline.training.encoded import Backdrops, KnownViews, encode_groups
from tests.nerf.test_step import SMALL

OPTIONS = TrainNerf(**{**SMALL, "learning_rate": 5e-3, "grid_learning_rate": 4e-2})
FLAT = np.linspace(-1, 1, 12, dtype=np.float32).reshape(3, 4)


def test_a_map_of_latents_keeps_their_colours() -> None:
    rng = np.random.default_rng(0)
    ours, theirs = rng.normal(size=(2, 3, 4))
    latents = rng.normal(size=(4, 50))
    np.testing.assert_allclose(ours @ linear_map(theirs, ours) @ latents, theirs @ latents, atol=1e-10)


def test_a_scene_in_other_latents_is_the_scene_mapped() -> None:
    scene = initial_state(OPTIONS, FLAT, 0).scene
    scene.field.sharpening = 3.0
    matrix, offset = np.random.default_rng(1).normal(size=(4, 4)), np.array([1.0, 0, -1, 2])
    mapped = scene_in_other_latents(scene, matrix, offset, FLAT, OPTIONS)
    cameras = sphere(3, 1.25, 1.0)
    before, after = (render_views(s, cameras, 8, np.zeros(4, np.float32)) for s in (scene, mapped))
    expected = (
        np.einsum("ij,bjhw->bihw", matrix, before.latents) + offset[:, None, None] * before.opacity[:, None]
    )
    np.testing.assert_allclose(after.latents, expected, atol=2e-4)
    np.testing.assert_allclose(after.opacity, before.opacity, atol=1e-5)
    assert scene.field.sharpening == 3.0, "the scene itself is left alone"


def test_a_fit_brings_a_scene_to_known_views_and_repeats() -> None:
    """The known views are those of another seed's scene, through an encoder that picks pixels."""
    options = fit_options(replace(OPTIONS, updates_per_call=3, sparsity_weight=5.0), 60)
    assert options.sparsity_weight == options.opacity_weight == 0
    truth = initial_state(replace(OPTIONS, blob_density=12.0), FLAT, 5).scene
    truth.field.bias3.data[1:] += np.array([0.8, -0.5, 0.2, 0.1], np.float32).astype(float).tolist()[0]

    def pictures(cameras, size):
        views = render_views(truth, cameras, size, np.zeros(4, np.float32))
        return views.latents[:, :3].transpose(0, 2, 3, 1), views.opacity

    def encode(images):
        return np.concatenate([images, images[..., :1]], -1).transpose(0, 3, 1, 2).astype(np.float32)

    colours = np.array([[0.2, 0.4, 0.6], [1, 1, 1]], np.float32)
    backdrops = Backdrops(np.concatenate([colours, colours[:, :1]], 1), colours)
    groups = view_groups(OPTIONS, 12, np.random.default_rng(0))
    assert sum(len(group[0]) for group in groups) >= 12
    results = []
    for _ in range(2):
        known = encode_groups(groups, pictures, encode, backdrops, 12, np.random.default_rng(1))
        state = fit_state(initial_state(OPTIONS, backdrops.latents, 0).scene, options, 0)
        views = KnownViews(known)
        errors = [fit_step(state, options, views, None, 12).gradient_norm for _ in range(60)]
        assert np.mean(errors[-6:]) < 0.4 * np.mean(errors[:6])
        scene = settled(state)
        results.append(scene.field.table.detach().numpy().tobytes())
    assert results[0] == results[1]


def test_a_training_goes_on_from_a_scene_with_its_own_numbers() -> None:
    scene = initial_state(OPTIONS, FLAT, 0).scene
    options = replace(OPTIONS, samples_per_ray=40, background="learned")
    state = started_state(scene, options, FLAT, 7)
    assert state.step == 0
    assert state.scene.samples_per_ray == 40
    assert not hasattr(state.scene.background, "colours")
    assert state.optimizer.state == {}
    back = started_state(state.scene, replace(options, background="random"), FLAT[:2], 7)
    assert len(back.scene.background.colours) == 2
