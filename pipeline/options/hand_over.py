"""Several models for one asset: MODEL=small,large. The first makes a draft, the others go on from it.

A hand-over is a chain of jobs, each a run of its own that starts from the one before: stages know nothing of
it, every draft is an asset that can be looked at, and each run is kept and resumed as any other.
"""

import itertools
from collections.abc import Mapping
from pathlib import Path

from pipeline.errors import InputError
from pipeline.options import job as jobs
from pipeline.options.job import Job
from pipeline.options.models import MODELS
from pipeline.options.schema import read_yaml, short

STRENGTH = "0.25"
"""Of what a model takes over, if STRENGTH is not given: `make bench ONLY=hand-over`."""


def resolve_all(environment: Mapping[str, str], out: Path, models: Path = MODELS) -> list[Job]:
    """Return the jobs that the environment asks for, in the order in which they are made under `out`.

    All but the last are drafts, without refinement. STRENGTH is that of START where both are given, else of
    every hand-over.

    Raises:
        InputError: see `job.resolve`; a model is named twice in a row, or not at all.
    """
    names = model_names(_given_model(environment), models)
    if len(names) == 1:
        return [jobs.resolve(environment, models)]
    found: list[Job] = []
    before = ""
    for place, name in enumerate(names):
        asked = {**environment, "MODEL": name}
        if place < len(names) - 1:
            asked |= {"QUALITY": "draft", "REFINE": "0"}
        if before:
            own = "" if environment.get("START") else environment.get("STRENGTH")
            asked |= {"START": before, "STRENGTH": own or STRENGTH, "SEEDS": "1"}
        elif not environment.get("START"):
            asked.pop("STRENGTH", None)
        found.append(jobs.resolve(asked, models, before))
        before = str(out / jobs.run_name(found[-1]))
    return found


def model_names(given: str, models: Path = MODELS) -> list[str]:
    """Return the models that MODEL names: one, or several with commas between them; a folder with a comma in
    its name is one."""
    if "," not in given or (Path(given) if "/" in given else models / given).is_dir():
        return [given]
    names = [part.strip() for part in given.split(",")]
    if not all(names):
        raise InputError(f"MODEL is {short(given)}, expected models with a comma between each two")
    for first, second in itertools.pairwise(names):
        if first == second:
            raise InputError(f"MODEL names {first!r} twice in a row: a model hands over to another one")
    return names


def _given_model(environment: Mapping[str, str]) -> str:
    if environment.get("MODEL") or not environment.get("JOB"):
        return environment.get("MODEL", "")
    model = read_yaml(Path(environment["JOB"])).get("model", "")
    return model if isinstance(model, str) else ""  # if not, `job.resolve` says so
