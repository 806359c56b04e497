"""Runs many jobs as one graph, the work that they share once."""

import contextlib
import hashlib
import json
import resource
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.diffusion.bundle import open_bundle
from pipeline.errors import InputError
from pipeline.files import write_text
from pipeline.options import job as jobs
from pipeline.options.job import Job
from pipeline.options.models import bundle_folder
from pipeline.progress import duration, say
from pipeline.run.admission import check_job, executor_of, profile_folder
from pipeline.run.chain import STAGES, stage_options
from pipeline.run.estimate import machine_pace, price
from pipeline.run.failures import failure
from pipeline.run.folder import check_places, date_back, locked, point_latest
from pipeline.run.plan import make_plan
from pipeline.run.snakefiles import Link, read_chain, snakemake_config
from pipeline.run.snakemake_process import PROGRESS, run_snakemake, warm
from pipeline.run.stage_server import ADDRESS

SNAKEFILE = Path(__file__).parents[1] / "Snakefile.sweep"
FOLDER = "sweeps"
"""Of the folders of sweeps, among the runs."""


@dataclass(frozen=True)
class Outcome:
    """What became of a job."""

    job: Job
    run: Path
    reason: str
    """Why there is no asset; empty: there is one."""


def sweep_folder(out: Path, wanted: Sequence[Job], name: str) -> Path:
    """Return the folder of a sweep's own files: its name, and a hash of all that is asked for."""
    digest = hashlib.sha256("\n".join(map(jobs.run_name, wanted)).encode()).hexdigest()
    return out / FOLDER / f"{name}-{digest[:10]}"


def run_sweep(wanted: Sequence[Job], out: Path, folder: Path, threads: int, profile: str) -> list[Outcome]:
    """Make the assets of all jobs under `out`; what fails does not keep the others from being made.

    Args:
        folder: of the sweep's own files, inside `out`.
        threads: of a stage.
        profile: as for `run_job`.

    Raises:
        InputError: something the user can mend, before anything has run; another run has one of the folders.
        KeyboardInterrupt: stopped; the same command goes on from here.
    """
    settings = profile_folder(profile)
    for model in dict.fromkeys(job.model for job in wanted):
        open_bundle(bundle_folder(model))
    for job in wanted:
        check_job(job)
    runs = {job: out / jobs.run_name(job) for job in wanted}
    _allow_files(len(runs))
    with contextlib.ExitStack() as stack:
        for run in runs.values():
            stack.enter_context(locked(run))
        here = executor_of(settings) == "local"
        rules, stale = _rules(runs, out, here)
        if not rules:
            say(f"nothing to do: every file of {len(runs)} runs is as it was made")
        else:
            _announce(runs, stale, settings)
            for job in stale:
                write_text(runs[job] / "job.yaml", jobs.to_yaml(job))
                (runs[job] / "logs").mkdir(exist_ok=True)
                for reason in (runs[job] / "stages").glob("*.error"):
                    reason.unlink()
                date_back(runs[job])
            write_text(folder / "sweep.json", json.dumps(rules, indent=1) + "\n")
            stages = dict.fromkeys(stage for run in stale.values() for stage in run if STAGES[stage].warm)
            variables = stack.enter_context(warm(list(stages), folder, settings, threads))
            if here:
                variables = _from_runs(variables, folder, out)
            place = folder.relative_to(out) / "sweep.json"
            arguments = ["--keep-going", "--forceall", "--config", f"sweep={place}", f"threads={threads}"]
            told = [runs[job] / PROGRESS for job in stale]
            logs = folder / "logs"
            if run_snakemake(SNAKEFILE, out, arguments, threads, settings, variables, told, logs):
                stale = _rules(runs, out, here)[1]
            else:
                stale = {}
    outcomes = [
        Outcome(job, run, _reason(job, run, folder) if job in stale else "") for job, run in runs.items()
    ]
    if made := [outcome.run for outcome in outcomes if not outcome.reason]:
        point_latest(made[-1])
    return outcomes


def _from_runs(variables: dict[str, str], folder: Path, out: Path) -> dict[str, str]:
    """Return the environment with the server's address as a stage sees it from its run's folder."""
    if ADDRESS not in variables:
        return variables
    return {**variables, ADDRESS: f"../{folder.relative_to(out).as_posix()}/{variables[ADDRESS]}"}


