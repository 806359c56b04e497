"""Runs a job: decides what has to run, has Snakemake run it, and says in one line what went wrong.

Snakemake orders the stages and hands them to this machine or to a cluster. What it lacks is here: a lock that
ends with its holder, a second run that costs no start of Snakemake, and errors for the user.
"""

import contextlib
import fcntl
import os
import shutil
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import NoReturn

from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.errors import InputError
from pipeline.files import refusal, write_text
from pipeline.options import job as jobs
from pipeline.options.job import Job
from pipeline.options.schema import read_yaml
from pipeline.progress import duration, say
from pipeline.run import staleness
from pipeline.run.chain import stages_of
from pipeline.run.costs import Cost
from pipeline.run.estimate import available_memory_mb, machine_pace, price
from pipeline.run.plan import Step, make_plan
from pipeline.run.snakefiles import read_chain, snakefile, snakemake_config
from pipeline.run.stage import FOLLOW_PARENT, die_with_parent
from pipeline.run.stage_server import ADDRESS, GRACE

PROFILES = Path(__file__).parents[1] / "profiles"
RESULTS = ("asset.glb", "report.html")
ENOUGH_DISK = 200 * 2**20
"""A run of the default model takes about 50 MB [bytes]."""


class StageFailure(Exception):
    """A fault of the program, not of the input: one line for the user, exit status 1."""


def plan_run(job: Job, out: Path) -> list[tuple[Step, Cost]]:
    """Return what `run_job` would do, and what each stage would cost. Writes nothing.

    Raises:
        InputError: the bundle cannot work.
    """
    run, folder = out / jobs.run_name(job), jobs.bundle_folder(job.model)
    bundle = open_bundle(folder)
    return _priced(job, bundle, make_plan(job, run, read_chain(job, run)), machine_pace())


def run_job(job: Job, out: Path, threads: int, profile: str = "local") -> Path:
    """Make a job's asset under `out` and return the run's folder.

    Raises:
        InputError: something the user can mend; nothing that was there is lost.
        StageFailure: a stage failed for another reason; the text names the log.
    """
    folder = jobs.bundle_folder(job.model)
    run = out / jobs.run_name(job)
    open_bundle(folder, verify=not run.exists())  # before anything is written
    pace = machine_pace()  # before anything else is going on
    settings = _profile(profile)
    with _user_view_of_os_errors(), _locked(run), _warm(job, run, settings, threads) as variables:
        _point_latest(run)
        steps = make_plan(job, run, read_chain(job, run))
        described = jobs.to_yaml(job)
        if all(step.verdict == "unchanged" for step in steps):
            if not (run / "job.yaml").is_file() or (run / "job.yaml").read_bytes() != described.encode():
                write_text(run / "job.yaml", described)
            say(f"nothing to do: every file of {run} is as it was made")
            return run
        _check_room(run, _priced(job, open_bundle(folder), steps, pace))
        write_text(run / "job.yaml", described)
        for reason in (run / "stages").glob("*.error"):
            reason.unlink()
        stale = [step.stage for step in steps if step.verdict != "unchanged"]
        if _snakemake(job, run, stale, threads, settings, variables):
            raise _failure(run)
        missing = [name for name in RESULTS if not (run / name).is_file()]
        if missing:
            raise StageFailure(f"the chain ended without {', '.join(missing)}; see {run}/logs/snakemake.log")
    return run


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


def _priced(job: Job, bundle: Bundle, steps: list[Step], pace: float) -> list[tuple[Step, Cost]]:
    costs = price(job, bundle, [step.stage for step in steps], pace)
    return [(step, costs[step.stage]) for step in steps]


def _check_room(run: Path, priced: list[tuple[Step, Cost]]) -> None:
    """Refuse to start on a full disk; say how long it will take, and when memory will be short."""
    free = shutil.disk_usage(run).free
    if free < ENOUGH_DISK:
        needed = ENOUGH_DISK >> 20
        raise InputError(
            f"{run} has {free >> 20} MB of disk left, a run needs {needed} MB: free some, or say OUT="
        )
    costs = [cost for step, cost in priced if step.verdict == "run"]
    if not costs:
        return
    say(f"making {run}, about {duration(sum(cost.seconds for cost in costs))}")
    memory, available = max(cost.memory_mb for cost in costs), available_memory_mb()
    if available is not None and memory > available:
        say(
            f"warning: about {memory:.0f} MB of memory are needed, {available:.0f} MB are free: "
            "close other programs, or lower QUALITY"
        )


