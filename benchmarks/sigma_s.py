"""Sketch-Shape's one option, from strict to free, and scenes with and without a sketch.

    make bench ONLY=sigma-s

The paper's ablation: one prompt and one sketch at five values of SIGMA_S; as a picture (the sketch first) and
a table. `iou`: intersection over union of asset and sketch in volume; `distance`: mean distance of the
asset's surface from the sketch's [scene units]. Then two prompts with and without their sketches, and the
house of the README. Runs are kept under runs/bench, so that a second call only measures.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from PIL import Image
from trimesh import Trimesh
from trimesh.sample import sample_surface

from pipeline.engine import run_job
from pipeline.job import resolve
from pipeline.report.preview import albedo_shade, normal_shade, picture, sheet, to_bytes
from pipeline.scene.cameras import Camera, orbit_camera
from pipeline.scene.mesh import Mesh, read_obj, read_ply
from pipeline.scene.sketch import volume_iou
from pipeline.scene.winding import distances, winding_numbers

SIGMAS = (0.05, 0.1, 0.3, 0.7, 1.5)
ABLATION = ("a brown horse", "animal")
PAIRS = (("a blue car", "car"), ("a yellow teddy bear", "teddy_bear"))
HOUSE = ("a gingerbread house", "house")
THREADS = 2
POINTS = 100_000
TILE = 192
SKETCHES = Path("examples/sketches")
RUNS = Path("runs/bench")


class Agreement(NamedTuple):
    """How alike asset and sketch are."""

    iou: float
    distance: float
    """[scene units]"""


def make(prompt: str, sketch: str = "", sigma: float | None = None) -> Path:
    """Return the folder of a draft run."""
    asked = {"PROMPT": prompt, "QUALITY": "draft"}
    if sketch:
        asked["SKETCH"] = str(SKETCHES / f"{sketch}.obj")
    if sigma is not None:
        asked["SIGMA_S"] = str(sigma)
    return run_job(resolve(asked), RUNS, THREADS)


def agreement(asset: Mesh, sketch: Mesh) -> Agreement:
    """Compare two meshes by 100,000 points of the box, and as many of the asset's surface."""
    points = np.random.default_rng(0).uniform(-1, 1, (POINTS, 3))
    solids = [winding_numbers(mesh.vertices, mesh.faces, points) > 0.5 for mesh in (asset, sketch)]
    surface, _ = sample_surface(Trimesh(asset.vertices, asset.faces, process=False), POINTS, seed=0)
    away = distances(sketch.vertices, sketch.faces, np.asarray(surface))
    return Agreement(round(volume_iou(*solids), 4), round(float(away.mean()), 5))


def camera() -> Camera:
    """Return the view of all pictures: from the front, a little from the left and above."""
    return orbit_camera(np.radians(40), np.radians(72), 2.5, np.radians(40))


def tile(run: Path) -> list[Float[np.ndarray, "p p 3"]]:
    """Return a finished run's asset, in its colours and as normals."""
    mesh = read_obj(run / "mesh_uv.obj")
    with Image.open(run / "albedo.png", formats=["PNG"]) as image:
        texture = np.asarray(image.convert("RGB"), np.float32) / 255
    return [
        picture(mesh, camera(), TILE, shade, 3) for shade in (albedo_shade(mesh, texture), normal_shade(mesh))
    ]


def sketch_tile(run: Path) -> Float[np.ndarray, "p p 3"]:
    """Return the sketch of a run as normals."""
    mesh = read_ply(run / "sketch.ply")
    return picture(mesh, camera(), TILE, normal_shade(mesh), 3)


def write_strip(path: Path, columns: list[list[Float[np.ndarray, "p p 3"]]]) -> None:
    """Write columns of two tiles side by side."""
    tiles = [column[row] for row in range(2) for column in columns]
    Image.fromarray(to_bytes(sheet(tiles, len(columns)))).save(path, format="PNG", optimize=True)


def main(folder: Path) -> dict[str, Any]:
    """Make the runs, write the pictures into `folder`, return the figures."""
    prompt, sketch = ABLATION
    runs = [make(prompt, sketch, sigma) for sigma in SIGMAS]
    table = [agreement(read_ply(run / "mesh.ply"), read_ply(run / "sketch.ply")) for run in runs]
    guide = sketch_tile(runs[0])
    write_strip(folder / "sigma-s.png", [[guide, guide], *(tile(run) for run in runs)])

    pairs, columns = [], []
    for words, shape in PAIRS:
        guided, free = make(words, shape), make(words)
        target = read_ply(guided / "sketch.ply")
        found = [agreement(read_ply(run / "mesh.ply"), target) for run in (free, guided)]
        pairs.append({"prompt": words, "without": found[0]._asdict(), "with": found[1]._asdict()})
        columns += [[sketch_tile(guided)] * 2, tile(free), tile(guided)]
    write_strip(folder / "sigma-s-with-and-without.png", columns)

    house = make(*HOUSE, sigma=SIGMAS[0])
    house_iou = agreement(read_ply(house / "mesh.ply"), read_ply(house / "sketch.ply")).iou
    return {
        "summary": {
            "sigma": list(SIGMAS),
            "iou": [row.iou for row in table],
            "distance": [row.distance for row in table],
            "house_iou": house_iou,
        },
        "prompt": prompt,
        "sketch": sketch,
        "quality": "draft",
        "with_and_without": pairs,
    }
