"""Progress speaks rarely, truly, and not at all about short work."""

import io
import time

import pytest

from pipeline import progress
from pipeline.progress import Progress, duration


class Clock:
    """Time that moves when told to."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr(time, "monotonic", lambda: self.now)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def stream(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    stream = io.StringIO()
    monkeypatch.setattr(progress, "channel", stream)
    return stream


def work(clock: Clock, total: int, seconds: float, first: int = 0, warm_up: float = 0.0) -> None:
    with Progress("train", total, "steps") as bar:
        clock.now += warm_up
        for step in range(first, total):
            clock.now += seconds
            bar.update(step + 1, note="gradient 0.5")


def test_short_work_is_silent(stream: io.StringIO, monkeypatch: pytest.MonkeyPatch) -> None:
    work(Clock(monkeypatch), 19, 0.1)
    assert stream.getvalue() == ""


def test_lines_come_every_five_seconds_and_know_the_time_left(
    stream: io.StringIO, monkeypatch: pytest.MonkeyPatch
) -> None:
    work(Clock(monkeypatch), 100, 1.0)
    lines = stream.getvalue().splitlines()
    assert len(lines) == 20
    assert lines[0] == "train: 5/100 steps, 95 s left, gradient 0.5"
    assert lines[-1] == "train: 100/100 steps, 0 s left, gradient 0.5"


def test_a_resumed_run_and_a_slow_first_unit_do_not_spoil_the_pace(
    stream: io.StringIO, monkeypatch: pytest.MonkeyPatch
) -> None:
    work(Clock(monkeypatch), 1000, 1.0, first=900, warm_up=60.0)
    assert stream.getvalue().splitlines()[1] == "train: 906/1000 steps, 94 s left, gradient 0.5"


def test_slow_steps_tell_the_time_left_from_the_second_on(
    stream: io.StringIO, monkeypatch: pytest.MonkeyPatch
) -> None:
    work(Clock(monkeypatch), 10, 12.0)
    assert stream.getvalue().splitlines()[1] == "train: 2/10 steps, 96 s left, gradient 0.5"


def test_a_terminal_gets_one_line_that_is_wiped(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Terminal()
    monkeypatch.setattr(progress, "channel", stream)
    work(Clock(monkeypatch), 100, 1.0)
    assert "\n" not in stream.getvalue()
    assert stream.getvalue().endswith(" \r")


def test_durations() -> None:
    assert [duration(s) for s in (0.4, 99.4, 125, 3600)] == ["0 s", "99 s", "2 min 05 s", "60 min 00 s"]
