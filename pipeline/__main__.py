"""The front door behind make: ``python -m pipeline run | plan | verify | options``.

Takes everything from the environment (PROMPT, NEGATIVE, TOKEN, MODEL, SEED, QUALITY, SKETCH, SIGMA_S, REFINE,
MESH, PARAM, PROVIDER, UNLIT, PIVOT, SIZE_M, JOB, OUT, THREADS, PROFILE, RUN), so that no shell ever reads
what a user wrote. Exit status: 0, 2 for what the user can mend, 1 for a fault of the program.
"""

import argparse
import os
import sys
from collections.abc import Mapping
from pathlib import Path

from pipeline.errors import InputError
from pipeline.files import refusal
from pipeline.options import job as jobs
from pipeline.options.schema import describe
from pipeline.progress import duration
from pipeline.run import engine
from pipeline.run.verify import verify


def main(arguments: list[str], environment: Mapping[str, str]) -> int:
    """Carry out one command and return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m pipeline", description=__doc__)
    parser.add_argument("command", choices=["run", "plan", "verify", "options"])
    command = parser.parse_args(arguments).command
    try:
        status = {"run": _run, "plan": _plan, "verify": _verify, "options": _options}[command](environment)
        sys.stdout.flush()
        return status
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of the output, head for one, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        if refused := refusal(error):
            print(f"error: {refused}", file=sys.stderr)
            return 2
        raise
    except engine.StageFailure as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped; the same command goes on from here", file=sys.stderr)
        return 130


def _run(environment: Mapping[str, str]) -> int:
    job = jobs.resolve(environment)
    run = engine.run_job(job, _out(environment), _threads(environment), environment.get("PROFILE") or "local")
    for name in engine.RESULTS:
        print(run / name)
    return 0


def _plan(environment: Mapping[str, str]) -> int:
    job, out = jobs.resolve(environment), _out(environment)
    planned = engine.plan_run(job, out)
    print(f"{out / jobs.run_name(job)}")
    print(f"{'stage':<13} {'':<10} {'time':>9} {'memory':>8}  why")
    for step, cost in planned:
        time, memory = (
            (duration(cost.seconds), f"{cost.memory_mb:.0f} MB") if step.verdict == "run" else ("", "")
        )
        print(f"{step.stage:<13} {step.verdict:<10} {time:>9} {memory:>8}  {step.reason}".rstrip())
    costs = [cost for step, cost in planned if step.verdict == "run"]
    if costs:
        total, peak = sum(cost.seconds for cost in costs), max(cost.memory_mb for cost in costs)
        print(
            f"about {duration(total)} and {peak:.0f} MB of memory on this machine; nothing was run or written"
        )
    else:
        print("nothing would run")
    return 0


def _verify(environment: Mapping[str, str]) -> int:
    if not environment.get("RUN"):
        raise InputError(
            "RUN is empty: name the folder of a finished run, for example make verify RUN=runs/latest"
        )
    run = Path(environment["RUN"])
    count, faults = verify(run)
    if faults:
        raise InputError(
            f"{run}: {len(faults)} of {count} files are not as made: {', '.join(faults)}; "
            "the command that made the run mends them"
        )
    print(f"{run}: all {count} files are as made")
    return 0


def _options(environment: Mapping[str, str]) -> int:
    print(describe(jobs.Job))
    return 0


def _out(environment: Mapping[str, str]) -> Path:
    text = environment.get("OUT") or "runs"
    otherwise = "choose another folder with OUT="
    try:
        text.encode()
    except UnicodeEncodeError:
        raise InputError(f"OUT is {text!r}, expected a path in UTF-8: {otherwise}") from None
    nearest = next(path for path in (Path(text).absolute(), *Path(text).absolute().parents) if path.exists())
    if not nearest.is_dir():
        raise InputError(f"OUT is {text!r}, but {nearest} is a file: {otherwise}")
    if not os.access(nearest, os.W_OK):
        raise InputError(f"OUT is {text!r}, but {nearest} cannot be written to: {otherwise}")
    return Path(text)


def _threads(environment: Mapping[str, str]) -> int:
    """Return the threads of a stage: all cores this process may use, unless THREADS says otherwise."""
    text = environment.get("THREADS", "")
    if not text:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not text.isdecimal() or not 1 <= int(text) <= 1024:
        raise InputError(f"THREADS is {text!r}, expected a whole number from 1 to 1024")
    return int(text)


if __name__ == "__main__":
    status = main(sys.argv[1:], os.environ)
    sys.stderr.flush()
    os._exit(status)  # the modules of Snakemake take a third of a second to be taken down
