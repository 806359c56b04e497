"""Whether training notices that a scene is at rest, and not before."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from pipeline.nerf_options import TrainNerf
from pipeline.scene import checkpoint
from pipeline.scene.convergence import (
    CALM,
    COOLING,
    KEPT,
    LOOK_EVERY,
    WINDOW,
    converged,
    drift,
    first_decision,
    last_step,
    pace,
)
from pipeline.scene.training import State, initial_state
from pipeline.stages.train_nerf import train
from tests.oracle import TWO_BALLS, oracle_guidance
from tests.scene.test_training import BACKGROUNDS, SMALL

SHAPE = (2, 4, 16, 16)


def trembling(seed: int, count: int, step: float = 0.0) -> np.ndarray:
    """Looks at a scene that trembles by 1 and moves by `step` from look to look."""
    rng = np.random.default_rng(seed)
    way = rng.standard_normal(SHAPE)
    looks = [rng.standard_normal(SHAPE) + i * step * way for i in range(count)]
    return np.stack(looks).astype(np.float32)


@pytest.mark.parametrize("seed", range(5))
def test_a_scene_that_trembles_in_place_drifts_by_one_standard_error(seed: int) -> None:
    assert drift(trembling(seed, 2 * WINDOW)) == pytest.approx(1, abs=0.1)


def test_drift_grows_as_the_scene_moves_and_does_not_depend_on_units() -> None:
    drifts = [drift(trembling(0, 2 * WINDOW, step)) for step in (0, 0.3, 1, 3)]
    assert drifts == sorted(drifts)
    # Means `WINDOW` looks apart; the motion within a stretch makes it tremble more.
    within = np.arange(WINDOW).var(ddof=1)
    moving = np.sqrt(2 / WINDOW + WINDOW**2) / np.sqrt(2 * (1 + within) / WINDOW)
    assert drifts[2] == pytest.approx(moving, rel=0.1)
    assert drift(1000 * trembling(0, 2 * WINDOW, 0.3)) == pytest.approx(drifts[1], rel=1e-5)


def test_scenes_without_trembling() -> None:
    still = np.ones((2 * WINDOW, *SHAPE), np.float32)
    assert drift(still) == 0
    jump = np.concatenate([still[:WINDOW], 2 * still[WINDOW:]])
    assert drift(jump) == np.inf


def test_it_takes_calm_in_a_row() -> None:
    calm = list(trembling(1, KEPT))
    assert KEPT == 2 * WINDOW + CALM - 1
    assert not converged(calm[1:], 1.35)
    assert converged(calm, 1.35)
    assert not converged([*calm[:-WINDOW], *(late + 3 for late in calm[-WINDOW:])], 1.35)
    assert not converged(list(trembling(1, KEPT, 1.0)), 1.35)


def test_every_one_of_the_last_drifts_counts() -> None:
    """A jump between two stretches is an endless drift; one look off it is one of `WINDOW` - 1."""

    def jumping(at: int) -> list[np.ndarray]:
        return list(np.repeat([np.zeros(SHAPE), np.ones(SHAPE)], [at, KEPT - at], 0).astype(np.float32))

    calm = [at for at in range(WINDOW - 1, WINDOW + CALM + 1) if converged(jumping(at), WINDOW - 0.5)]
    assert calm == [WINDOW - 1, WINDOW + CALM]


QUICK: dict[str, Any] = {**SMALL, "cameras_per_step": 1}


def finish(
    state: State,
    history: list[dict[str, Any]],
    options: TrainNerf,
    keep: Callable[[State, list[dict[str, Any]]], None] = lambda state, history: None,
) -> State:
    train(state, history, options, 8, oracle_guidance(TWO_BALLS), keep)
    return state


def test_training_ends_early_and_a_resumed_one_just_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Resumed from before the scene was found at rest, and from while it was cooled."""
    options = TrainNerf(steps=300, checkpoint_every=5, convergence=8.0, **QUICK)
    history: list[dict[str, Any]] = []

    def keep(state: State, history: list[dict[str, Any]]) -> None:
        cooling = state.rest_at is not None
        if state.step == 145 or (cooling and not (tmp_path / "cooling").exists()):
            checkpoint.save(tmp_path / ("cooling" if cooling else "before"), state, history)

    whole = finish(initial_state(options, BACKGROUNDS, 7), history, options, keep)
    assert whole.rest_at is not None
    assert first_decision(options.steps) == 150 <= whole.rest_at
    assert whole.rest_at % LOOK_EVERY == 0
    assert whole.step == whole.rest_at + COOLING < options.steps
    assert len(history) == whole.step
    assert len(whole.looks) == KEPT
    told = f"the scene had converged at step {whole.rest_at} of 300: {COOLING} steps at falling rates"
    assert f"{told} have ended it, {300 - whole.step} were skipped" in capsys.readouterr().err

    for name, rest_at in (("before", None), ("cooling", whole.rest_at)):
        state, before, _ = checkpoint.load(tmp_path / name, options)
        assert state is not None
        assert state.rest_at == rest_at
        assert finish(state, before, options).step == whole.step
        assert state.rest_at == whole.rest_at
        np.testing.assert_array_equal(state.looks, whole.looks)
        for ours, theirs in zip(state.optimizer.parameters, whole.optimizer.parameters, strict=True):
            assert torch.equal(ours, theirs)


@pytest.mark.parametrize(("steps", "convergence"), [(250, 0.0), (20, 10.0), (240, 10.0)])
def test_without_a_bound_or_a_step_to_save_all_steps_are_taken(steps: int, convergence: float) -> None:
    options = TrainNerf(steps=steps, convergence=convergence, **QUICK)
    state = initial_state(options, BACKGROUNDS, 7)
    state.step = max(steps - 25, 0)
    finish(state, [], options)
    assert state.step == steps
    assert state.rest_at is None
    assert state.looks == []


@pytest.mark.parametrize(
    ("steps", "first"), [(1, None), (240, None), (241, 140), (280, 140), (281, 141), (500, 250), (1001, 501)]
)
def test_the_first_decision_comes_at_half_where_that_saves_a_step(steps: int, first: int | None) -> None:
    assert first_decision(steps) == first


def test_a_scene_at_rest_goes_through_the_rest_of_its_schedule_at_falling_rates() -> None:
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
