"""Results of the real front door, and how they look: what benchmarks with many runs share."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from pipeline.cameras import Camera, orbit_camera
from pipeline.errors import InputError
from pipeline.mesh.mesh import Mesh, read_obj
from pipeline.options import job as jobs
from pipeline.paint.given_mesh import load_paint_mesh
from pipeline.report.png import to_bytes
from pipeline.report.preview import BACKDROP, POLAR, SUPERSAMPLING, albedo_shade, picture, turn
from pipeline.run import engine

VIEWS = {
    "front": (0.0, POLAR),
    "front right": (np.radians(315.0), POLAR),
    "right": (np.radians(270.0), POLAR),
    "back": (np.radians(180.0), POLAR),
    "left": (np.radians(90.0), POLAR),
    "from above": (0.0, np.radians(20.0)),
}
"""Azimuth and polar angle of the six views of a result [rad]; sides are the object's own."""


class Result(NamedTuple):
    """What became of a job."""

    run: str
    """Name of the run's folder."""
    seconds: float
    """Of all its stages; 0 where it failed."""
    views: UInt8[np.ndarray, "6 p p 3"]
    """In the order of `VIEWS`; nothing but the backdrop where it failed."""
    fault: str
    """Why there is no asset, as the user is told; empty: there is one."""


def make_result(asked: dict[str, str], runs: Path, size: int) -> Result:
    """Make what a user's variables ask for, on one thread, under `runs`; draw it at `size` pixels.

    A scene that comes to nothing is a result too.

    Raises:
        InputError, StageFailure: nothing was tried (a full disk, another run in that folder, no such model).
    """
    job = jobs.resolve(asked)
    name = jobs.run_name(job)
    try:
        run = engine.run_job(job, runs, 1)
    except (InputError, engine.StageFailure) as error:
        if str(error) not in stage_faults(runs / name):
            raise
        return Result(name, 0.0, nothing(size), str(error))
    return Result(name, seconds_of_run(run), views_of_run(run, size), "")


def stage_faults(run: Path) -> list[str]:
    """Return what the stages of a run left as the reasons of their failures."""
    texts = [path.read_text(encoding="utf-8").strip() for path in (run / "stages").glob("*.error")]
    return [text.partition(" ")[2] for text in texts]


def seconds_of_run(run: Path) -> float:
    """Return what the stages of a finished run took, those included that another run had made for it."""
    return float(json.loads((run / "manifest.json").read_text(encoding="utf-8"))["seconds"])


def mesh_of_run(run: Path) -> Mesh:
    """Return the mesh of a finished run with texture points: the one made from a text, or the painted one."""
    made = run / "mesh_uv.obj"
    return read_obj(made) if made.is_file() else load_paint_mesh(run / "mesh.npz").scaled(1.0)


def texture_of_run(run: Path) -> Float[np.ndarray, "s s 3"]:
    """Return the texture of a finished run as its preview shows it, sRGB in [0, 1]: with the light that the
    model painted, which `albedo.png` leaves to the viewer's.
    """
    refined = run / "albedo_refined.png"
    with Image.open(refined if refined.is_file() else run / "albedo_baked.png", formats=["PNG"]) as image:
        return np.asarray(image.convert("RGB"), np.float32) / 255


def six_cameras(mesh: Mesh) -> list[Camera]:
    """Return the cameras of `VIEWS`, as far away as those of the preview."""
    first = turn(mesh, 1)[0]
    distance = float(np.linalg.norm(first.pose[:3, 3]))
    return [orbit_camera(azimuth, polar, distance, first.fov) for azimuth, polar in VIEWS.values()]


def views_of_run(run: Path, size: int) -> UInt8[np.ndarray, "6 p p 3"]:
    """Return the six views of a finished run, lit and antialiased as in its preview."""
    mesh = mesh_of_run(run)
    shade = albedo_shade(mesh, texture_of_run(run))
    return np.stack(
        [to_bytes(picture(mesh, camera, size, shade, SUPERSAMPLING)) for camera in six_cameras(mesh)]
    )


def nothing(size: int) -> UInt8[np.ndarray, "6 p p 3"]:
    """Return six views of nothing."""
    view = to_bytes(np.full((size, size, 3), BACKDROP, np.float32))
    return np.stack([view] * len(VIEWS))


def tiled(views: UInt8[np.ndarray, "6 p p 3"], columns: int) -> UInt8[np.ndarray, "h w 3"]:
    """Return the views side by side, `columns` (a divisor of 6) a row."""
    rows = [np.concatenate(list(views[i : i + columns]), axis=1) for i in range(0, len(views), columns)]
    return np.concatenate(rows)
