"""Score distillation of a mesh's colours finds the colours that an ideal denoiser knows."""

import dataclasses

import numpy as np
import pytest

from benchmarks._ideal import ideal_guidance
from pipeline.cameras import ring
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.unwrap import unwrap_mesh
from pipeline.options.paint import TrainPaint
from pipeline.paint.step import initial_paint, make_pool, paint_step
from pipeline.paint.surface_latents import complete
from pipeline.paint.view_weights import view_weights
from pipeline.training.background import LearnedBackground
from pipeline.training.batch import ViewGradient
from tests import shapes

OPTIONS = TrainPaint(
    steps=40, texture=24, views=12, resolution=12, supersampling=2, guidance_scale=1.0, signal_power=0.0,
    learning_rate=0.1, radius=(2.0, 2.2), fov_degrees=(40.0, 45.0),
)  # fmt: skip
BACKGROUNDS = np.array([[0.5, -0.5, 0.2, 0.1], [-1, 1, 0, 0.5]], np.float32)


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return unwrap_mesh(shapes.mesh_of(shapes.ball(0.6), 16), 64, 2)[0]


def truth(mesh: Mesh, texture: int | None) -> np.ndarray:
    """Return smooth latents of the texels or faces of a mesh: a wave over the surface."""
    from pipeline.mesh.texture import surface_texels
    from pipeline.paint.surface_latents import face_texels

    places = face_texels(mesh) if texture is None else surface_texels(mesh, texture)
    waves = np.concatenate([np.sin(3 * places.position), places.position[:, :1]], axis=1).astype(np.float32)
    return complete(mesh, places.place, waves, texture)[0]


def ideal(mesh: Mesh, latents: np.ndarray, texture: int | None) -> ViewGradient:
    """Return score distillation from the ideal denoiser of the mesh with these latents."""
    return ideal_guidance(
        lambda camera, size, flat: view_weights(mesh, camera, size, texture, 2).render(latents, flat),
        signal_power=0.0,
    )


@pytest.mark.parametrize("texture", [24, None])
def test_distillation_finds_the_colours(ball: Mesh, texture: int | None) -> None:
    wanted = truth(ball, texture)
    pool = make_pool(ball, OPTIONS, texture, 12, 0)
    state = initial_paint(OPTIONS, pool, BACKGROUNDS, 0)
    guidance = ideal(ball, wanted, texture)
    for _ in range(OPTIONS.steps):
        figures = paint_step(state, OPTIONS, pool, guidance)
    assert 0 < figures.coverage < 1
    latents, figures_of_fill = complete(ball, pool.seen, state.colours.detach().numpy(), texture)
    assert figures_of_fill["seen_share"] > 0.7
    plain = np.zeros(4, np.float32)
    errors = []
    for camera in ring(4, 1.2, 2.1, 0.75):
        view = view_weights(ball, camera, 12, texture, 2)
        difference = view.render(latents, plain) - view.render(wanted, plain)
        errors.append(np.sqrt((difference**2).mean() / view.covered.mean()))
    assert max(errors) < 0.15


def test_colours_move_by_the_rate_of_their_step(ball: Mesh) -> None:
    """Under a gradient that never changes, Adam moves every colour by its rate."""
    options = dataclasses.replace(OPTIONS, steps=5, views=4, learning_rate=0.1, cooling=0.5)
    pool = make_pool(ball, options, 24, 12, 0)
    state = initial_paint(options, pool, BACKGROUNDS, 0)
    moved = []
    for _ in range(options.steps):
        before = state.colours.detach().numpy().copy()
        paint_step(state, options, pool, lambda latents, batch: np.ones_like(latents))
        step = before - state.colours.detach().numpy()
        moved.append((step.min(), step.max()))
    wanted = np.array([0.1, 0.1, 0.1, 0.055, 0.01])
    np.testing.assert_allclose(moved, np.stack([wanted, wanted], 1), rtol=1e-3)


def test_the_same_seed_gives_the_same_colours(ball: Mesh) -> None:
    made = []
    for seed in (0, 0, 1):
        pool = make_pool(ball, OPTIONS, 32, 12, seed)
        state = initial_paint(OPTIONS, pool, BACKGROUNDS, seed)
        for _ in range(3):
            paint_step(state, OPTIONS, pool, lambda latents, batch: latents - batch.noise)
        made.append(state.colours.detach().numpy())
    assert made[0].tobytes() == made[1].tobytes()
    assert made[0].shape != made[2].shape or not np.array_equal(made[0], made[2])


def test_a_learned_background_learns_behind_the_mesh(ball: Mesh) -> None:
    options = dataclasses.replace(OPTIONS, background="learned", learning_rate=0.05)
    pool = make_pool(ball, options, 32, 12, 0)
    state = initial_paint(options, pool, BACKGROUNDS, 0)
    assert isinstance(state.background, LearnedBackground)
    target = np.array([1.0, -1, 0.5, 0], np.float32)[:, None, None]
    first = paint_step(state, options, pool, lambda latents, batch: latents - target)
    for _ in range(60):
        last = paint_step(state, options, pool, lambda latents, batch: latents - target)
    assert last.gradient_norm < 0.5 * first.gradient_norm


def test_a_gradient_that_is_not_finite_is_named(ball: Mesh) -> None:
    pool = make_pool(ball, OPTIONS, 32, 12, 0)
    state = initial_paint(OPTIONS, pool, BACKGROUNDS, 0)
    with pytest.raises(FloatingPointError, match="view gradient holds"):
        paint_step(state, OPTIONS, pool, lambda latents, batch: latents * np.float32(np.nan))
