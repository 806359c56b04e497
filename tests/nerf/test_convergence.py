"""Whether training notices that a scene has converged, and not before."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from pipeline.nerf.checkpoint import decode_state, encode_state
from pipeline.nerf.convergence import (
    CALM,
    COOLING,
    SNAPSHOT_EVERY,
    SNAPSHOTS,
    WINDOW,
    converged,
    drift,
    first_decision,
    last_step,
    pace,
)
from pipeline.nerf.step import State, initial_state, training_step
from pipeline.nerf.train import train
from pipeline.options.nerf import TrainNerf
from pipeline.training.batch import Batch
from pipeline.training.checkpoints import read_newest, write
from tests.nerf.test_step import BACKGROUNDS, SMALL
from tests.oracle import TWO_BALLS, oracle_guidance

SHAPE = (2, 4, 16, 16)
BOUND = TrainNerf().convergence


def noisy(seed: int, count: int, step: float = 0.0) -> np.ndarray:
    """Snapshots of a scene with noise of 1 that moves by `step` from one to the next."""
    rng = np.random.default_rng(seed)
    way = rng.standard_normal(SHAPE)
    snapshots = [rng.standard_normal(SHAPE) + i * step * way for i in range(count)]
    return np.stack(snapshots).astype(np.float32)


@pytest.mark.parametrize("seed", range(5))
def test_a_scene_that_only_has_noise_drifts_by_one_standard_error(seed: int) -> None:
    assert drift(noisy(seed, 2 * WINDOW)) == pytest.approx(1, abs=0.1)


def test_drift_grows_as_the_scene_moves_and_does_not_depend_on_units() -> None:
    drifts = [drift(noisy(0, 2 * WINDOW, step)) for step in (0, 0.3, 1, 3)]
    assert drifts == sorted(drifts)
    # Means `WINDOW` snapshots apart; the motion within a window adds to its noise.
    within = np.arange(WINDOW).var(ddof=1)
    moving = np.sqrt(2 / WINDOW + WINDOW**2) / np.sqrt(2 * (1 + within) / WINDOW)
    assert drifts[2] == pytest.approx(moving, rel=0.1)
    assert drift(1000 * noisy(0, 2 * WINDOW, 0.3)) == pytest.approx(drifts[1], rel=1e-5)


def test_scenes_without_noise() -> None:
    still = np.ones((2 * WINDOW, *SHAPE), np.float32)
    assert drift(still) == 0
    jump = np.concatenate([still[:WINDOW], 2 * still[WINDOW:]])
    assert drift(jump) == np.inf


def test_it_takes_calm_in_a_row() -> None:
    calm = list(noisy(1, SNAPSHOTS))
    assert SNAPSHOTS == 2 * WINDOW + CALM - 1
    assert not converged(calm[1:], BOUND)
    assert converged(calm, BOUND)
    assert not converged([*calm[:-WINDOW], *(late + 3 for late in calm[-WINDOW:])], BOUND)
    assert not converged(list(noisy(1, SNAPSHOTS, 1.0)), BOUND)


def test_every_one_of_the_last_drifts_counts() -> None:
    """A jump between two windows is an endless drift; one snapshot off it is one of `WINDOW` - 1."""

    def jumping(at: int) -> list[np.ndarray]:
        return list(np.repeat([np.zeros(SHAPE), np.ones(SHAPE)], [at, SNAPSHOTS - at], 0).astype(np.float32))

    calm = [at for at in range(WINDOW - 1, WINDOW + CALM + 1) if converged(jumping(at), WINDOW - 0.5)]
    assert calm == [WINDOW - 1, WINDOW + CALM]


QUICK: dict[str, Any] = {**SMALL, "cameras_per_step": 1}


def finish(
    state: State,
    history: list[dict[str, Any]],
    options: TrainNerf,
    keep: Callable[[State, list[dict[str, Any]]], None] = lambda state, history: None,
) -> State:
    train(state, history, options, 8, oracle_guidance(TWO_BALLS), keep=keep)
    return state


@pytest.mark.thorough
def test_training_ends_early_and_a_resumed_one_just_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Resumed from before the scene was found converged, and from while it was cooled."""
    options = TrainNerf(steps=300, checkpoint_every=5, convergence=8.0, **QUICK)
    history: list[dict[str, Any]] = []

    def keep(state: State, history: list[dict[str, Any]]) -> None:
        if state.step == 145:
            write(tmp_path / "before", state.step, encode_state(state, history))
        if state.converged_at is not None and state.step == state.converged_at + COOLING // 2:
            write(tmp_path / "cooling", state.step, encode_state(state, history))

    whole = finish(initial_state(options, BACKGROUNDS, 7), history, options, keep)
    assert whole.converged_at is not None
    assert first_decision(options.steps) == 150 <= whole.converged_at
    assert whole.converged_at % SNAPSHOT_EVERY == 0
    assert whole.step == whole.converged_at + COOLING < options.steps
    assert len(history) == whole.step
    assert whole.snapshots == [], "nothing needs them any more"
    told = f"the scene had converged at step {whole.converged_at} of 300: {COOLING} steps at falling rates"
    assert f"{told} have ended it, {300 - whole.step} were skipped" in capsys.readouterr().err

    for name, converged_at in (("before", None), ("cooling", whole.converged_at)):
        found, _ = read_newest(tmp_path / name, lambda values: decode_state(values, options))
        assert found is not None
        state, before = found
        assert state.converged_at == converged_at
        assert len(state.snapshots) == (SNAPSHOTS - 1 if name == "before" else 0)
        assert finish(state, before, options).step == whole.step
        assert state.converged_at == whole.converged_at
        for ours, theirs in zip(state.optimizer.parameters, whole.optimizer.parameters, strict=True):
            assert torch.equal(ours, theirs)


