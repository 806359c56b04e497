"""The chain of stages, as the Snakefile has it."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.job import Job, bundle_folder

SNAKEFILE = Path(__file__).with_name("Snakefile")


@dataclass(frozen=True)
class Link:
    """One stage of the chain; paths are relative to the run's folder."""

    stage: str
    inputs: dict[str, str]
    outputs: dict[str, str]


def snakemake_config(job: Job, run: Path, threads: int = 1) -> dict[str, str | int]:
    """Return what the Snakefile is told: the run (it need not exist yet), its bundle, the user's files,
    threads a stage.
    """
    files = {"sketch": str(Path(job.sketch).resolve())} if job.sketch else {}
    bundle = bundle_folder(job.model).resolve()
    return {"run": str(run.resolve()), "bundle": str(bundle), "threads": threads, **files}


def read_chain(job: Job, run: Path) -> list[Link]:
    """Return the stages of a job's run, each after those it depends on."""
    # Snakemake takes a second to import: only who asks for the chain pays.
    from snakemake.api import ConfigSettings, OutputSettings, ResourceSettings, SnakemakeApi

    with SnakemakeApi(OutputSettings(dryrun=True)) as api:
        config = ConfigSettings(config=snakemake_config(job, run))
        rules = api.workflow(ResourceSettings(), config, snakefile=SNAKEFILE)._workflow.rules
        links = []
        for rule in rules:
            outputs = {name: str(path) for name, path in rule.output.items()}
            if outputs.pop("entry", None):
                inputs = {name: _plain(path) for name, path in rule.input.items()}
                links.append(Link(rule.name, inputs, outputs))
    return links


def _plain(path: str) -> str:
    """Undo the doubling by which the Snakefile keeps braces from being wildcards."""
    return str(path).replace("{{", "{").replace("}}", "}")
