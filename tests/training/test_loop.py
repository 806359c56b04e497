"""The loop of every training: what it records, keeps and shows, and how it ends when it is told to."""

import os
import signal
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from pipeline.training import checkpoints, loop
from pipeline.training.loop import History, resume, seconds_of, take_steps


@dataclass
class Counter:
    step: int = 0


class Metrics(NamedTuple):
    gradient_norm: float
    seconds: dict[str, float]


@dataclass(frozen=True)
class Pace:
    steps: int = 10
    checkpoint_every: int = 4
    preview_every: int = 3


def count(state: Counter) -> Metrics:
    state.step += 1
    return Metrics(float(state.step), {"render": 0.25, "denoiser": 1.0})


class Heard:
    """What the loop keeps and shows."""

    def __init__(self) -> None:
        self.kept: list[int] = []
        self.shown: list[int] = []

    def keep(self, state: Counter, history: History) -> None:
        assert [row["step"] for row in history] == list(range(1, state.step + 1))
        self.kept.append(state.step)

    def show(self, state: Counter) -> None:
        self.shown.append(state.step)


def test_steps_are_recorded_kept_and_shown() -> None:
    heard, state, history = Heard(), Counter(), list[dict]()
    take_steps("test", state, history, Pace(), count, keep=heard.keep, show=heard.show)
    assert state.step == 10
    assert history[2] == {"step": 3, "gradient_norm": 3.0, "seconds": {"render": 0.25, "denoiser": 1.0}}
    assert seconds_of(history) == {"render": 2.5, "denoiser": 10.0}
    assert (heard.kept, heard.shown) == ([4, 8], [3, 6, 9])


def test_what_a_training_starts_from_is_shown_before_its_first_step(tmp_path: Path) -> None:
    shown: list[int] = []

    def decode(values) -> tuple[Counter, History]:
        return Counter(int(values["step"])), []

    resume("test", tmp_path, decode, Counter, lambda state: shown.append(state.step))
    checkpoints.write(tmp_path, 4, {"step": np.array(4)})
    resume("test", tmp_path, decode, Counter, lambda state: shown.append(state.step))
    assert shown == [0, 4]


@pytest.mark.parametrize(("seconds", "shown"), [(-1.0, [*range(1, 11)]), (1e9, [])])
def test_previews_come_by_time_where_no_steps_are_asked_for(
    seconds: float, shown: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Steps that are slower than the time between previews are shown each."""
    monkeypatch.setattr(loop, "SHOW_SECONDS", seconds)
    heard = Heard()
    take_steps("test", Counter(), [], Pace(preview_every=0), count, show=heard.show)
    assert heard.shown == shown


def test_only_steps_that_are_left_are_taken_and_none_of_a_finished_run() -> None:
    state, history = Counter(7), [{"step": i + 1} for i in range(7)]
    take_steps("test", state, history, Pace(), count)
    assert [row["step"] for row in history] == list(range(1, 11))
    take_steps("test", state, history, Pace(), count)
    assert len(history) == 10


def test_a_run_may_find_its_last_step_on_the_way() -> None:
    state = Counter()
    take_steps("test", state, [], Pace(), count, last=lambda: 6 if state.step >= 5 else 10)
    assert state.step == 6


def test_a_checkpoint_is_also_due_by_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "KEEP_SECONDS", -1.0)
    heard = Heard()
    take_steps("test", Counter(), [], Pace(checkpoint_every=1000), count, keep=heard.keep)
    assert heard.kept == list(range(1, 10)), "not after the last step: the stage ends then"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("at", [6, 10])
def test_a_signal_ends_the_step_and_keeps_it(number: signal.Signals, at: int) -> None:
    def step(state: Counter) -> Metrics:
        metrics = count(state)
        if state.step == at:
            os.kill(os.getpid(), number)
            os.kill(os.getpid(), number)  # a second one does not tear the checkpoint
        return metrics

    heard, state = Heard(), Counter()
    outer = signal.signal(number, signal.default_int_handler)  # tests in the background ignore SIGINT
    try:
        with pytest.raises(KeyboardInterrupt):
            take_steps("test", state, [], Pace(checkpoint_every=1000), step, keep=heard.keep)
        assert (state.step, heard.kept) == (at, [at])
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, outer)


def test_ignored_signals_stay_ignored_and_threads_hear_none() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with loop.stop_signals() as stopped:
            os.kill(os.getpid(), signal.SIGTERM)
            assert not stopped()
    finally:
        signal.signal(signal.SIGTERM, before)
    done = Counter()
    thread = threading.Thread(target=take_steps, args=("test", done, [], Pace(), count))
    thread.start()
    thread.join()
    assert done.step == 10


def test_resuming_takes_the_newest_checkpoint_and_names_damaged_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def decode(values) -> tuple[Counter, History]:
        return Counter(int(values["step"])), [{"step": i + 1} for i in range(int(values["step"]))]

    assert resume("test", tmp_path, decode, Counter) == (Counter(), [], 0, [])
    assert f"test: watch it grow in {tmp_path / loop.PREVIEW}" in capsys.readouterr().err
    for step in (4, 8):
        checkpoints.write(tmp_path, step, {"step": np.array(step)})
    start = resume("test", tmp_path, decode, Counter)
    assert (start.state, start.resumed_at, start.warnings) == (Counter(8), 8, [])
    (tmp_path / "00000008.checkpoint").write_bytes(b"0\nrubbish")
    start = resume("test", tmp_path, decode, Counter)
    assert (start.resumed_at, len(start.history)) == (4, 4)
    assert start.warnings == ["00000008.checkpoint was damaged: trained again from step 4"]
    assert "test: continues after step 4" in capsys.readouterr().err
