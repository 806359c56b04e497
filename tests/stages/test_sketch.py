"""The stage from a user's file to the tables that training reads."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image, ImageDraw

from pipeline.errors import InputError
from pipeline.mesh.mesh import read_ply
from pipeline.options.job import Job
from pipeline.options.nerf import SketchField
from pipeline.run.stage import Context
from pipeline.sketch.lattice import load_sketch, look_up
from pipeline.stages import sketch

SKETCHES = Path(__file__).resolve().parents[2] / "examples" / "sketches"


def run(path: Path, folder: Path, **options: float) -> Context:
    folder.mkdir(exist_ok=True)
    outputs = {"sketch": folder / "sketch.npz", "mesh": folder / "sketch.ply"}
    context = Context(
        Job(prompt="x", sketch_field=SketchField(**{"cells": 32, **options})),
        {"sketch": path},
        outputs,
        folder,
    )
    sketch.main(context)
    return context


def inside(context: Context, *points: tuple[float, float, float]) -> list[bool]:
    found, _ = look_up(load_sketch(context.outputs["sketch"]), np.array(points, np.float32))
    return list(found.tolist())


def test_a_mesh_far_away_and_tiny_is_placed_in_the_scene(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(3, radius=1e-3).apply_translation([0.5, -0.1, 0.2])
    ball.export(tmp_path / "ball.ply")
    context = run(tmp_path / "ball.ply", tmp_path / "run", radius=0.6)
    placed = read_ply(context.outputs["mesh"])
    np.testing.assert_allclose(np.linalg.norm(placed.vertices, axis=1), 0.6, atol=0.03)
    assert inside(context, (0, 0, 0), (0.5, 0, 0), (0.7, 0, 0), (0, -0.9, 0)) == [True, True, False, False]
    assert context.metrics["inside_share"] == pytest.approx(4 / 3 * np.pi * 0.6**3 / 8, rel=0.1)
    assert context.metrics["warnings"] == []


@pytest.mark.parametrize("kind", ["obj", "stl", "off", "glb", "ply"])
def test_every_format_gives_the_same_solid(tmp_path: Path, kind: str) -> None:
    mesh = trimesh.util.concatenate(
        [
            trimesh.creation.box([1, 0.5, 0.4]),
            trimesh.creation.icosphere(2, radius=0.4).apply_translation([0, 0.4, 0]),
        ]
    )
    mesh.export(tmp_path / f"a.{kind}")
    context = run(tmp_path / f"a.{kind}", tmp_path / "run")
    assert inside(context, (0, 0, 0), (0, 0.35, 0), (0.5, 0.35, 0), (0.4, -0.3, 0)) == [
        True,
        True,
        False,
        True,
    ]


def test_a_drawing_is_extruded_its_top_up(tmp_path: Path) -> None:
    image = Image.new("L", (100, 200), 255)
    pen = ImageDraw.Draw(image)
    pen.rectangle([10, 10, 89, 60], fill=0)  # a T
    pen.rectangle([40, 10, 59, 189], fill=0)
    image.save(tmp_path / "t.png")
    context = run(tmp_path / "t.png", tmp_path / "run")
    up, down = (0.22, 0.5, 0.0), (0.22, -0.5, 0.0)
    assert inside(context, up, down, (0, -0.5, 0), (0.0, 0.5, 0.15), (0, 0.5, 0.3)) == [
        True,
        False,
        True,
        True,
        False,
    ]


@pytest.mark.parametrize("path", sorted(SKETCHES.glob("*.obj")), ids=lambda path: path.stem)
def test_the_examples_are_solids(tmp_path: Path, path: Path) -> None:
    context = run(path, tmp_path / "run")
    assert context.metrics["warnings"] == []
    assert 0.01 < context.metrics["inside_share"] < 0.2
    assert path.stat().st_size < 200_000


def test_the_same_mesh_gives_the_same_bytes(tmp_path: Path) -> None:
    house = SKETCHES / "house.obj"
    first, second = (run(house, tmp_path / name) for name in ("a", "b"))
    for name in ("sketch", "mesh"):
        assert first.outputs[name].read_bytes() == second.outputs[name].read_bytes()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.txt", "x", ["a.txt", ".txt", ".obj", ".svg"]),
        ("a", "x", ["missing", ".obj"]),
        ("a.obj", "v 0 0 0\n", ["a.obj"]),
        ("a.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", ["a.obj", "NaN"]),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", ["a.obj", "0 to 8"]),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", ["a.obj", "encloses no space"]),
        ("a.png", "not a picture", ["a.png", "PNG"]),
        ("a.svg", "<svg/>", ["a.svg"]),
    ],
)
def test_faults_are_named(tmp_path: Path, name: str, content: str, words: list[str]) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError) as error:
        run(tmp_path / name, tmp_path / "run")
    assert "\n" not in str(error.value)
    for word in words:
        assert word in str(error.value)


def test_a_stray_part_that_makes_it_small_is_said(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(2)
    stray = trimesh.creation.box([0.1] * 3).apply_translation([9, 0, 0])
    trimesh.util.concatenate([ball, stray]).export(tmp_path / "a.ply")
    assert any(
        "stray" in warning for warning in run(tmp_path / "a.ply", tmp_path / "run").metrics["warnings"]
    )
