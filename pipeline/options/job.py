"""What is asked for: one typed, range-checked job.

A job is resolved from, in rising order of precedence: the defaults below (the paper's values where it gives
them), the quality table, the ``distillation`` section of the model's bundle.json, the YAML file named by
JOB, and the environment variables PROMPT, NEGATIVE, TOKEN, MODEL, SEED, SEEDS, QUALITY, SKETCH, SIGMA_S,
REFINE, MESH, PARAM, START, STRENGTH, PROVIDER, UNLIT, PIVOT, SIZE_M and FORMATS. The resolved
job is complete: it is what a run's job.yaml holds, and its hash names the run's folder.

This module is imported before anything runs, so it imports nothing heavy.
"""

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import yaml

from pipeline.documents import read_json
from pipeline.errors import InputError
from pipeline.options.asset import Bake, Clean, Extract, Publish, Unwrap
from pipeline.options.distillation import Distillation
from pipeline.options.formats import asked_formats
from pipeline.options.models import DEFAULT_MODEL, MODELS, bundle_folder
from pipeline.options.nerf import Contest, Refinement, SketchField, TrainNerf
from pipeline.options.paint import BakePaint, Prepare, TrainPaint
from pipeline.options.quality import HAND_OVER, QUALITY
from pipeline.options.schema import build, check, check_text, option, plain, read_yaml, short
from pipeline.options.start import StartFit, check_start, lasting


@dataclass(frozen=True)
class Job:
    """One asset."""

    prompt: str = option("", "what to make, e.g. a red armchair")
    negative: str = option("", "what to avoid")
    token: str = option("", "textual inversion: files of learned tokens in the prompt, commas between them")
    model: str = option(DEFAULT_MODEL, "a folder under onnx_models/, or a path to one")
    seed: int = option(0, "seed of every random number", 0, 2**32 - 1)
    seeds: int = option(1, "so many seeds, from `seed` on, begin; the best one goes on", 1, 64)
    contest: Contest = field(default_factory=Contest)
    provider: Literal["cpu", "cuda", "tensorrt", "rocm", "migraphx", "openvino", "dml", "coreml"] = option(
        "cpu", "what onnxruntime runs the model on"
    )
    quality: Literal["draft", "standard", "high"] = option("standard", "how much work: see the quality table")
    sketch: str = option("", "Sketch-Shape: a mesh or a drawing that guides the shape; empty: none")
    sketch_field: SketchField = field(default_factory=SketchField)
    refine: bool = option(False, "RGB refinement after the latent training")
    refinement: Refinement = field(default_factory=Refinement)
    mesh: str = option("", "paint this mesh: a path to an OBJ, PLY, STL, OFF, GLB or glTF file")
    param: Literal["texture", "face"] = option(
        "texture", "how a mesh is painted: with a texture, or with one colour a face (no texture coordinates)"
    )
    start: str = option(
        "", "what to go on from: the folder of a run, or a textured mesh; empty: from nothing"
    )
    strength: float = option(
        0.5, "how far to go from the start: the noise level that distillation sets out from", 0.01, 1
    )
    start_fit: StartFit = field(default_factory=StartFit)
    train_nerf: TrainNerf = field(default_factory=TrainNerf)
    extract: Extract = field(default_factory=Extract)
    clean: Clean = field(default_factory=Clean)
    unwrap: Unwrap = field(default_factory=Unwrap)
    bake: Bake = field(default_factory=Bake)
    prepare: Prepare = field(default_factory=Prepare)
    train_paint: TrainPaint = field(default_factory=TrainPaint)
    bake_paint: BakePaint = field(default_factory=BakePaint)
    publish: Publish = field(default_factory=Publish)
    formats: str = option("", "files beside GLB and OBJ: some of ply, stl, 3mf and usdz, commas between them")

    def __post_init__(self) -> None:
        check(self)
        asked_formats(self.formats)
        for name in ("prompt", "negative", "token", "sketch", "mesh", "start"):
            check_text(name, getattr(self, name))
        if not self.prompt.strip():
            raise InputError(
                'prompt is empty: say what to make, for example make run PROMPT="a red armchair"'
            )


PLAIN = [
    "PROMPT",
    "NEGATIVE",
    "TOKEN",
    "MODEL",
    "QUALITY",
    "SKETCH",
    "MESH",
    "PARAM",
    "START",
    "PROVIDER",
    "FORMATS",
]
"""Variables that are taken as they stand."""


