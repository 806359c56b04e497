"""Score distillation end to end: from an ideal denoiser of a known scene it must find that scene."""

import numpy as np
import pytest
import torch

from pipeline.cameras import sphere
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import density
from pipeline.nerf.step import (
    binary_entropy,
    draw_batch,
    initial_state,
    training_step,
    unseen_thickness,
)
from pipeline.nerf.train import collapse, train
from pipeline.options.nerf import TrainNerf
from pipeline.training.batch import Batch, require_finite
from tests.oracle import TWO_BALLS, inside, oracle_guidance, picture

SIZE = 16
BACKGROUNDS = np.random.default_rng(5).standard_normal((16, 4)).astype(np.float32)
SMALL = {
    "samples_per_ray": 40,
    "density_bias": -3.0,
    "blob_density": 6.0,
    "blob_radius": 0.3,
    "grid_levels": 8,
    "grid_finest": 64,
    "grid_table_log2": 13,
}


def no_guidance(latents: np.ndarray, batch: Batch) -> np.ndarray:
    return np.zeros_like(latents)


def test_distillation_reconstructs_a_known_scene() -> None:
    options = TrainNerf(steps=100, sparsity_weight=0.1, updates_per_call=1, **SMALL)
    state = initial_state(options, BACKGROUNDS, 0)
    history: list = []
    train(state, history, options, SIZE, oracle_guidance(TWO_BALLS))
    assert not collapse(history)
    cameras = sphere(8, 1.25, np.deg2rad(55))
    views = render_views(state.scene, cameras, SIZE, BACKGROUNDS[0])
    truth = [picture(TWO_BALLS, camera, SIZE, BACKGROUNDS[0]) for camera in cameras]
    latents, opacity = np.stack([t[0] for t in truth]), np.stack([t[1] for t in truth])
    error = np.square(views.latents - latents).mean()
    assert 10 * np.log10(np.ptp(latents) ** 2 / error) > 27
    found, true = views.opacity > 0.5, opacity > 0.5
    assert (found & true).sum() / (found | true).sum() > 0.93
    # In space, not only in pictures: dense inside the balls, empty away from them.
    points = np.random.default_rng(1).uniform(-1, 1, (50_000, 3)).astype(np.float32)
    dense = density(state.scene, points) * state.scene.step > 0.5
    cells = tuple(np.minimum(((points + 1) * 32).astype(int), 63).T)
    dense &= state.scene.occupancy.occupied[cells]
    truly = inside(TWO_BALLS, points)
    grown = inside(tuple(b._replace(radius=b.radius + 0.1) for b in TWO_BALLS), points)
    assert (dense & ~grown).sum() < 0.01 * truly.sum()
    shells = inside(tuple(b._replace(radius=b.radius - 0.06) for b in TWO_BALLS), points)
    assert (dense & truly).sum() > 0.5 * truly.sum(), "balls, not shells or billboards"
    assert (dense & shells).sum() > 0.5 * shells.sum()


def test_opacity_and_entropy_weights_act() -> None:
    """With no guidance at all they alone move the scene: opacity down, entropy down."""
    for weight, figure in (("opacity_weight", "opacity"), ("sparsity_weight", "entropy")):
        plain = {"sparsity_weight": 0.0, "updates_per_call": 1}
        options = TrainNerf(steps=60, **{**plain, **SMALL, weight: 100.0})
        state = initial_state(options, BACKGROUNDS, 0)
        figures = [training_step(state, options, 8, no_guidance) for _ in range(options.steps)]
        first, last = (np.mean([getattr(f, figure) for f in part]) for part in (figures[:10], figures[-10:]))
        assert last < 0.7 * first, weight


def test_empty_cells_are_held_empty() -> None:
    """Rays do not see them: without the emptiness weight the push at the object raises their density too."""
    thickness = []
    for weight in (0.0, 100.0):
        plain = {"sparsity_weight": 0.0, "updates_per_call": 1}
        options = TrainNerf(steps=60, emptiness_weight=weight, **plain, **SMALL)
        state = initial_state(options, BACKGROUNDS, 0)
        for _ in range(options.steps):
            training_step(state, options, 8, lambda latents, batch: -10 * latents)
        corner = np.random.default_rng(0).uniform(0.7, 1, (2000, 3)).astype(np.float32)
        thickness.append(2 * float(density(state.scene, corner).mean()))
    assert thickness[1] < 0.1
    assert thickness[0] > 2 * thickness[1]


