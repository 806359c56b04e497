"""Ratios of running times on a machine that also does other things: in turn, and medians."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numba
import numpy as np
import torch


class Pace(NamedTuple):
    """What a piece of work takes."""

    seconds: float
    """On the clock, median."""
    processor_seconds: float
    """Of all threads, median."""


def in_turn(works: dict[str, Callable[[], Any]], rounds: int) -> dict[str, Pace]:
    """Time each piece of work `rounds` times, one after the other in every round, after one unmeasured."""
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in works}
    for work in works.values():
        work()
    for _ in range(rounds):
        for name, work in works.items():
            began = time.perf_counter(), time.process_time()
            work()
            taken[name].append((time.perf_counter() - began[0], time.process_time() - began[1]))
    return {name: Pace(*(round(float(v), 6) for v in np.median(t, axis=0))) for name, t in taken.items()}


def compared(plain: Pace, ours: Pace) -> dict[str, Any]:
    """Return both paces and how many times faster ours is, on the clock and in processor time."""
    return {
        "plain": plain._asdict(),
        "ours": ours._asdict(),
        "speedup": round(plain.seconds / ours.seconds, 2),
        "processor_speedup": round(plain.processor_seconds / max(ours.processor_seconds, 1e-9), 2),
    }


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Give torch's own operations so many threads, as a program without our kernels would."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def kernel_threads(count: int) -> Iterator[None]:
    """Give our kernels so many threads."""
    before = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    numba.config.NUMBA_NUM_THREADS = count  # type: ignore[attr-defined]
    try:
        yield
    finally:
        numba.config.NUMBA_NUM_THREADS = before  # type: ignore[attr-defined]
