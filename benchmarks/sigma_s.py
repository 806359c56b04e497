"""Sketch-Shape's one option, from strict to free, and scenes with and without a sketch.

    make bench ONLY=sigma-s

The paper's ablation: five values of SIGMA_S, for two prompts and sketches and two seeds, as a picture of
the first seed (sketches first) and a table of means. `iou`: intersection over union of asset and sketch in
volume; `distance`: mean distance of the asset's surface from the sketch's [scene units]; the summary holds
the means over both. Then two prompts with and without their sketches. Runs are kept under runs/bench, so
that a second call only measures.
"""

import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from jaxtyping import Float
from PIL import Image
from trimesh import Trimesh
from trimesh.sample import sample_surface

from benchmarks._results import texture_of_run
from pipeline.cameras import Camera, orbit_camera
from pipeline.mesh.mesh import Mesh, read_obj, read_ply
from pipeline.options.job import resolve
from pipeline.report.png import to_bytes
from pipeline.report.preview import albedo_shade, normal_shade, picture, sheet
from pipeline.run.engine import run_job
from pipeline.sketch.lattice import volume_iou
from pipeline.sketch.winding import distances, winding_numbers

SEEDS = (0, 1)
SIGMAS = (0.05, 0.1, 0.3, 0.7, 1.5)
WEIGHTS = (0.0, 100.0, 1000.0, 10_000.0)
ABLATION = (("a brown horse", "animal"), ("a gingerbread house", "house"))
PAIRS = (("a blue car", "car"), ("a yellow teddy bear", "teddy_bear"))
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


def make(prompt: str, sketch: str = "", seed: int = 0, **options: float) -> Path:
    """Return the folder of a draft run with these options of `train_nerf`."""
    asked = {"prompt": prompt, "quality": "draft", "seed": seed, "train_nerf": options}
    if sketch:
        asked["sketch"] = str(SKETCHES / f"{sketch}.obj")
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", encoding="utf-8") as job:
        job.write(yaml.safe_dump(asked))
        job.flush()
        return run_job(resolve({"JOB": job.name}), RUNS, THREADS)


def compare(runs: list[Path]) -> list["Agreement"]:
    """Return how alike asset and sketch of each run are."""
    return [agreement(read_ply(run / "mesh.ply"), read_ply(run / "sketch.ply")) for run in runs]


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
    shades = albedo_shade(mesh, texture_of_run(run)), normal_shade(mesh)
    return [picture(mesh, camera(), TILE, shade, 3) for shade in shades]


def sketch_tile(run: Path) -> Float[np.ndarray, "p p 3"]:
    """Return the sketch of a run as normals."""
    mesh = read_ply(run / "sketch.ply")
    return picture(mesh, camera(), TILE, normal_shade(mesh), 3)


def write_pictures(path: Path, rows: list[list[list[Float[np.ndarray, "p p 3"]]]]) -> None:
    """Write rows of equally many pairs of tiles, the second tile of a pair under the first."""
    tiles = [pair[part] for row in rows for part in range(2) for pair in row]
    Image.fromarray(to_bytes(sheet(tiles, len(rows[0])))).save(path, format="PNG", optimize=True)


def main(folder: Path) -> dict[str, Any]:
    """Make the runs, write the pictures into `folder`, return the figures."""
    tables, rows = [], []
    for prompt, sketch in ABLATION:
        made = {seed: [make(prompt, sketch, seed, sigma_s=sigma) for sigma in SIGMAS] for seed in SEEDS}
        runs, seeds = made[SEEDS[0]], {str(seed): compare(folders) for seed, folders in made.items()}
        means = np.mean(list(seeds.values()), axis=0).round(5).T.tolist()
        figures = dict(zip(Agreement._fields, means, strict=True))
        held = [make(prompt, sketch, sigma_s=min(SIGMAS), shape_weight=weight) for weight in WEIGHTS]
        weights = dict(zip(Agreement._fields, map(list, zip(*compare(held), strict=True)), strict=True))
        tables.append({"prompt": prompt, "sketch": sketch, **figures, "seeds": seeds, "weights": weights})
        guide = sketch_tile(runs[0])
        rows.append([[guide, guide], *(tile(run) for run in runs)])
    write_pictures(folder / "sigma-s.png", rows)

    pairs, columns = [], []
    for words, shape in PAIRS:
        guided, free = make(words, shape), make(words)
        target = read_ply(guided / "sketch.ply")
        without, kept = (agreement(read_ply(run / "mesh.ply"), target) for run in (free, guided))
        pairs.append({"prompt": words, "without": without._asdict(), "with": kept._asdict()})
        columns += [[sketch_tile(guided)] * 2, tile(free), tile(guided)]
    write_pictures(folder / "sigma-s-with-and-without.png", [columns])
    return {
        "summary": {
            "sigma": list(SIGMAS),
            **{n: np.mean([t[n] for t in tables], axis=0).round(5).tolist() for n in Agreement._fields},
        },
        "quality": "draft",
        "weights": {
            "weight": list(WEIGHTS),
            **{
                n: np.mean([t["weights"][n] for t in tables], axis=0).round(5).tolist()
                for n in Agreement._fields
            },
        },
        "ablation": tables,
        "with_and_without": pairs,
    }