def test_unseen_thickness_is_that_of_a_uniform_box() -> None:
    state = initial_state(TrainNerf(**SMALL), BACKGROUNDS, 0)
    with torch.no_grad():
        for parameter in state.scene.field.parameters():
            parameter.zero_()
    state.scene.field.shape = state.scene.field.shape._replace(blob_density=0.0, density_bias=np.log(0.3))
    state.scene.occupancy = state.scene.occupancy._replace(occupied=np.zeros((4, 4, 4), np.bool_))
    assert float(unseen_thickness(state.scene, state.rng).detach()) == pytest.approx(0.6, rel=1e-4)
    half = np.zeros((4, 4, 4), np.bool_)
    half[:2] = True
    state.scene.occupancy = state.scene.occupancy._replace(occupied=half)
    assert float(unseen_thickness(state.scene, state.rng).detach()) == pytest.approx(0.3, rel=0.1)
    state.scene.occupancy = state.scene.occupancy._replace(occupied=np.ones((4, 4, 4), np.bool_))
    assert float(unseen_thickness(state.scene, state.rng).detach()) == 0


def test_learned_background_is_trained() -> None:
    options = TrainNerf(steps=2, background="learned", **SMALL)
    state = initial_state(options, BACKGROUNDS, 0)
    before = [p.detach().clone() for p in state.scene.background.parameters()]
    rng = np.random.default_rng(0)

    def pull(latents: np.ndarray, batch: Batch) -> np.ndarray:
        assert batch.backgrounds is None
        return rng.standard_normal(latents.shape).astype(np.float32)

    train(state, [], options, SIZE, pull)
    for old, new in zip(before, state.scene.background.parameters(), strict=True):
        assert not torch.equal(old, new)


def test_the_gradient_given_is_the_gradient_applied() -> None:
    """One step against the direct derivative: d(sum latents . g / views) by the parameters."""
    options = TrainNerf(steps=10, sparsity_weight=0.0, updates_per_call=1, **SMALL)
    taken: list[np.ndarray] = []

    def guidance(latents: np.ndarray, batch: Batch) -> np.ndarray:
        taken.append(latents)
        return np.ones_like(latents)

    state = initial_state(options, BACKGROUNDS, 0)
    bias = state.scene.field.bias3.detach().clone()
    training_step(state, options, SIZE, guidance)
    # All latents are to fall, so the latents' biases fall by one learning rate (Adam's first step).
    moved = (state.scene.field.bias3.detach() - bias)[1:]
    torch.testing.assert_close(moved, torch.full((4,), -options.learning_rate), rtol=1e-3, atol=0)
    again = initial_state(options, BACKGROUNDS, 0)
    training_step(again, options, SIZE, guidance)
    np.testing.assert_array_equal(taken[0], taken[1])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_nan_stops_at_once_and_is_named(value: float) -> None:
    options = TrainNerf(steps=10, **SMALL)
    state = initial_state(options, BACKGROUNDS, 0)

    def poisoned(latents: np.ndarray, batch: Batch) -> np.ndarray:
        gradient = np.zeros_like(latents)
        if state.step == 3:
            gradient[1, 2, 5, 5] = value
        return gradient

    history: list = []
    with pytest.raises(FloatingPointError, match=r"view gradient holds 1 .* at step 3"):
        train(state, history, options, SIZE, poisoned)
    assert len(history) == 3
    with torch.no_grad():
        state.scene.field.weight2[3, 3] = value
    with pytest.raises(FloatingPointError, match=r"rendered latents .* at step 3"):
        training_step(state, options, SIZE, no_guidance)


def test_large_finite_values_are_no_error() -> None:
    require_finite("x", np.full(100, 3e38, np.float32), 0)
    with pytest.raises(FloatingPointError, match="x holds 2 "):
        require_finite("x", torch.tensor([1.0, torch.inf, -torch.inf]), 7)