def _allow_files(count: int) -> None:
    """Allow this process a lock a run."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = count + 200
    if needed > soft:
        if hard != resource.RLIM_INFINITY and needed > hard:
            raise InputError(
                f"a sweep of {count} runs holds as many files open, this system allows {hard}: "
                "raise ulimit -n, or make several sweeps of it"
            )
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


def _rules(runs: dict[Job, Path], out: Path, here: bool) -> tuple[list[dict[str, Any]], dict[Job, list[str]]]:
    """Return the rules of all stages that have to run, and the names of these stages by job.

    `here`: on this machine. On a cluster all stages of a run are one job: they are short, and follow one
        another.
    """
    chains: dict[str, list[Link]] = {}
    first: dict[str, tuple[Path, str]] = {}
    rules, stale = [], dict[Job, list[str]]()
    for number, (job, run) in enumerate(runs.items(), 1):
        config = {name: value for name, value in snakemake_config(job, run).items() if name != "run"}
        alike = json.dumps(config)
        if alike not in chains:
            chains[alike] = read_chain(job, run)
        chain = chains[alike]
        check_places(run, [path for link in chain for path in link.outputs.values()])
        verdicts = {step.stage: step.verdict for step in make_plan(job, run, chain)}
        maker = {path: link.stage for link in chain for path in _made(link)}
        signatures: dict[str, str] = {}
        for link in chain:
            signature = signatures[link.stage] = _signature(job, link, maker, signatures)
            if verdicts[link.stage] == "unchanged":
                first[signature] = (run, link.stage)
                continue
            stale.setdefault(job, []).append(link.stage)
            own = [f"{run.name}/{path}" for path in link.inputs.values() if path in maker]
            # Only of what is made in this graph: a finished sibling is found without waiting.
            other, stage = first.setdefault(signature, (run, link.stage))
            after = [f"{other.name}/stages/{stage}.json"] if other != run else []
            module = f"pipeline.run.stage_server {link.stage}"
            rules.append(
                {
                    "name": f"{link.stage}_{number}",
                    "run": run.name,
                    "label": f"[{number}/{len(runs)}] ",
                    "module": module if STAGES[link.stage].warm else f"pipeline.stages.{link.stage}",
                    "inputs": [*own, *after],
                    "outputs": [f"{run.name}/{path}" for path in _made(link)],
                    "group": "" if here else run.name,
                    "entry": f"{run.name}/stages/{link.stage}.json",
                    "arguments": [
                        *("--job", "job.yaml"),
                        *(f"--input={name}={path}" for name, path in link.inputs.items()),
                        *(f"--output={name}={path}" for name, path in link.outputs.items()),
                    ],
                }
            )
    return rules, stale


def _made(link: Link) -> list[str]:
    return [*link.outputs.values(), f"stages/{link.stage}.json"]


def _signature(job: Job, link: Link, maker: dict[str, str], signatures: dict[str, str]) -> str:
    """Return what two stages have in common whose outputs will be the same: options, and where inputs are
    from."""
    inputs = {name: signatures[maker[path]] if path in maker else path for name, path in link.inputs.items()}
    text = json.dumps([link.stage, stage_options(job, link.stage), inputs], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _announce(runs: dict[Job, Path], stale: dict[Job, list[str]], profile: Path) -> None:
    stages = sum(map(len, stale.values()))
    line = f"making {len(stale)} of {len(runs)} runs, {stages} stages"
    if executor_of(profile) == "local":
        pace, seconds = machine_pace(), 0.0
        for job, names in stale.items():
            bundle = open_bundle(bundle_folder(job.model), verify=False)
            seconds += sum(cost.seconds for cost in price(job, bundle, names, pace).values())
        line += f", about {duration(seconds)} at most"
    say(line)


def _reason(job: Job, run: Path, folder: Path) -> str:
    """Return why a run has no asset: what a stage left, or where to look."""
    if list((run / "stages").glob("*.error")):
        return str(failure(job, run))
    return f"it was not made; see {run}/logs/ and {folder}/logs/, then give the same command again"
