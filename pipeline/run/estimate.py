"""What a stage will cost on this machine, before it runs: seconds and peak memory.

The constants are of one machine (see `costs`). Others: their pace tells.
"""

import contextlib
import resource
import time
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from pipeline.diffusion.bundle import OPTIONAL_GRAPHS, REQUIRED_GRAPHS, Bundle
from pipeline.options.job import Job
from pipeline.run import costs
from pipeline.run.chain import STAGES
from pipeline.run.costs import Cost, Work

START = 1.0
"""Python, its libraries and, at first, compiled kernels [seconds a stage]."""
BASE_MB = 450.0
"""Python with torch [MiB]."""
PRODUCT_SIDE = 512
"""Side of the matrices whose product tells a machine's pace."""
REFERENCE_GFLOPS = 300.0
"""What the constants are of: chosen so that the denoiser's time is right on two threads of a Zen 3 core."""


def machine_pace() -> float:
    """Return how fast this machine multiplies matrices, relative to the one that the constants are of: the
    best of some products, in hundredths of a second."""
    matrix = np.ones((PRODUCT_SIDE, PRODUCT_SIDE), np.float32)
    best = np.inf
    for _ in range(6):
        began = time.perf_counter()
        matrix @ matrix
        best = min(best, time.perf_counter() - began)
    return 2 * PRODUCT_SIDE**3 / best / 1e9 / REFERENCE_GFLOPS


def estimate(name: str, job: Job, latent_size: int, weights: Mapping[str, float], pace: float = 1.0) -> Cost:
    """Return what a stage costs; `weights`: megabytes of each graph's files: memory, and the UNet's work.

    The denoiser is matrix products and takes 1 / `pace` of the constants' time; the rest, which waits for
    memory and for one thread, its square root (twice the time where products take 3.6 times).
    """
    stage = STAGES[name]
    # Everything is divided by the root below.
    cost = getattr(costs, name)(Work(job, latent_size, weights.get("unet", 0.0) / pace**0.5))
    # A network is in memory twice: the file, and what onnxruntime makes of it (of weights stored as fp16,
    # their fp32 values: twice the file without it).
    held = max((weights.get(graph, 0.0) for graph in stage.networks), default=0.0)
    held += sum(weights.get(graph, 0.0) for graph in stage.together)
    return Cost((START + cost.seconds) / pace**0.5, BASE_MB + cost.memory_mb + 2 * held)


def price(job: Job, bundle: Bundle, stages: Iterable[str], pace: float) -> dict[str, Cost]:
    """Return what each of a job's stages costs with a model on this machine."""
    graphs = [*REQUIRED_GRAPHS, *OPTIONAL_GRAPHS]
    weights = {
        name: sum(file.stat().st_size for file in (bundle.path / name).rglob("*")) / 2**20 for name in graphs
    }
    return {stage: estimate(stage, job, bundle.latent_size, weights, pace) for stage in stages}


def available_memory_mb() -> float | None:
    """Return the memory that a stage can take [MiB]: what is free, and what a limit of this process (ulimit
    -v) or of its container leaves; None where the system says nothing."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    found = [limit / 2**20] if limit != resource.RLIM_INFINITY else []
    with contextlib.suppress(OSError, KeyError, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        entries = dict(line.split(":", 1) for line in lines)
        found.append(int(entries["MemAvailable"].split()[0]) / 1024)
    with contextlib.suppress(OSError, ValueError):  # "max" is no limit
        group = Path("/sys/fs/cgroup")
        most, now = (int((group / f"memory.{name}").read_text()) for name in ("max", "current"))
        found.append((most - now) / 2**20)
    return min(found, default=None)