def test_draws_stay_in_their_ranges_and_follow_the_annealing() -> None:
    options = TrainNerf(
        cameras_per_step=8,
        timestep_min=0.1,
        timestep_max=0.9,
        timestep_max_end=0.3,
        guidance_scale=20,
        guidance_scale_end=5,
        gradient_clip=0.5,
        gradient_clip_end=2.0,
        radius=(1.1, 1.2),
        polar_degrees=(30, 60),
        **SMALL,
    )
    state = initial_state(options, BACKGROUNDS, 0)
    for progress, top, scale in ((0.0, 0.9, 20), (0.5, 0.6, 12.5), (1.0, 0.3, 5)):
        batch = draw_batch(options, progress, SIZE, state.scene, state.rng)
        assert batch.guidance_scale == scale
        assert batch.gradient_clip == pytest.approx(0.5 + 1.5 * progress)
        parts = np.floor((batch.noise_levels - 0.1) / (top - 0.1) * 8)
        np.testing.assert_array_equal(np.sort(parts), np.arange(8))
        assert ((batch.polars >= np.deg2rad(30)) & (batch.polars <= np.deg2rad(60))).all()
        assert batch.noise.shape == (8, 4, SIZE, SIZE)
        assert batch.backgrounds is not None
        assert all(any(np.array_equal(b, known) for known in BACKGROUNDS) for b in batch.backgrounds)
        distances = [np.linalg.norm(camera.pose[:3, 3]) for camera in batch.cameras]
        assert all(1.1 <= d <= 1.2 for d in distances)


def test_the_noise_may_fall_with_the_root_of_the_progress() -> None:
    options = TrainNerf(timestep_max=0.9, timestep_max_end=0.3, timestep_annealing="sqrt", **SMALL)
    state = initial_state(options, BACKGROUNDS, 0)
    for progress, top in ((0.0, 0.9), (0.25, 0.6), (1.0, 0.3)):
        levels = draw_batch(options, progress, SIZE, state.scene, state.rng).noise_levels
        assert top - (top - 0.02) / len(levels) <= levels.max() <= top


def test_entropy_matches_its_formula_and_is_finite_at_its_ends() -> None:
    opacity = torch.tensor([0.0, 1e-7, 0.25, 0.5, 1.0], requires_grad=True)
    entropy = binary_entropy(opacity)
    entropy.sum().backward()
    expected = -0.25 * np.log(0.25) - 0.75 * np.log(0.75)
    assert float(entropy[2].detach()) == pytest.approx(expected)
    assert float(entropy[3].detach()) == pytest.approx(np.log(2))
    assert float(entropy[0].detach()) == pytest.approx(1e-5 * (1 + np.log(1e5)), rel=1e-3)
    assert opacity.grad is not None
    assert torch.isfinite(opacity.grad).all()
    assert float(opacity.grad[2]) == pytest.approx(np.log(3), rel=1e-5)


@pytest.mark.parametrize(("opacity", "word"), [(0.0005, "empty"), (0.995, "fills")])
def test_collapse_is_said(opacity: float, word: str) -> None:
    (warning,) = collapse([{"opacity": 0.3}] * 50 + [{"opacity": opacity}] * 30)
    assert word in warning
    assert not collapse([{"opacity": opacity}] * 50 + [{"opacity": 0.3}] * 30)


def test_updates_of_one_call_go_towards_what_it_asked_for() -> None:
    """The guidance asks once a step; with more updates the views get nearer to where it wants them."""
    left = []
    for updates in (1, 6):
        options = TrainNerf(steps=10, sparsity_weight=0.0, updates_per_call=updates, **SMALL)
        state = initial_state(options, BACKGROUNDS, 0)
        asked: list[np.ndarray] = []

        def guidance(latents: np.ndarray, batch: Batch, asked: list = asked) -> np.ndarray:
            asked.append(latents)
            return np.full_like(latents, 0.5)

        cameras = sphere(4, 1.25, np.deg2rad(55))
        before = render_views(state.scene, cameras, 8, BACKGROUNDS[0]).latents
        training_step(state, options, 8, guidance)
        assert len(asked) == 1
        moved = render_views(state.scene, cameras, 8, BACKGROUNDS[0]).latents - before
        seen = before != BACKGROUNDS[0][:, None, None]
        left.append(np.abs(moved[seen] + 0.5).mean())
    assert left[1] < left[0]
