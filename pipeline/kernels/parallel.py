"""Runs kernels that release the GIL on several threads, with results that do not depend on their number.

A kernel is called as `kernel(start, stop, *arguments)` and must write only to what its own items own (the
rows of its points, the rays or the hash levels from `start` to `stop`): then any split gives the same bits.
Compared with numba's `parallel=True`, kernels compile several times faster and no second pool of spinning
threads competes with torch and onnxruntime.
"""

import functools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numba

_SHARES = 8
"""Blocks a thread, at least: at the end of a kernel a thread waits for half a block of another's."""


def threads() -> int:
    """Return the number of threads in use: NUMBA_NUM_THREADS, else the processors this process may use."""
    return int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]


@functools.cache
def _pool(workers: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(workers, thread_name_prefix="kernel")


def run(kernel: Callable[..., None], items: int, *arguments: Any, block: int = 1) -> None:
    """Call `kernel(start, stop, *arguments)` over `items` items, at least `block` of them a call.

    The calling thread works too. Blocks are handed out as threads become free, so uneven ones balance.
    """
    workers = min(threads(), -(-items // block))
    if workers <= 1:
        if items:
            kernel(0, items, *arguments)
        return
    size = max(block, -(-items // (_SHARES * workers)))
    starts = iter(range(0, items, size))

    def work() -> None:
        for start in starts:  # advancing a range iterator is atomic under the GIL
            kernel(start, min(start + size, items), *arguments)

    others = [_pool(workers - 1).submit(work) for _ in range(workers - 1)]
    work()
    for other in others:
        other.result()
