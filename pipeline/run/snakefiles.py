"""The chain of a job as its Snakefile has it: which file is made from which."""

from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from pipeline.options.job import Job, bundle_folder, token_files
from pipeline.run.chain import REPORT, stages_of


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
    return {
        **{name: quote(str(path.resolve())) for name, path in paths.items()},
        "stages": "+".join(stage.name for stage in stages_of(job) if stage is not REPORT),
        "param": job.param,
        "normal_map": "yes" if job.bake.normal_map else "no",
        **({"tokens": tokens} if tokens else {}),  # Snakemake takes no empty value
        "threads": threads,
    }


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
                inputs = {name: _plain(path) for name, path in rule.input.items()}
                for given in getattr(rule.params, "given", lambda wildcards: ())(None):
                    name, _, path = given.removeprefix("--input=").partition("=")
                    inputs[name] = path
                links.append(Link(rule.name, inputs, outputs))
    return links


def _plain(path: str) -> str:
    """Undo the doubling by which the Snakefile keeps braces from being wildcards."""
    return str(path).replace("{{", "{").replace("}}", "}")
