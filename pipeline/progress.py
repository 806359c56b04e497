"""Progress of long work, for a person: a line that says how far, how long still, and how it goes."""

import os
import sys
import time
from types import TracebackType
from typing import Self, TextIO

PATIENCE = 2.0
"""Work shorter than this says nothing [seconds]."""
EVERY = "PIPELINE_PROGRESS_SECONDS"
"""Environment variable: time between lines that no terminal shows, for programs that read them [seconds]."""
INTERVAL = {True: 0.2, False: float(os.environ.get(EVERY) or 5.0)}
"""Time between lines on a terminal and elsewhere [seconds]."""

LABEL = "PIPELINE_LABEL"
"""Environment variable: what stands before every line, where several runs say theirs."""
TOLD = "PIPELINE_TOLD"
"""Environment variable: a file that lines are added to, where no one hears this process."""

channel: TextIO | None = None
"""Where progress goes; None: standard error. `pipeline.run.stage.execute` sets it."""


def say(text: str) -> None:
    """Print one line for the user at once."""
    print(f"{os.environ.get(LABEL, '')}{text}", file=channel or sys.stderr, flush=True)


class Progress:
    """Counts units of work::

    with Progress("train", total=600, unit="steps") as progress:
        for step in range(600):
            progress.update(step + 1, note="gradient 0.1")
    """

    def __init__(self, label: str, total: int, unit: str = "") -> None:
        self.label, self.total, self.unit = label, total, unit
        self.began = self.said = time.monotonic()
        self.first: tuple[int, float] | None = None
        """Units done at the first update, and when. What came before it, compilation too, tells no pace."""
        self.width = 0

    def __enter__(self) -> Self:
        return self

    def update(self, done: int, note: str = "") -> None:
        """Tell that `done` of `total` units are done; prints at most every few seconds."""
        now = time.monotonic()
        first, since = self.first = self.first or (done, now)
        stream = channel or sys.stderr
        terminal = stream.isatty()
        if now - self.began < PATIENCE or now - self.said < INTERVAL[terminal]:
            return
        self.said = now
        line = f"{os.environ.get(LABEL, '')}{self.label}: {done}/{self.total} {self.unit}".rstrip()
        if done > first:
            left = (now - since) / (done - first) * (self.total - done)
            line += f", {duration(left)} left"
        line += f", {note}" if note else ""
        if terminal:
            stream.write("\r" + line.ljust(self.width))
            self.width = len(line)
        else:
            stream.write(line + "\n")
        stream.flush()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.width:
            (channel or sys.stderr).write("\r" + " " * self.width + "\r")


def duration(seconds: float) -> str:
    """Return a length of time as a person says it, such as ``4 s`` or ``2 min 05 s``."""
    whole = round(seconds)
    return f"{whole} s" if whole < 100 else f"{whole // 60} min {whole % 60:02d} s"
