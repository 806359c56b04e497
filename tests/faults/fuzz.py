"""``make fuzz [MINUTES=10] [SEED=0]``: damaged files of every format that is read, until the time is over.

Every case is a fork of one process that has imported everything: a mutated file is read within limits of time
and memory. It passes if it is read, or refused by an InputError of one line. What fails is kept under
`build/fuzz/`, with how it ended. A case is made of the seed and its number alone:
``python -m tests.faults.fuzz --seed 0 --case 1234`` makes it again, in this process.
"""

import argparse
import contextlib
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.errors import InputError
from pipeline.files import refusal
from pipeline.progress import duration
from tests.faults.mutate import mutate
from tests.faults.targets import Target, targets

SECONDS, WAIT, BYTES = 30, 60, 2 << 30
"""Limits of a case: of processor time, of the clock, and of memory beyond what was imported."""
KEPT = Path("build/fuzz")
READ, REFUSED, FAILED = 0, 10, 11


class Ended(NamedTuple):
    """How a case went."""

    target: str
    status: str
    """"read", "refused", or what went wrong."""
    seconds: float
    memory_mb: float


def make_case(known: Mapping[str, Target], seed: int, case: int) -> tuple[str, bytes]:
    """Return the name of a case's target and the bytes of its file."""
    rng = np.random.default_rng([seed, case])
    name = list(known)[case % len(known)]
    seeds = known[name].seeds
    other = known[list(known)[rng.integers(len(known))]].seeds[0]
    return name, mutate(seeds[rng.integers(len(seeds))], other, rng)


def read_case(target: Target, data: bytes, folder: Path) -> int:
    """Read a case's file in this process; return READ, REFUSED or, with a traceback, FAILED."""
    path = folder / target.file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return attempt(lambda: target.read(path))


def attempt(read: Callable[[], object]) -> int:
    """Return how reading ended in this process: READ, REFUSED or, with a traceback, FAILED."""
    try:
        read()
    except InputError as error:
        sys.stderr.write(f"InputError: {error}\n")
        return FAILED if "\n" in str(error) or not str(error).strip() else REFUSED
    except OSError as error:  # as the front door says it: a name too long, say
        traceback.print_exc()
        return FAILED if refusal(error) is None else REFUSED
    except BaseException:
        traceback.print_exc()
        return FAILED
    return READ


def run_fork(name: str, read: Callable[[], object], folder: Path) -> Ended:
    """Read in a fork with limits; what it prints is in the folder's `said`."""
    began = time.monotonic()
    process = os.fork()
    if process == 0:
        os.setsid()
        with (folder / "said").open("w") as said:
            os.dup2(said.fileno(), 1)
            os.dup2(said.fileno(), 2)
        sys.stdout = sys.stderr = os.fdopen(2, "w", closefd=False)
        _limit()
        status = FAILED
        try:
            status = attempt(read)
            sys.stderr.flush()
        finally:
            os._exit(status)
    while True:
        ended, status, usage = os.wait4(process, os.WNOHANG)
        seconds = time.monotonic() - began
        if ended:
            break
        if seconds > WAIT:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process, signal.SIGKILL)
        time.sleep(0.002)
    code = os.waitstatus_to_exitcode(status)
    words = {READ: "read", REFUSED: "refused", FAILED: "an error that is no InputError"}
    what = words.get(code, f"status {code}") if code >= 0 else f"killed by {signal.Signals(-code).name}"
    if seconds > WAIT:
        what = f"more than {WAIT} s"
    return Ended(name, what, seconds, usage.ru_maxrss / 1024)


def fuzz(
    known: Mapping[str, Target], seed: int, first: int, more: Callable[[int], bool], work: Path, kept: Path
) -> list[Ended]:
    """Run cases from number `first` on while `more(number)`; keep the files of those that fail."""
    results = []
    case, told = first, time.monotonic()
    while more(case):
        name, data = make_case(known, seed, case)
        folder = work / f"case{case}"
        folder.mkdir()
        ended = _run_case(name, known[name], data, folder)
        results.append(ended)
        if ended.status not in ("read", "refused"):
            place = kept / f"{name.replace('/', '-')}-{seed}-{case}"
            place.mkdir(parents=True, exist_ok=True)
            (place / Path(known[name].file).name).write_bytes(data)
            said = (folder / "said").read_text(errors="replace") if (folder / "said").exists() else ""
            (place / "said.txt").write_text(f"{ended}\n{said}")
            print(f"case {case} ({name}): {ended.status}; kept in {place}", flush=True)
        shutil.rmtree(folder)
        case += 1
        if time.monotonic() - told > 30:
            told = time.monotonic()
            print(f"{case - first} cases", flush=True)
    return results


def _run_case(name: str, target: Target, data: bytes, folder: Path) -> Ended:
    path = folder / target.file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return run_fork(name, lambda: target.read(path), folder)


def table(results: list[Ended]) -> str:
    """Return what happened to each format."""
    lines = [
        f"{'format':<34} {'cases':>6} {'read':>6} {'refused':>8} {'failed':>6} {'slowest':>8} {'memory':>8}"
    ]
    for name in dict.fromkeys(one.target for one in results):
        mine = [one for one in results if one.target == name]
        count = Counter(one.status if one.status in ("read", "refused") else "failed" for one in mine)
        slowest, most = max(one.seconds for one in mine), max(one.memory_mb for one in mine)
        lines.append(
            f"{name:<33}{len(mine):>9}{count['read']:>9}{count['refused']:>9}{count['failed']:>9}"
            f"{slowest:>7.1f} s{most:>6.0f} MB"
        )
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    """Run cases for some minutes, or one in this process; return 1 if any failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=float(os.environ.get("MINUTES") or 10))
    parser.add_argument("--seed", type=int, default=int(os.environ.get("SEED") or 0))
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--case", type=int, help="read this one alone, here, and show how it ends")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="fuzz") as folder:
        known = targets(Path(folder) / "whole")
        if options.case is not None:
            name, data = make_case(known, options.seed, options.case)
            status = read_case(known[name], data, Path(folder) / "case")
            print(f"{name}: {['read', 'refused', 'failed'][max(0, status - 9)]}")
            return int(status == FAILED)
        until = time.monotonic() + 60 * options.minutes
        print(f"seed {options.seed}, for {duration(60 * options.minutes)}", flush=True)
        results: list[Ended] = []
        with contextlib.suppress(KeyboardInterrupt):
            results = fuzz(
                known, options.seed, options.first, lambda case: time.monotonic() < until, Path(folder), KEPT
            )
    failed = [one for one in results if one.status not in ("read", "refused")]
    print(table(results))
    print(f"{len(results)} cases of seed {options.seed}, {len(failed)} failed")
    return int(bool(failed))


def _limit() -> None:
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + BYTES, size + BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
