"""The files of what START names: a run's folder, or a mesh of any tool.

A run that made its shape gives its field and the decoder of the model it was made with; where a MESH is to be
painted, and of a run that painted one, the mesh with its texture. These are the run's own files, whose places
are the scene's, not the published ones.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.documents import read_json
from pipeline.errors import InputError
from pipeline.mesh.companion_files import buffer_files, colour_files
from pipeline.options.job import Job
from pipeline.options.models import DEFAULT_MODEL, bundle_folder
from pipeline.options.schema import read_yaml
from pipeline.options.start import FIELDS
from pipeline.run.chain import STAGES

TEXTURES = ("albedo_refined.png", "albedo_baked.png")


def start_files(job: Job) -> dict[str, Path]:
    """Return what stage `start` or `start_paint` of a job reads of START, by name.

    Raises:
        InputError: a file that the mesh needs is missing, or the model of the run.
    """
    path = Path(job.start)
    if path.is_file():
        extra = [*buffer_files(path), *colour_files(path)]
        return {"start_file": path} | {f"start_extra{i}": file for i, file in enumerate(extra)}
    if job.mesh or (path / "mesh.npz").is_file():
        made = path / "mesh_uv.obj"
        mesh = path / "mesh.npz" if not made.is_file() else made
        found = {"start_mesh": mesh, "start_albedo": _first(path, TEXTURES)}
    else:
        folder = _model_of(path)
        found = {"start_scene": _first(path, FIELDS), "start_decoder": folder / "vae_decoder"}
        if (folder / "bundle.json").is_file():
            found["start_description"] = folder / "bundle.json"
    for file in found.values():
        if not file.exists():
            raise InputError(
                f"START {job.start!r} has no {file.name} yet: give the command that makes it again, so that "
                "it ends"
            )
    return found


SPENT = {"run": str, "model": str, "calls": int, "training_seconds": float, "seconds": float}
"""Columns of what was spent on a run."""


def spent_before(file: Path) -> list[dict[str, Any]]:
    """Return what was spent on the run that holds a file, and on what that started from, the earliest first:
    by run its name, model, seconds, and calls of the denoiser (steps). Nothing where no manifest says it.

    For people to read: it is no input, since seconds differ between equal runs.
    """
    try:
        manifest = read_json(file.parent / "manifest.json", "make it again")
        before = [row for entry in manifest["stages"] for row in entry["metrics"].get("before", ())]
        earlier = [{name: kind(row[name]) for name, kind in SPENT.items()} for row in before]
        return [*earlier, spent(file.parent.resolve().name, manifest["job"]["model"], manifest["stages"])]
    except (InputError, ValueError, KeyError, TypeError, AttributeError):
        return []


def spent(run: str, model: str, entries: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what the stages of a run took."""
    asking = [entry for entry in entries if STAGES[entry["stage"]].training]
    return {
        "run": run,
        "model": model,
        "calls": sum(entry["metrics"]["steps"] for entry in asking),
        "training_seconds": round(sum(entry["seconds"] for entry in asking), 1),
        "seconds": round(sum(entry["seconds"] for entry in entries), 1),
    }


def _first(folder: Path, names: tuple[str, ...]) -> Path:
    """Return the first of the files that is there, else the last."""
    return next((folder / name for name in names if (folder / name).is_file()), folder / names[-1])


def _model_of(run: Path) -> Path:
    """Return the folder of the model that a run was made with."""
    described = run / "job.yaml"
    if not described.is_file():
        raise InputError(
            f"START {str(run)!r} has no job.yaml, which names its model: give its asset.glb instead"
        )
    model = read_yaml(described).get("model", DEFAULT_MODEL)
    try:
        return bundle_folder(str(model))
    except InputError as error:
        raise InputError(f"START {str(run)!r}: {error}; give its asset.glb instead") from None
