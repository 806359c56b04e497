"""Several jobs one after the other, each of which may start from the one before."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.diffusion.bundle import open_bundle
from pipeline.options import job as jobs
from pipeline.options.job import Job
from pipeline.options.models import bundle_folder
from pipeline.progress import say
from pipeline.run.chain import stages_of
from pipeline.run.costs import Cost
from pipeline.run.engine import plan_run, priced, run_job
from pipeline.run.estimate import machine_pace
from pipeline.run.plan import Step


def plan_runs(chain: Sequence[Job], out: Path, profile: str = "local") -> list[list[tuple[Step, Cost]]]:
    """Return what `run_jobs` would do, job by job: of one that starts from a run that is yet to be made, or
    made again, that all of it runs. Writes nothing."""
    plans: list[list[tuple[Step, Cost]]] = []
    before = None
    for job in chain:
        if before is not None and any(step.verdict == "run" for step, _ in plans[-1]):
            bundle = open_bundle(bundle_folder(job.model))
            steps = [Step(stage.name, "run", f"after {before}") for stage in stages_of(job)]
            plans.append(priced(job, bundle, steps, machine_pace()))
        else:
            plans.append(plan_run(job, out, profile))
        before = jobs.run_name(job)
    return plans


def run_jobs(chain: Sequence[Job], out: Path, threads: int, profile: str = "local") -> Path:
    """Make jobs that start from one another, in their order; return the folder of the last. Raises as
    `run_job`: what another one needs is looked at before the first begins."""
    for job in chain[1:]:
        open_bundle(bundle_folder(job.model))
    for place, job in enumerate(chain):
        if len(chain) > 1:
            say(f"{'draft' if place < len(chain) - 1 else 'asset'} with {job.model}:")
        run = run_job(job, out, threads, profile)
    return run