@pytest.mark.parametrize(
    ("steps", "changed", "taken"),
    [
        (250, {"convergence": 10.0}, True),
        (250, {"convergence": 0.0}, False),
        (240, {"convergence": 10.0}, False),  # cooled from step 140 on it would take as many
    ],
)
def test_no_snapshot_is_taken_where_no_step_can_be_saved(
    steps: int, changed: dict[str, Any], taken: bool
) -> None:
    options = TrainNerf(steps=steps, **{**QUICK, **changed})
    state = initial_state(options, BACKGROUNDS, 7)
    state.step = 120

    class Enough(Exception):
        pass

    def stop(state: State, history: list[dict[str, Any]]) -> None:
        if state.step == 135:
            raise Enough

    with pytest.raises(Enough):
        finish(state, [], dataclasses.replace(options, checkpoint_every=5), stop)
    assert bool(state.snapshots) == taken


def test_cooled_steps_are_taken_at_their_pace() -> None:
    """Noise, guidance and rates of steps before and after the scene is found converged."""
    options = TrainNerf(
        steps=400, cameras_per_step=2, timestep_max=0.9, timestep_max_end=0.3, guidance_scale=100.0,
        guidance_scale_end=10.0, sparsity_weight=0.0, emptiness_weight=0.0, updates_per_call=1, **SMALL,
    )  # fmt: skip
    asked: list[Batch] = []

    def guidance(latents: np.ndarray, batch: Batch) -> np.ndarray:
        asked.append(batch)
        return np.ones_like(latents)

    moved = []
    for step, converged_at in ((200, None), (200, 200), (299, 200)):
        state = initial_state(options, BACKGROUNDS, 0)
        state.step, state.converged_at = step, converged_at
        bias = state.scene.field.bias3.detach().clone()
        training_step(state, options, 12, guidance)
        moved.append((state.scene.field.bias3.detach() - bias)[1:].numpy())
    # All latents are to fall: Adam's first step moves their biases by the rate.
    rates = np.array([1.0, 1 - 0.9 / COOLING, 0.1])
    np.testing.assert_allclose(moved, -options.learning_rate * np.repeat(rates[:, None], 4, 1), rtol=2e-3)
    assert [batch.guidance_scale for batch in asked] == pytest.approx(
        [100 - 90 * progress for progress in (200 / 399, (200 + 199 / COOLING) / 399, 1)]
    )
    assert max(asked[-1].noise_levels) < 0.3 < max(asked[0].noise_levels) < 0.6


@pytest.mark.parametrize(
    ("steps", "first"), [(1, None), (240, None), (241, 140), (280, 140), (281, 141), (500, 250), (1001, 501)]
)
def test_the_first_decision_comes_at_half_where_that_saves_a_step(steps: int, first: int | None) -> None:
    assert first_decision(steps) == first


def test_a_converged_scene_goes_through_the_rest_of_its_schedule_at_falling_rates() -> None:
    before = [pace(step, 500, None) for step in range(500)]
    assert [one.progress for one in before] == pytest.approx(np.linspace(0, 1, 500))
    assert {one.rate for one in before} == {1.0}
    after = [pace(step, 500, 300) for step in range(300, last_step(500, 300))]
    assert len(after) == COOLING
    progress, rates = np.transpose(after)
    assert before[299].progress < progress[0] < before[304].progress
    assert progress[-1] == pytest.approx(1)
    assert rates[-1] == pytest.approx(0.1)
    np.testing.assert_allclose(np.diff(progress), (1 - 300 / 499) / COOLING)
    np.testing.assert_allclose(np.diff(rates), -0.9 / COOLING)
    assert pace(0, 1, None) == (0, 1)
    assert last_step(500, None) == 500
