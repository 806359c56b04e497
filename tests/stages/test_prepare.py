"""The user's mesh made ready: coordinates kept or made, any scale and place, hostile shapes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from pipeline.mesh.coordinates import uv_fault
from pipeline.mesh.mesh import Mesh, face_areas
from pipeline.options.job import Job
from pipeline.options.paint import Prepare
from pipeline.paint.given_mesh import PaintMesh, load_paint_mesh
from pipeline.run.stage import Context
from pipeline.stages import prepare

SQUARE = """
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt {a} {a}
vt {b} {a}
vt {b} {b}
vt {a} {b}
f 1/1 2/2 3/3
f 1/{c} 3/3 4/4
"""


def run(
    folder: Path, text: str | bytes, name: str = "a.obj", **options: Any
) -> tuple[PaintMesh, dict[str, Any]]:
    folder.mkdir(exist_ok=True)
    source, out = folder / name, folder / "mesh.npz"
    source.write_bytes(text if isinstance(text, bytes) else text.encode())
    param = options.pop("param", "texture")
    job = Job(prompt="x", mesh=str(source), param=param, prepare=Prepare(resolution=128, **options))
    context = Context(job, {"mesh": source}, {"mesh": out}, folder)
    prepare.main(context)
    return load_paint_mesh(out), context.metrics


def box_obj(scale: float = 1.0, offset: float = 0.0) -> str:
    box = trimesh.creation.box((1.0, 0.7, 0.4))
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (box.vertices * scale + offset).tolist()]
    return "\n".join(lines + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in box.faces.tolist()]) + "\n"


def test_good_coordinates_are_kept(tmp_path: Path) -> None:
    mesh, metrics = run(tmp_path, SQUARE.format(a=0, b=1, c=1))
    assert metrics["uv"] == "the file's"
    assert metrics["warnings"] == []
    assert mesh.uv is not None
    assert sorted(map(tuple, mesh.uv.tolist())) == [(0, 0), (0, 1), (1, 0), (1, 1)]


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (SQUARE.format(a=0, b=3, c=1), "outside"),
        (SQUARE.format(a=0, b=1, c=2), "several"),
        (SQUARE.format(a=0.5, b=0.5, c=1), "no area"),
        (SQUARE.format(a=0.5, b=0.6, c=1), "use"),
        (SQUARE.format(a="nan", b=1, c=1), "NaN"),
        (box_obj(), "none"),
    ],
)
def test_others_are_made_anew_and_said(tmp_path: Path, text: str, word: str) -> None:
    mesh, metrics = run(tmp_path, text)
    assert metrics["uv"] == "new (xatlas)"
    assert word in metrics["uv_reason"]
    assert any("new texture coordinates" in line for line in metrics["warnings"]) == ("vt" in text)
    assert uv_fault(mesh.scaled(1.0), 128) == ""


def test_scale_and_offset_do_not_matter(tmp_path: Path) -> None:
    plain, _ = run(tmp_path / "a", box_obj())
    moved, _ = run(tmp_path / "b", box_obj(1e-3, 1e6))
    np.testing.assert_array_equal(plain.unit, moved.unit)
    np.testing.assert_array_equal(plain.uv, moved.uv)
    assert np.abs(moved.vertices - 1e6).max() < 1e-3, "the file's own positions are kept"
    assert np.linalg.norm(plain.unit, axis=1).max() == pytest.approx(1, abs=1e-4)


def test_axes_can_be_told(tmp_path: Path) -> None:
    plain, _ = run(tmp_path / "a", box_obj())
    turned, _ = run(tmp_path / "b", box_obj(), up="+z", front="-y")
    np.testing.assert_array_equal(turned.unit, plain.unit[:, [0, 2, 1]] * [1, 1, -1])


def test_faces_without_area_and_duplicates_and_open_surfaces_are_painted_too(tmp_path: Path) -> None:
    text = box_obj() + "v 5 0 0\nv 6 0 0\nv 5 1 0\nf 9 10 11\nf 9 10 11\nf 9 11 10\nf 9 9 10\nf 9 10 10\n"
    mesh, metrics = run(tmp_path, text)
    assert metrics["faces_without_area"] == 2
    assert len(mesh.faces) == 17
    assert not metrics["watertight"]
    assert mesh.uv is not None
    assert np.isfinite(mesh.uv).all()


def test_thousands_of_the_same_face_are_unwrapped_once(tmp_path: Path) -> None:
    """xatlas would take a minute, and make a chart of each."""
    mesh, metrics = run(tmp_path, box_obj() + "f 1 2 3\n" * 5000)
    assert len(mesh.faces) == 5012
    assert metrics["faces_twice"] >= 4999
    assert metrics["charts"] <= 7


def test_a_soup_of_triangles_shares_charts(tmp_path: Path) -> None:
    """Vertices that a file repeats are one for xatlas: a cube has 6 sides, not 12 triangles."""
    box = trimesh.creation.box()
    soup = trimesh.Trimesh(box.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    mesh, metrics = run(tmp_path, soup.export(file_type="ply"), "a.ply")
    assert metrics["charts"] <= 6
    area = face_areas(Mesh(np.c_[mesh.uv, np.zeros(len(mesh.uv))], mesh.uv_faces))
    assert (area > 0).all()


def test_one_colour_a_face_needs_no_coordinates(tmp_path: Path) -> None:
    mesh, metrics = run(tmp_path, box_obj(), param="face")
    assert mesh.uv is None
    assert "charts" not in metrics
