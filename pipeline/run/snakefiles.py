"""The chain of a job as its Snakefile has it: which file is made from which."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from pipeline.options.formats import asked_formats
from pipeline.options.job import Job, token_files
from pipeline.options.models import bundle_folder
from pipeline.run.chain import REPORT, stages_of
from pipeline.run.start_files import start_files


@dataclass(frozen=True)
class Link:
    """One stage of the chain; paths are relative to the run's folder."""

    stage: str
    inputs: dict[str, str]
    outputs: dict[str, str]


def snakefile(job: Job) -> Path:
    """Return the file with the rules for a job: painting a given mesh, or making one."""
    return Path(__file__).parents[1] / ("Snakefile.paint" if job.mesh else "Snakefile")


def snakemake_config(job: Job, run: Path, threads: int = 1) -> dict[str, str | int]:
    """Return what the Snakefile is told: the run (it need not exist yet), its bundle, its stages, threads a
    stage, and the files that the user gave. Paths are percent-encoded: Snakemake reads values as YAML,
    without quotes.
    """
    given = {name: Path(path) for name, path in (("mesh", job.mesh), ("sketch", job.sketch)) if path}
    tokens = ",".join(quote(str(path.resolve())) for path in token_files(job.token))
    paths = {"run": run, "bundle": bundle_folder(job.model), **given}
    start = start_files(job) if job.start else {}
    named = ",".join(f"{name}={quote(str(path.resolve()))}" for name, path in start.items())
    return {
        **{name: quote(str(path.resolve())) for name, path in paths.items()},
        **({"start": named} if named else {}),
        "stages": "+".join(stage.name for stage in stages_of(job) if stage is not REPORT),
        "param": job.param,
        "normal_map": "yes" if job.bake.normal_map else "no",
        **({"formats": "+".join(asked_formats(job.formats))} if job.formats else {}),
        **({"tokens": tokens} if tokens else {}),  # Snakemake takes no empty value
        "threads": threads,
    }


@contextlib.contextmanager
def cache_folder() -> Iterator[None]:
    """Meanwhile, have a cache folder that can be written: Snakemake makes one for sources from the network,
    which a run does not use, and ends where it cannot (no home, or a read-only one)."""
    usual = os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "snakemake")
    with contextlib.suppress(OSError):
        os.makedirs(usual, exist_ok=True)
    if os.access(usual, os.W_OK):
        yield
        return
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as other:
        os.environ["XDG_CACHE_HOME"] = other
        yield


def read_chain(job: Job, run: Path) -> list[Link]:
    """Return the stages of a job's run, each after those it depends on."""
    # Snakemake takes a second to import: only who asks for the chain pays.
    from snakemake.api import ConfigSettings, OutputSettings, ResourceSettings, SnakemakeApi

    with SnakemakeApi(OutputSettings(dryrun=True)) as api:
        config = ConfigSettings(config=snakemake_config(job, run))
        # There is no public way to the rules of a workflow.
        rules = api.workflow(ResourceSettings(), config, snakefile=snakefile(job))._workflow.rules
        links = []
        for rule in rules:
            outputs = {name: str(path) for name, path in rule.output.items()}
            if outputs.pop("entry", None):
                named = rule.params.files(None, rule.input, rule.output)
                parts = (argument.split("=", 2) for argument in named)
                inputs = {label: path for kind, label, path in parts if kind == "--input"}
                links.append(Link(rule.name, inputs, outputs))
    return links
