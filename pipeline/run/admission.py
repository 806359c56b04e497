"""What can be known to fail before any stage starts: `make plan` and `make run` refuse the same."""

import importlib.util
from collections.abc import Set
from pathlib import Path

from pipeline.diffusion.providers import provider_chain
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.token_checks import check_token
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.errors import InputError
from pipeline.mesh.file_checks import check_file
from pipeline.options.formats import asked_formats, check_installed
from pipeline.options.job import Job, token_files
from pipeline.options.models import bundle_folder
from pipeline.options.schema import read_yaml
from pipeline.run.chain import STAGES
from pipeline.sketch.reading import check_ending, read_sketch
from pipeline.sketch.svg import DRAWINGS

PROFILES = Path(__file__).parents[1] / "profiles"
QUICK = 4 * 2**20
"""Meshes up to so many bytes are read whole beforehand: a second at most."""


def check_job(job: Job) -> None:
    """Raise InputError for a provider that this onnxruntime lacks, a format whose package is missing, or a
    file that is no mesh, or no learned token, by its name or by its first bytes."""
    if job.provider != "cpu":
        provider_chain(job.provider)
    check_installed(*asked_formats(job.formats))
    for file in token_files(job.token):
        check_token(file)
    if job.mesh:
        check_file(Path(job.mesh))
    if job.start and Path(job.start).is_file():
        check_file(Path(job.start))
    if job.sketch:
        check_ending(Path(job.sketch))
        if Path(job.sketch).suffix.lower() not in DRAWINGS:
            check_file(Path(job.sketch))


def check_given(job: Job, stages: Set[str]) -> None:
    """Read what the stages of these names have to read: meshes or the drawing (what is too large to be read
    twice is left to its stage), the model's tokenizer and its schedule; raises InputError as they would."""
    folder = bundle_folder(job.model)
    if "embed" in stages:
        load_tokenizer(folder / "tokenizer")
    if any(STAGES[stage].training for stage in stages):
        load_schedule(folder / "scheduler")
    given = {"prepare": job.mesh, "sketch": job.sketch}
    for path in (Path(path) for stage, path in given.items() if path and stage in stages):
        if path.stat().st_size <= QUICK:
            read_sketch(path, job.sketch_field.thickness)
    start = Path(job.start)
    if stages & {"start", "start_paint"} and start.is_file() and start.stat().st_size <= QUICK:
        from pipeline.mesh.pictures import check_pictures  # with pillow, which few runs need here
        from pipeline.mesh.readers import read_mesh

        read_mesh(start)
        check_pictures(start)


def profile_folder(name: str) -> Path:
    """Return the folder of a Snakemake profile: one of ours, or the user's.

    Raises:
        InputError: there is none, or the plugin that it needs is not installed.
    """
    known = sorted(path.name for path in PROFILES.iterdir())
    folder = PROFILES / name if name in known else Path(name)
    if not (folder / "config.yaml").is_file():
        raise InputError(
            f"PROFILE {name!r} does not exist; there are: {', '.join(known)}, or a folder with config.yaml"
        )
    executor = executor_of(folder)
    plugin = f"snakemake_executor_plugin_{executor.replace('-', '_')}"
    if executor not in ("local", "dryrun", "touch") and importlib.util.find_spec(plugin) is None:
        package = plugin.replace("_", "-")
        raise InputError(
            f"PROFILE {name!r} runs stages by {executor}, whose package {package} is not installed: "
            f".venv/bin/python -m pip install {package}"
        )
    return folder.resolve()


def executor_of(profile: Path) -> str:
    """Return what a profile runs stages by; `local` is this machine."""
    return str(read_yaml(profile / "config.yaml").get("executor") or "local")
