"""Many small trainings: two of one thread take less time than one after the other of two threads."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any

from pipeline.progress import Progress


def at_once(function: Callable[..., Any], calls: Sequence[tuple[Any, ...]], label: str) -> list[Any]:
    """Return what `function` returns for the arguments of each call, in order.

    As many run at once as there are processors, each in a process of its own that uses one thread.
    """
    if not calls:
        return []
    workers = min(len(os.sched_getaffinity(0)), len(calls))
    with (
        _one_thread_each(),
        ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool,
        Progress(label, len(calls)) as progress,
    ):
        running = [pool.submit(function, *call) for call in calls]
        for done, one in enumerate(as_completed(running), 1):
            one.result()  # a failure ends the benchmark now
            progress.update(done)
        return [one.result() for one in running]


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Have processes that start meanwhile use one thread: libraries read these variables once."""
    before = dict(os.environ)
    os.environ.update({f"{library}_NUM_THREADS": "1" for library in ("NUMBA", "OMP", "MKL", "OPENBLAS")})
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