def _snakemake(
    job: Job,
    run: Path,
    stages: list[str],
    threads: int,
    profile: Path,
    variables: Mapping[str, str],
) -> int:
    """Have Snakemake run the stages named and those after them; return its exit status."""
    config = [f"{name}={value}" for name, value in snakemake_config(job, run, threads).items()]
    arguments = [
        "--snakefile",
        str(snakefile(job)),
        "--directory",
        str(run),
        "--profile",
        str(profile),
        "--quiet",
        "all",
        "--rerun-triggers",
        "mtime",
        "--rerun-incomplete",
        "--keep-incomplete",
        "--nolock",
        "--forcerun",
        *stages,
        "--config",
        *config,
        *(["--cores", str(threads)] if _runs_here(profile) else []),
    ]
    (run / "logs").mkdir(exist_ok=True)
    sys.stdout.flush()
    sys.stderr.flush()
    with _termination_as_interrupt():
        process = os.fork()  # it has Snakemake imported already, which takes more than a second
        if process == 0:
            _become_snakemake(arguments, run / "logs" / "snakemake.log", variables)
        ended = False
        try:
            _, status = os.waitpid(process, 0)
            ended = True
            return os.waitstatus_to_exitcode(status)
        finally:
            if not ended:
                os.kill(process, signal.SIGKILL)
                os.waitpid(process, 0)


def _become_snakemake(arguments: list[str], log: Path, variables: Mapping[str, str]) -> NoReturn:
    """Be Snakemake, in the fork. The lock of the run stays held as long as it lives."""
    status = 1
    try:
        die_with_parent()
        for number in (signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, signal.SIG_DFL)
        # A stage's progress is its standard output; the rest is Snakemake's and goes to the log.
        written = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        nothing = os.open(os.devnull, os.O_RDONLY)
        for standard, descriptor in enumerate((nothing, _standard_error(), written)):
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


def _runs_here(profile: Path) -> bool:
    return bool(read_yaml(profile / "config.yaml").get("executor", "local") == "local")


@contextlib.contextmanager
def _warm(job: Job, run: Path, profile: Path, threads: int) -> Iterator[dict[str, str]]:
    """Have `pipeline.run.stage_server` serve stages meanwhile; give the environment to call them in."""
    variables = environment(threads, os.environ)
    cold = {name: value for name, value in variables.items() if name != ADDRESS}
    # Elsewhere nothing would end the stages of a killed server.
    if not _runs_here(profile) or sys.platform != "linux":
        yield cold
        return
    served = [stage.name for stage in stages_of(job) if stage.warm]
    address = run / ".warm"
    address.unlink(missing_ok=True)
    server = subprocess.Popen(
        # Both ends name the socket from inside the run's folder: a longer path may not fit its address.
        [sys.executable, "-m", "pipeline.run.stage_server", "--serve", address.name, *served],
        cwd=run,
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
        address.unlink(missing_ok=True)


def _failure(run: Path) -> InputError | StageFailure:
    """Return the reason that a stage left, or the best guess where it could leave none."""
    for path in sorted((run / "stages").glob("*.error"), key=os.path.getmtime):
        code, _, reason = path.read_text(encoding="utf-8").strip().partition(" ")
        return InputError(reason) if code == "2" else StageFailure(reason)
    if shutil.disk_usage(run).free < 2**20:
        return InputError(
            f"{run}: no space is left on the device: free some, then give the same command again"
        )
    log = run / "logs" / "snakemake.log"
    said = [line for line in log.read_text(encoding="utf-8", errors="replace").splitlines() if line.strip()]
    word = said[-1].strip() if len(said) > 1 else "a stage ended without a word (killed, or out of memory)"
    return StageFailure(
        f"{word}; see {log.parent}/, then give the same command again: it goes on where it stopped"
    )


@contextlib.contextmanager
def _locked(run: Path) -> Iterator[None]:
    """Hold the run's folder for this process and its forks: the kernel drops the lock when all have ended."""
    run.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(run / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(descriptor, 20).decode(errors="replace").strip()
            raise InputError(
                f"{run} is being made by another run (process {holder or 'unknown'}): wait for it to end, "
                "or stop it, then give the same command again"
            ) from None
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, str(os.getpid()).encode(), 0)
        yield
    finally:
        os.close(descriptor)


def _point_latest(run: Path) -> None:
    """Make `latest` beside the run point to it."""
    latest = run.parent / "latest"
    if latest.is_symlink() or not latest.exists():
        beside = run.parent / f".latest{os.getpid()}"
        beside.symlink_to(run.name)
        os.replace(beside, latest)


def _profile(name: str) -> Path:
    known = sorted(path.name for path in PROFILES.iterdir())
    folder = PROFILES / name if name in known else Path(name)
    if not (folder / "config.yaml").is_file():
        raise InputError(
            f"PROFILE {name!r} does not exist; there are: {', '.join(known)}, or a folder with config.yaml"
        )
    return folder.resolve()


@contextlib.contextmanager
def _user_view_of_os_errors() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if refused := refusal(error):
            raise refused from None
        raise


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
