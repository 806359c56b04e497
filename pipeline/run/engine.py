"""Runs a job: decides what has to run, has Snakemake run it, and says in one line what went wrong.

Snakemake orders the stages and hands them to this machine or to a cluster. What it lacks is here: a lock that
ends with its holder, a second run that costs no start of Snakemake, and errors for the user.
"""

import contextlib
import fcntl
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.errors import InputError
from pipeline.files import refusal, write_text
from pipeline.options import job as jobs
from pipeline.options.job import Job
from pipeline.progress import duration, say
from pipeline.run.chain import stages_of
from pipeline.run.costs import Cost
from pipeline.run.estimate import available_memory_mb, machine_pace, price
from pipeline.run.plan import Step, make_plan
from pipeline.run.snakefiles import read_chain, snakefile, snakemake_config
from pipeline.run.snakemake_process import PROGRESS, run_snakemake, runs_here, warm

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
    settings = profile_folder(profile)
    with _user_view_of_os_errors(), locked(run), _warmed(job, run, settings, threads) as variables:
        point_latest(run)
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
        config = [f"{name}={value}" for name, value in snakemake_config(job, run, threads).items()]
        # On a cluster a run is one job: its stages are short, and follow one another.
        groups = (
            [] if runs_here(settings) else ["--groups", *(f"{stage.name}=run" for stage in stages_of(job))]
        )
        arguments = ["--forcerun", *stale, *groups, "--config", *config]
        told = [run / PROGRESS]
        if run_snakemake(snakefile(job), run, arguments, threads, settings, variables, told):
            raise failure(run)
        missing = [name for name in RESULTS if not (run / name).is_file()]
        if missing:
            raise StageFailure(f"the chain ended without {', '.join(missing)}; see {run}/logs/snakemake.log")
    return run


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


def _warmed(
    job: Job, run: Path, profile: Path, threads: int
) -> contextlib.AbstractContextManager[dict[str, str]]:
    return warm([stage.name for stage in stages_of(job) if stage.warm], run, profile, threads)


def failure(run: Path) -> InputError | StageFailure:
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
def locked(run: Path) -> Iterator[None]:
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


def point_latest(run: Path) -> None:
    """Make `latest` beside the run point to it."""
    latest = run.parent / "latest"
    if latest.is_symlink() or not latest.exists():
        beside = run.parent / f".latest{os.getpid()}"
        beside.symlink_to(run.name)
        os.replace(beside, latest)


def profile_folder(name: str) -> Path:
    """Return the folder of a profile of ours by its name, or the one that a path names."""
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