def resolve(
    environment: Mapping[str, str],
    models: Path = MODELS,
    coming: str = "",
    options: Mapping[str, Any] | None = None,
) -> Job:
    """Return the complete job that the environment asks for (an empty variable counts as not given).
    `coming` is a START that another model will have made before: it need not be there.

    `options`: keys of a job file that win over the file, and the environment over them.

    Raises:
        InputError: an unknown key, a value of the wrong type or out of range, a model that does not exist.
    """
    given: dict[str, Any] = read_yaml(Path(environment["JOB"])) if environment.get("JOB") else {}
    given |= options or {}
    written = given.get("quality")
    variables = _variables(environment)
    for name in ("train_nerf", "publish"):
        section = given.get(name) or {}
        if name in variables:  # what is no section, `build` names
            variables[name] = {**section, **variables[name]} if isinstance(section, dict) else section
    given |= variables
    # Everything the user can get wrong is named before the layers below it are merged in.
    asked = build(Job, given, environment.get("JOB") or "")
    if asked.sketch and asked.mesh:
        raise InputError(
            "SKETCH and MESH are given: a sketch guides a new shape, a mesh is painted as it is; "
            "leave one out"
        )
    if asked.seeds > 1 and (asked.mesh or asked.start):
        raise InputError(
            f"SEEDS is {asked.seeds} and {'MESH' if asked.mesh else 'START'} is given: seeds differ in the "
            "shape that they find from nothing; leave SEEDS out, or the other"
        )
    if environment.get("SIGMA_S") and not asked.sketch:
        raise InputError("SIGMA_S is given, but no sketch that it could act on: say SKETCH=file too")
    if set("{}") & set(asked.token):
        raise InputError(
            f"TOKEN {short(asked.token)} holds a brace, a wildcard to Snakemake: rename the file"
        )
    for file in token_files(asked.token):
        if not file.is_file():
            raise InputError(f"TOKEN {short(str(file))} is no file: give the path of a learned embedding")
    if asked.sketch and not Path(asked.sketch).is_file():
        raise InputError(f"SKETCH {short(asked.sketch)} is no file: give the path of a mesh or a drawing")
    if asked.mesh and not Path(asked.mesh).is_file():
        raise InputError(f"MESH {short(asked.mesh)} does not exist or is no file: give the path of a mesh")
    if environment.get("PARAM") and not asked.mesh:
        raise InputError("PARAM is given without MESH: it chooses how a given mesh is painted")
    if asked.mesh and (moved := [name for name in ("PIVOT", "SIZE_M") if environment.get(name)]):
        raise InputError(f"{moved[0]} is given with MESH, which keeps its place and its size: leave it out")
    if asked.start and asked.start != coming:
        check_start(asked.start)
    if environment.get("STRENGTH") and not asked.start:
        raise InputError("STRENGTH is given, but no START that it could act on: say START=run or mesh too")
    for name in ("start", "mesh", "sketch"):
        if path := getattr(asked, name):
            given[name] = lasting(path)
    if asked.formats:
        given["formats"] = ",".join(asked_formats(asked.formats))
    bundle = _bundle_options(bundle_folder(asked.model, models))
    bundle = {**bundle, **(HAND_OVER if coming else {})}
    job = _merge([QUALITY[asked.quality], bundle, given], environment.get("JOB") or "")
    if isinstance(written, str) and written in QUALITY and written != asked.quality:
        before = _merge([QUALITY[written], bundle, given], environment.get("JOB") or "")
        if before == job:
            raise InputError(
                f"QUALITY={asked.quality} changes nothing: {environment['JOB']} is complete, with the values "
                f"of quality {written}; delete from it what {asked.quality} shall decide, or give PROMPT "
                "and the other variables instead of JOB"
            )
    return job


