"""Runs a job: decides what has to run, has Snakemake run it, and says in one line what went wrong.

Snakemake orders the stages and hands them to this machine or to a cluster. What it lacks is here: a lock that
ends with its holder, a second run that costs no start of Snakemake, and errors for the user.
"""

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.errors import InputError
from pipeline.files import refusal, write_text
from pipeline.options import job as jobs
from pipeline.options.job import Job
from pipeline.options.models import bundle_folder
from pipeline.progress import duration, say
from pipeline.run.admission import check_given, check_job, executor_of, profile_folder
from pipeline.run.chain import stages_of
from pipeline.run.costs import Cost
from pipeline.run.estimate import available_memory_mb, machine_pace, price
from pipeline.run.failures import StageFailure as StageFailure
from pipeline.run.failures import failure
from pipeline.run.folder import check_places, date_back, locked, point_latest
from pipeline.run.plan import Step, make_plan
from pipeline.run.snakefiles import read_chain, snakefile, snakemake_config
from pipeline.run.snakemake_process import PROGRESS, run_snakemake, warm

RESULTS = ("asset.glb", "report.html")
ENOUGH_DISK = 200 * 2**20
"""A run of the default model takes about 50 MB [bytes]."""


def plan_run(job: Job, out: Path, profile: str = "local") -> list[tuple[Step, Cost]]:
    """Return what `run_job` would do, and what each stage would cost. Writes nothing.

    Raises:
        InputError: what `run_job` would raise before its first stage.
    """
    run, folder = out / jobs.run_name(job), bundle_folder(job.model)
    profile_folder(profile)
    check_job(job)
    bundle = open_bundle(folder)
    return priced(job, bundle, _plan(job, run), machine_pace())


def run_job(job: Job, out: Path, threads: int, profile: str = "local") -> Path:
    """Make a job's asset under `out` and return the run's folder.

    Raises:
        InputError: something the user can mend; nothing that was there is lost.
        StageFailure: a stage failed for another reason; the text names the log.
    """
    folder = bundle_folder(job.model)
    run = out / jobs.run_name(job)
    settings = profile_folder(profile)
    check_job(job)
    open_bundle(folder, verify=not run.exists())  # before anything is written
    pace = machine_pace()  # before anything else is going on
    with _user_view_of_os_errors(), locked(run), contextlib.ExitStack() as stack:
        variables = None
        if _missing(run):  # while the plan is made
            variables = stack.enter_context(_warmed(job, run, settings, threads))
        steps = _plan(job, run)
        described = jobs.to_yaml(job)
        if all(step.verdict == "unchanged" for step in steps):
            if not (run / "job.yaml").is_file() or (run / "job.yaml").read_bytes() != described.encode():
                write_text(run / "job.yaml", described)
            point_latest(run)
            say(f"nothing to do: every file of {run} is as it was made")
            return run
        _check_room(run, priced(job, open_bundle(folder), steps, pace))
        write_text(run / "job.yaml", described)
        for reason in (run / "stages").glob("*.error"):
            reason.unlink()
        date_back(run)
        stale = [step.stage for step in steps if step.verdict != "unchanged"]
        config = [f"{name}={value}" for name, value in snakemake_config(job, run, threads).items()]
        # On a cluster a run is one job: its stages are short, and follow one another.
        here = executor_of(settings) == "local"
        groups = [] if here else ["--groups", *(f"{stage.name}=run" for stage in stages_of(job))]
        arguments = ["--forcerun", *stale, *groups, "--config", *config]
        told = [run / PROGRESS]
        variables = variables or stack.enter_context(_warmed(job, run, settings, threads))
        if run_snakemake(snakefile(job), run, arguments, threads, settings, variables, told):
            raise failure(job, run)
        if missing := _missing(run):
            raise StageFailure(f"the chain ended without {', '.join(missing)}; see {run}/logs/snakemake.log")
        point_latest(run)
    return run


def _missing(run: Path) -> list[str]:
    """Return the results that a run's folder lacks; none: it came to its end once, and may need nothing."""
    return [name for name in RESULTS if not (run / name).is_file()]


def _plan(job: Job, run: Path) -> list[Step]:
    """Return what has to run, if what stands in the folder and what the user gave allows it."""
    new = not (run / "stages").exists()
    if new:  # all that is given may have to be read; what is wrong with it needs no chain to be known
        check_given(job, {stage.name for stage in stages_of(job)})
    chain = read_chain(job, run)
    check_places(run, [path for link in chain for path in link.outputs.values()])
    steps = make_plan(job, run, chain)
    if not new:
        check_given(job, {step.stage for step in steps if step.verdict == "run"})
    return steps


def priced(job: Job, bundle: Bundle, steps: list[Step], pace: float) -> list[tuple[Step, Cost]]:
    """Return the steps with what each would cost on a machine of that pace."""
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


@contextlib.contextmanager
def _user_view_of_os_errors() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if refused := refusal(error):
            raise refused from None
        raise
