"""Whether training notices that a scene is at rest, and not before."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.nerf_options import TrainNerf
from pipeline.scene import checkpoint
from pipeline.scene.convergence import CALM, KEPT, LOOK_EVERY, WINDOW, converged, drift
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


def finish(state: State, history: list[dict[str, Any]], options: TrainNerf, folder: Path) -> State:
    def keep(state: State, history: list[dict[str, Any]]) -> None:
        checkpoint.save(folder, state, history)

    train(state, history, options, 12, oracle_guidance(TWO_BALLS), keep)
    return state


def test_training_ends_early_and_a_resumed_one_at_the_same_step(tmp_path: Path) -> None:
    options = TrainNerf(steps=200, checkpoint_every=90, convergence=5.0, **SMALL)
    history: list[dict[str, Any]] = []
    whole = finish(initial_state(options, BACKGROUNDS, 7), history, options, tmp_path)
    assert options.steps // 2 <= whole.step < options.steps
    assert whole.step % LOOK_EVERY == 0
    assert len(history) == whole.step
    assert len(whole.looks) == KEPT

    state, before, _ = checkpoint.load(tmp_path, options)
    assert state is not None
    assert state.step == 90
    assert finish(state, before, options, tmp_path).step == whole.step
    np.testing.assert_array_equal(state.looks, whole.looks)


@pytest.mark.parametrize("convergence", [0.0, 10.0])
def test_without_a_bound_or_time_for_a_decision_all_steps_are_taken(
    tmp_path: Path, convergence: float
) -> None:
    options = TrainNerf(steps=20, convergence=convergence, **SMALL)
    state = finish(initial_state(options, BACKGROUNDS, 7), [], options, tmp_path)
    assert state.step == 20
    assert state.looks == []
