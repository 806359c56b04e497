"""Snakemake as a process of ours, and what runs beside it: the warm process that stages are forked from.

Where stages run elsewhere (a cluster), their lines come through files that this process follows.
"""

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import NoReturn

from pipeline.files import create
from pipeline.progress import TOLD, say
from pipeline.run import staleness
from pipeline.run.admission import executor_of
from pipeline.run.folder import remove_socket
from pipeline.run.stage import FOLLOW_PARENT, die_with_parent
from pipeline.run.stage_server import ADDRESS, GRACE

CANCEL = 60.0
"""What Snakemake may take to cancel the jobs of a cluster [seconds]."""
PROGRESS = "logs/progress"
"""In a run's folder: what its stages say, where they run elsewhere."""
FOLLOW = 1.0
"""Between two looks at what stages elsewhere have said [seconds]."""


def environment(threads: int, base: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of the stages: what could change their results does not come from the caller."""
    pools = (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "NUMEXPR_NUM_THREADS",
    )
    path = os.pathsep.join(filter(None, [str(staleness.ROOT), base.get("PYTHONPATH", "")]))
    return {
        **base,
        **dict.fromkeys(pools, str(threads)),
        "PYTHONPATH": path,
        "PYTHONHASHSEED": "0",
        FOLLOW_PARENT: "1",
    }


def run_snakemake(
    snakefile: Path,
    folder: Path,
    arguments: Sequence[str],
    threads: int,
    profile: Path,
    variables: Mapping[str, str],
    told: Sequence[Path] = (),
    logs: Path | None = None,
) -> int:
    """Have Snakemake run a file's rules in a folder; return its exit status.

    Args:
        arguments: beside those that every run has.
        variables: the environment of the stages.
        told: files that stages which run elsewhere write their lines to; shown as they come.
        logs: the folder of Snakemake's own log; None: `folder`/logs.

    Raises:
        KeyboardInterrupt: Ctrl-C, SIGTERM or SIGHUP; the stages here have been ended, jobs of a cluster
            cancelled.
    """
    here = executor_of(profile) == "local"
    common = [
        *("--snakefile", str(snakefile), "--directory", str(folder), "--profile", str(profile)),
        # What a stage here has to say, it says itself; of a job elsewhere the log is all there is.
        *("--quiet", "all" if here else "rules"),
        *("--rerun-triggers", "mtime", "--rerun-incomplete", "--keep-incomplete", "--nolock"),
        *(["--cores", str(threads)] if here else []),
    ]
    logs = logs or folder / "logs"
    logs.mkdir(parents=True, exist_ok=True)
    sys.stdout.flush()
    sys.stderr.flush()
    with _termination_as_interrupt():
        process = os.fork()  # it has Snakemake imported already, which takes more than a second
        if process == 0:
            _become_snakemake([*common, *arguments], logs / "snakemake.log", variables, here)
        ended = False
        try:
            with contextlib.nullcontext() if here else _following(told):
                _, status = os.waitpid(process, 0)
            ended = True
            return os.waitstatus_to_exitcode(status)
        finally:
            if not ended:
                end_snakemake(process, logs / "snakemake.log", 0 if here else CANCEL)


def end_snakemake(process: int, log: Path, patience: float) -> None:
    """End Snakemake; `patience` seconds are for calling off the jobs that it has on a cluster, which would
    go on and write where the next run does."""
    if patience:
        _call_off(process, log, patience)
    with contextlib.suppress(ProcessLookupError):
        os.kill(process, signal.SIGKILL)
    with contextlib.suppress(ChildProcessError):
        os.waitpid(process, 0)


def _call_off(process: int, log: Path, patience: float) -> None:
    """Have Snakemake cancel the jobs that it has on a cluster, as Ctrl-C does, and wait for that."""
    say("cancelling the jobs on the cluster ...")
    with contextlib.suppress(ProcessLookupError, ChildProcessError, KeyboardInterrupt):
        os.kill(process, signal.SIGINT)
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline and not os.waitpid(process, os.WNOHANG)[0]:
            time.sleep(0.1)
    # The executor forgets its jobs while it asks for their state, and an interrupt that comes then cancels
    # none.
    with contextlib.suppress(OSError, subprocess.TimeoutExpired):
        if jobs := re.findall(r"SLURM jobid (\d+)", log.read_text(encoding="utf-8", errors="replace")):
            subprocess.run(["scancel", "--quiet", *jobs], timeout=CANCEL, check=False, capture_output=True)


@contextlib.contextmanager
def _following(files: Sequence[Path]) -> Iterator[None]:
    """Meanwhile, say every line that is added to files."""
    places = {file: file.stat().st_size if file.exists() else 0 for file in files}
    over = threading.Event()

    def look() -> None:
        for file, place in places.items():
            with contextlib.suppress(OSError):
                if file.stat().st_size > place:
                    with file.open("rb") as stream:
                        stream.seek(place)
                        new = stream.read()
                    whole = new.rfind(b"\n") + 1
                    places[file] = place + whole
                    for line in new[:whole].decode("utf-8", "replace").splitlines():
                        say(line)

    def follow() -> None:
        while not over.wait(FOLLOW):
            look()

    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        look()


def _become_snakemake(arguments: list[str], log: Path, variables: Mapping[str, str], here: bool) -> NoReturn:
    """Be Snakemake, in the fork. The lock of the run stays held as long as it lives."""
    status = 1
    try:
        die_with_parent()
        if not here:  # the interrupt that has it cancel its jobs must reach it
            signal.signal(signal.SIGINT, signal.default_int_handler)
        for number in (signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, signal.SIG_DFL)
        # A stage's progress is its standard output; the rest is Snakemake's and goes to the log.
        written = create(log)
        nothing = os.open(os.devnull, os.O_RDONLY)
        for standard, descriptor in enumerate((nothing, _standard_error(), written.fileno())):
            os.dup2(descriptor, standard)
        sys.stdin, sys.stdout, sys.stderr = (
            os.fdopen(standard, mode, closefd=False) for standard, mode in enumerate("rww")
        )
        os.environ.clear()
        os.environ.update(variables)
        from snakemake.cli import main

        main(arguments)
        status = 0
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)  # not the caller's own end


def _standard_error() -> int:
    """Return the descriptor that progress goes to; notebooks put a stream without one in its place."""
    try:
        return sys.stderr.fileno()
    except (OSError, AttributeError, ValueError):
        return 2


@contextlib.contextmanager
def warm(stages: Sequence[str], folder: Path, profile: Path, threads: int) -> Iterator[dict[str, str]]:
    """Have `pipeline.run.stage_server` serve stages meanwhile; give the environment to call them in: the
    server's address is a name in `folder`, for stages that run there."""
    variables = environment(threads, os.environ)
    cold = {name: value for name, value in variables.items() if name != ADDRESS}
    # Elsewhere nothing would end the stages of a killed server.
    here = executor_of(profile) == "local"
    if not here or sys.platform != "linux":
        yield cold if here else {**cold, TOLD: PROGRESS}
        return
    address = folder / ".warm"
    remove_socket(address)
    server = subprocess.Popen(
        # Both ends name the socket from inside the run's folder: a longer path may not fit its address.
        [sys.executable, "-m", "pipeline.run.stage_server", "--serve", address.name, *stages],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=cold,
        preexec_fn=die_with_parent,
    )
    try:
        yield {**cold, ADDRESS: address.name}
    finally:
        server.terminate()
        try:
            server.wait(GRACE + 5)
        except subprocess.TimeoutExpired:
            server.kill()
            server.wait()
        remove_socket(address)


@contextlib.contextmanager
def _termination_as_interrupt() -> Iterator[None]:
    """Let SIGTERM and SIGHUP unwind as Ctrl-C does, so that what was started is stopped; not if the caller
    ignores them, as nohup does."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    former: dict[signal.Signals, Callable[[int, FrameType | None], object] | int | None] = {}
    try:
        for number in (signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is not signal.SIG_IGN:
                former[number] = signal.signal(number, interrupt)
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
