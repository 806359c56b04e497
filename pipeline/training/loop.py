"""The loop of every training: it goes on from a checkpoint, records its steps, and keeps and shows its state.

A training that is told to stop (SIGINT, SIGTERM) ends the step that it is in and leaves a checkpoint of it.
"""

import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from pipeline.progress import Progress, say
from pipeline.training import checkpoints

KEEP_SECONDS = 10.0
"""Time between checkpoints, where steps are slow or few [seconds]."""
SHOW_SECONDS = 5.0
"""Time between previews, unless they are asked for by steps; slower steps are shown each [seconds]."""
PREVIEW = "preview_training.png"
"""The file beside the checkpoints that shows how training goes."""

History = list[dict[str, Any]]
"""One row a step: its number, its metrics, and `seconds` by part."""


class Trained(Protocol):
    """The state of a training, whatever it trains."""

    step: int
    """Steps done."""


class StepMetrics(Protocol):
    """What a step tells of itself: a NamedTuple with these and more."""

    @property
    def gradient_norm(self) -> float:
        """See the metrics of a step."""

    @property
    def seconds(self) -> dict[str, float]:
        """By part of the step."""

    def _asdict(self) -> dict[str, Any]: ...


class Schedule(Protocol):
    """How many steps, and how often they are kept and shown: a section of options."""

    @property
    def steps(self) -> int:
        """Of the run in all."""

    @property
    def checkpoint_every(self) -> int:
        """Steps."""

    @property
    def preview_every(self) -> int:
        """Steps; 0: by time."""


S = TypeVar("S", bound=Trained)
Decode = Callable[[Mapping[str, np.ndarray]], tuple[S, History]]
"""Arrays of a checkpoint -> a state and its history; raises ValueError for those of another training."""


class Start(NamedTuple, Generic[S]):
    """Where a training begins or goes on."""

    state: S
    history: History
    resumed_at: int
    """Steps that were done already."""
    warnings: list[str]
    """About checkpoints that were damaged."""


def resume(
    stage: str,
    folder: Path,
    decode: Decode[S],
    initial: Callable[[], S],
    show: Callable[[S], None] = lambda state: None,
) -> Start[S]:
    """Return the newest whole checkpoint of `folder`, or the `initial` state, say which, and show it: the
    networks, which may take long to open, are not needed for that."""
    found, damaged = checkpoints.read_newest(folder, decode)
    state, history = found or (initial(), [])
    show(state)
    if found:
        say(f"{stage}: continues after step {state.step}")
    say(f"{stage}: watch it grow in {folder / PREVIEW}")
    warnings = [f"{name} was damaged: trained again from step {state.step}" for name in damaged]
    return Start(state, history, state.step, warnings)


def take_steps(
    stage: str,
    state: S,
    history: History,
    schedule: Schedule,
    step: Callable[[S], StepMetrics],
    *,
    keep: Callable[[S, History], None] = lambda state, history: None,
    show: Callable[[S], None] = lambda state: None,
    note: Callable[[Any], str] = lambda metrics: f"gradient {metrics.gradient_norm:.2f}",
    last: Callable[[], int] | None = None,
) -> None:
    """Take the steps that `state` has not done yet, in place; record each in `history`.

    Args:
        keep: called every `checkpoint_every` steps, every KEEP_SECONDS, and when the training is stopped.
        show: called every `preview_every` steps, or (0) after a step once SHOW_SECONDS have passed. It must
            leave the state, its random numbers too, as it was: when it is called depends on the clock.
        note: what the progress line says of a step.
        last: the steps of the run in all, as known after each; None: those of `schedule`.

    Raises:
        KeyboardInterrupt: a signal asked for the end; the state is kept.
        FloatingPointError: a NaN or an infinity, named by tensor and step.
    """
    total = last or (lambda: schedule.steps)
    with Progress(stage, total(), "steps") as progress, stop_signals() as stopped:
        kept_at = shown_at = time.monotonic()
        while state.step < total():
            metrics = step(state)
            history.append(_row(state.step, metrics))
            progress.total = total()
            progress.update(state.step, note(metrics))
            due = state.step % schedule.checkpoint_every == 0 or time.monotonic() - kept_at > KEEP_SECONDS
            if stopped() or (due and state.step < total()):
                keep(state, history)
                kept_at = time.monotonic()
            if stopped():
                raise KeyboardInterrupt
            by_time = time.monotonic() - shown_at > SHOW_SECONDS
            if state.step % schedule.preview_every == 0 if schedule.preview_every else by_time:
                show(state)
                shown_at = time.monotonic()


@contextmanager
def stop_signals() -> Iterator[Callable[[], bool]]:
    """Give a function that says whether SIGINT or SIGTERM has come: they do not end anything meanwhile.

    Signals that are ignored stay so; outside the main thread, which alone can hear them, none ever comes.
    """
    came: list[int] = []

    def hear(number: int, frame: FrameType | None) -> None:
        came.append(number)

    former: dict[signal.Signals, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(number) is not signal.SIG_IGN:
                former[number] = signal.signal(number, hear)
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


def seconds_of(history: History) -> dict[str, float]:
    """Return the seconds of all steps by part."""
    return {part: round(sum(row["seconds"][part] for row in history), 3) for part in history[0]["seconds"]}


def _row(step: int, metrics: StepMetrics) -> dict[str, Any]:
    seconds = {part: round(value, 5) for part, value in metrics.seconds.items()}
    return {"step": step, **metrics._asdict(), "seconds": seconds}
