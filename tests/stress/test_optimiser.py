"""The optimiser over very long runs, without gradients, and with enormous ones."""

import copy

import numpy as np
import pytest
import torch
from torch import nn

from benchmarks._ideal import linear_schedule
from pipeline.diffusion.distillation import sds_gradient
from pipeline.nerf.step import State, initial_state, training_step
from pipeline.options.nerf import TrainNerf
from pipeline.options.paint import TrainPaint
from pipeline.paint.step import paint_optimizer
from pipeline.training.adam import Adam
from pipeline.training.background import FlatBackground
from pipeline.training.batch import Batch, require_steppable
from tests.nerf.test_step import BACKGROUNDS, SMALL, no_guidance

QUIET = {"sparsity_weight": 0.0, "emptiness_weight": 0.0}
STEPS, CHUNK, TEXELS = 100_000, 10_000, 4
SPREAD = 0.1


def test_100_000_steps_on_an_oracle_neither_drift_nor_stop() -> None:
    """Score distillation of a few texels from the ideal denoiser of N(target, SPREAD^2), in closed form."""
    rng = np.random.default_rng(0)
    target = rng.standard_normal((TEXELS, 4)).astype(np.float32)
    schedule = linear_schedule()
    options = TrainPaint()
    colours = nn.Parameter(torch.zeros(TEXELS, 4))
    optimizer = paint_optimizer(colours, FlatBackground(BACKGROUNDS), options)
    gradient = torch.zeros(TEXELS, 4)
    colours.grad = gradient
    values, slope = colours.detach().numpy(), gradient.numpy()  # the same memory
    errors, spreads = [], []
    for _ in range(STEPS // CHUNK):
        timesteps = rng.integers(20, 980, CHUNK)
        signal, sigma = (f.reshape(-1, 1, 1) for f in schedule.factors(timesteps))
        noise = rng.standard_normal((CHUNK, TEXELS, 4), np.float32)
        scale = signal**2 * SPREAD**2 + sigma**2
        # w (eps* - eps) = pull (x - target) + push, w = sqrt(abar) (1 - abar)
        weight = signal * sigma**2
        pull = (weight * signal * sigma / scale).astype(np.float32)
        push = (weight * (sigma**2 / scale - 1) * noise).astype(np.float32)
        total, squares = np.zeros((2, TEXELS, 4))
        for i in range(CHUNK):
            np.subtract(values, target, out=slope)
            total += slope
            squares += slope * slope
            slope *= pull[i]
            slope += push[i]
            optimizer.step()
        errors.append(np.abs(total / CHUNK).max())
        spreads.append(np.sqrt(squares.mean() / CHUNK))
    assert np.isfinite(values).all()
    assert max(errors[1:]) < 0.02, "the mean of every stretch of 10,000 steps is the target"
    assert max(spreads[1:]) < 1.2 * min(spreads[1:]), "and they scatter about it as at the start"
    moments = optimizer.state[colours]
    assert float(moments["step"]) == STEPS
    assert all(torch.isfinite(moments[name]).all() for name in ("exp_avg", "exp_avg_sq"))

    # The closed form is what the pipeline computes.
    def ideal(sample: np.ndarray, t: np.ndarray, text: np.ndarray) -> np.ndarray:
        a, b = schedule.factors(t)
        mu = target.reshape(TEXELS, 4, 1, 1)
        return np.asarray((sample - a * mu) * b / (a**2 * SPREAD**2 + b**2), np.float32)

    text = np.zeros((TEXELS, 1, 1), np.float32)
    found = sds_gradient(
        values.reshape(TEXELS, 4, 1, 1), ideal, schedule, np.full(TEXELS, timesteps[-1]),
        noise[-1].reshape(TEXELS, 4, 1, 1), text, text[0], 1.0, signal_power=0.5,
    ).gradient  # fmt: skip
    # The weights above were those of the last step: recompute its slope from the colours as they are now.
    expected = pull[-1] * (values - target) + push[-1]
    np.testing.assert_allclose(found.reshape(TEXELS, 4), expected, rtol=1e-3, atol=1e-6)


def parameters(state: State) -> dict[str, torch.Tensor]:
    return {name: p.detach().clone() for name, p in state.scene.field.named_parameters()}


def test_without_a_gradient_nothing_moves() -> None:
    """0 / (sqrt(0) + 1e-15) is 0, also for the parameters that no ray reached."""
    options = TrainNerf(steps=20, updates_per_call=1, **QUIET, **SMALL)
    state = initial_state(options, BACKGROUNDS, 0)
    before = parameters(state)
    for _ in range(3):
        assert training_step(state, options, 4, no_guidance).gradient_norm == 0
    for name, value in parameters(state).items():
        assert torch.equal(value, before[name]), name


@pytest.mark.parametrize("size", [1e-30, 1e-18, 1e-9, 1e9, 1e14])
def test_gradients_of_any_size_move_by_the_learning_rate(size: float) -> None:
    """Adam's first step does not know the size: not where squares underflow, not where they are enormous."""
    options = TrainNerf(steps=20, updates_per_call=1, **QUIET, **SMALL)
    state = initial_state(options, BACKGROUNDS, 0)
    before = parameters(state)
    training_step(state, options, 4, lambda latents, batch: np.full_like(latents, size))
    for name, value in parameters(state).items():
        moved = (value - before[name]).abs().max()
        rate = options.grid_learning_rate if name == "table" else options.learning_rate
        assert torch.isfinite(value).all()
        assert float(moved) <= rate * 1.01
        if size > 1:  # what reaches the weights is then well above Adam's 1e-15
            assert float(moved) > 0.9 * rate, name


def test_a_gradient_too_large_to_be_squared_is_refused_before_the_step() -> None:
    """Adam would take it: no NaN, only a second moment that is infinite and a parameter that never moves."""
    parameter = nn.Parameter(torch.zeros(2))
    adam = Adam([([parameter], 0.1)])
    for gradient in (1e25, 1.0, 1.0):
        parameter.grad = torch.full((2,), gradient)
        adam.step()
    assert torch.isfinite(parameter).all()
    assert not parameter.detach().any(), "this is why it is refused"
    require_steppable("x", torch.full((3,), 9e17), 4)
    with pytest.raises(FloatingPointError, match=r"gradient of x reaches 1\.0e\+25 at step 4"):
        require_steppable("x", torch.tensor([0.0, -1e25]), 4)
    with pytest.raises(FloatingPointError, match=r"gradient of x holds 1 NaN .* at step 4"):
        require_steppable("x", torch.tensor([0.0, torch.nan, 1e25]), 4)
    require_steppable("x", torch.zeros(0, 4), 4)

    options = TrainNerf(steps=20, updates_per_call=1, **QUIET, **SMALL)
    state = initial_state(options, BACKGROUNDS, 0)
    before = copy.deepcopy(parameters(state))
    with pytest.raises(FloatingPointError, match=r"gradient of field\.\w+ .* at step 0"):
        training_step(state, options, 4, lambda latents, batch: np.full_like(latents, 1e30))
    for name, value in parameters(state).items():
        assert torch.equal(value, before[name]), name


@pytest.mark.parametrize(("bias", "occupied"), [(-15.0, True), (-15.0, False), (15.0, True), (15.0, False)])
def test_training_starts_from_an_empty_scene_and_from_a_full_one(bias: float, occupied: bool) -> None:
    """Also from a grid that lets no ray see anything: the next refresh mends it."""
    options = TrainNerf(steps=40, **{**SMALL, "density_bias": bias, "blob_density": 0.0})
    state = initial_state(options, BACKGROUNDS, 0)
    state.step = 0 if occupied else 1  # 0 refreshes the grid first
    if not occupied:
        grid = state.scene.occupancy
        state.scene.occupancy = grid._replace(occupied=np.zeros_like(grid.occupied))
    rng = np.random.default_rng(0)

    def pull(latents: np.ndarray, batch: Batch) -> np.ndarray:
        return rng.standard_normal(latents.shape).astype(np.float32)

    rows = [training_step(state, options, 4, pull) for _ in range(20)]
    assert all(np.isfinite(value) for row in rows for value in row[:5])
    if not occupied:
        assert rows[0].opacity == 0
        assert rows[0].samples == 0
    assert rows[-1].samples > 0
    assert rows[-1].opacity > 0.9 if bias > 0 else rows[-1].opacity < 0.1