def _variables(environment: Mapping[str, str]) -> dict[str, Any]:
    """Return what the variables say of the job; an error names the variable, not the file that it goes
    before."""
    found: dict[str, Any] = {}
    for variable in PLAIN:
        if environment.get(variable):
            found[variable.lower()] = environment[variable]
    for variable in ("SEED", "SEEDS"):
        if environment.get(variable):
            found[variable.lower()] = _parse_whole(variable, environment[variable])
    if environment.get("STRENGTH"):
        found["strength"] = _parse_number("STRENGTH", environment["STRENGTH"], "0.5")
    if environment.get("REFINE"):
        found["refine"] = _parse_switch("REFINE", environment["REFINE"])
    if environment.get("SIGMA_S"):
        found["train_nerf"] = {"sigma_s": _parse_number("SIGMA_S", environment["SIGMA_S"], "0.3")}
    published: dict[str, Any] = {}
    if environment.get("UNLIT"):
        published["unlit"] = _parse_switch("UNLIT", environment["UNLIT"])
    if environment.get("PIVOT"):
        published["pivot"] = environment["PIVOT"]
    if environment.get("SIZE_M"):
        published["size_m"] = _parse_number("SIZE_M", environment["SIZE_M"], "1.8")
    if published:
        found["publish"] = published
    try:
        build(Job, {"prompt": "x", **found})
    except InputError as error:
        name, _, rest = str(error).partition(" ")
        raise InputError(f"{name.rpartition('.')[2].upper()} {rest}") from None
    return found


def _merge(layers: Sequence[Mapping[str, Any]], file: str) -> Job:
    """Return the job of the layers, later ones first."""
    merged: dict[str, Any] = {}
    for layer in layers:
        for key, value in layer.items():
            merged[key] = {**merged.get(key, {}), **value} if isinstance(value, dict) else value
    return build(Job, merged, file)


def token_files(given: str) -> list[Path]:
    """Return the files that TOKEN names: one, or several with commas between them."""
    if not given.strip() or Path(given).is_file():
        return [Path(given)] if given.strip() else []
    return [Path(part.strip()) for part in given.split(",") if part.strip()]


def to_yaml(job: Job) -> str:
    """Return the complete job as YAML; ``build(Job, yaml.safe_load(...))`` gives the same job back."""
    values = plain(job)
    text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=100)
    if yaml.safe_load(text) != values:  # rare line separators (U+0085) come back as spaces unless escaped
        text = yaml.safe_dump(values, sort_keys=False, width=100)
    return text


def load(path: Path) -> Job:
    """Read a resolved job.

    Raises:
        InputError: as for `read_yaml` and `build`.
    """
    return build(Job, read_yaml(path), str(path))


def run_name(job: Job) -> str:
    """Return the name of the job's folder: a readable slug and a hash of everything asked for."""
    digest = hashlib.sha256(json.dumps(plain(job), sort_keys=True).encode()).hexdigest()
    slug = re.sub(r"[^a-z0-9]+", "-", job.prompt.lower()).strip("-")[:40].strip("-")
    return f"{slug or 'prompt'}-{digest[:10]}"


def _parse_whole(name: str, text: str) -> int:
    if not re.fullmatch(r"[+-]?\d{1,20}", text.strip(), flags=re.ASCII):
        most = {"SEED": f"0 to {2**32 - 1}", "SEEDS": "1 to 64"}[name]
        raise InputError(f"{name} is {short(text)}, expected a whole number from {most}")
    return int(text)


def _parse_switch(name: str, text: str) -> bool:
    if text not in ("0", "1"):
        raise InputError(f"{name} is {short(text)}, expected 1 (yes) or 0 (no)")
    return text == "1"


def _parse_number(name: str, text: str, example: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{name} is {short(text)}, expected a number such as {example}") from None


def _bundle_options(folder: Path) -> dict[str, Any]:
    """Return what the bundle recommends, by section of the job.

    Its `distillation` speaks of training a field; painting takes of it what the two share, and `painting`;
    refinement goes on where it ends, but for `refinement`.
    """
    path = folder / "bundle.json"
    if not path.exists():
        return {}
    try:
        described = read_json(path, "fetch or export the bundle again")
        options, painting, refinement = (
            {**described.get(name, {})} for name in ("distillation", "painting", "refinement")
        )
    except (AttributeError, TypeError) as error:
        raise InputError(
            f"{path} is not a bundle description: {error}; fetch or export the bundle again"
        ) from None
    shared = {spec.name for spec in fields(Distillation)}
    common = {name: value for name, value in options.items() if name in shared}
    painting = {**common, **painting}
    last = {name.removesuffix("_end"): v for name, v in common.items() if name.endswith("_end") and v}
    refinement = {**common, **last, **refinement}
    for kind, values in ((TrainNerf, options), (TrainPaint, painting), (Refinement, refinement)):
        build(kind, values, str(path))
    return {"train_nerf": options, "train_paint": painting, "refinement": refinement}
