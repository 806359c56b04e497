"""Checkpoints: a resumed run equals one never interrupted, and damage is survived."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.nerf.checkpoint import decode_state, encode_state
from pipeline.nerf.scene import to_arrays
from pipeline.nerf.step import State, initial_state
from pipeline.nerf.train import train
from pipeline.options.nerf import TrainNerf
from pipeline.training import checkpoints
from tests.nerf.test_step import BACKGROUNDS, SMALL
from tests.oracle import TWO_BALLS, oracle_guidance

OPTIONS = TrainNerf(steps=19, checkpoint_every=5, density_sharpening=3.0, **SMALL)
GUIDANCE = oracle_guidance(TWO_BALLS)


def finish(state: State, history: list[dict[str, Any]], folder: Path | None = None) -> dict[str, np.ndarray]:
    def keep(state: State, history: list[dict[str, Any]]) -> None:
        if folder is not None:
            checkpoints.write(folder, state.step, encode_state(state, history))

    train(state, history, OPTIONS, 12, GUIDANCE, keep=keep)
    return to_arrays(state.scene)


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, np.ndarray], list]:
    folder = tmp_path_factory.mktemp("checkpoints")
    history: list[dict[str, Any]] = []
    result = finish(initial_state(OPTIONS, BACKGROUNDS, 7), history, folder)
    return folder, result, history


def load(folder: Path) -> tuple[State | None, list[dict[str, Any]], list[str]]:
    found, damaged = checkpoints.read_newest(folder, lambda values: decode_state(values, OPTIONS))
    return *(found or (None, [])), damaged


def copy_of(folder: Path, target: Path) -> Path:
    target.mkdir()
    for path in folder.iterdir():
        (target / path.name).write_bytes(path.read_bytes())
    return target


def assert_same(left: dict[str, np.ndarray], right: dict[str, np.ndarray]) -> None:
    assert left.keys() == right.keys()
    for name, value in left.items():
        np.testing.assert_array_equal(value, right[name], err_msg=name)


def test_the_last_two_are_kept(uninterrupted) -> None:
    folder, _, _ = uninterrupted
    assert sorted(p.name for p in folder.iterdir()) == ["00000010.checkpoint", "00000015.checkpoint"]


def test_a_resumed_run_equals_one_never_interrupted(uninterrupted) -> None:
    folder, result, history = uninterrupted
    state, before, damaged = load(folder)
    assert state is not None
    assert state.step == 15
    assert not damaged
    assert_same(finish(state, before), result)
    for resumed, whole in zip(before, history, strict=True):
        assert {**resumed, "seconds": 0} == {**whole, "seconds": 0}


@pytest.mark.parametrize("damage", ["flipped", "truncated", "emptied"])
def test_damage_falls_back_to_the_older_one(uninterrupted, tmp_path: Path, damage: str) -> None:
    whole, result, _ = uninterrupted
    folder = copy_of(whole, tmp_path / "copy")
    newest = folder / "00000015.checkpoint"
    data = bytearray(newest.read_bytes())
    data[len(data) // 2] ^= 1
    newest.write_bytes({"flipped": bytes(data), "truncated": data[:-7], "emptied": b""}[damage])
    state, history, damaged = load(folder)
    assert damaged == [newest.name]
    assert state is not None
    assert state.step == 10
    assert_same(finish(state, history), result)


def test_without_a_whole_checkpoint_there_is_no_state(tmp_path: Path) -> None:
    assert load(tmp_path / "absent") == (None, [], [])
    (tmp_path / "00000001.checkpoint").write_bytes(b"0\nrubbish")
    assert load(tmp_path) == (None, [], ["00000001.checkpoint"])


def test_a_checkpoint_is_whole_or_absent(
    uninterrupted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fault before the rename leaves the older files alone, and no partial one behind."""
    whole, _, _ = uninterrupted
    folder = copy_of(whole, tmp_path / "copy")
    state, history, _ = load(folder)
    assert state is not None
    state = copy.copy(state)
    state.step = 16

    def full_disk(pairs: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pipeline.files.publish", full_disk)
    with pytest.raises(OSError, match="space"):
        checkpoints.write(folder, state.step, encode_state(state, history))
    assert sorted(p.name for p in folder.iterdir()) == ["00000010.checkpoint", "00000015.checkpoint"]
