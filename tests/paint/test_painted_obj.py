"""A painted OBJ comes back line by line; only texture points, corners and the library are others."""

from pathlib import Path

import numpy as np
import trimesh

from pipeline.mesh.gltf import glb_bytes
from pipeline.mesh.materials import PLAIN
from pipeline.mesh.obj_reader import parse_obj
from pipeline.mesh.readers import read_mesh
from pipeline.paint.asset_parts import Normals, painted_obj, painted_parts
from pipeline.paint.given_mesh import PaintMesh
from pipeline.paint.painted_obj import material_names, repainted_obj

GIVEN = """# made by hand
mtllib old.mtl
o seat of the chair
g top front
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0.5 2 0
vt 0 0
vn 0 0 1
vn 0 0.6 0.8
usemtl red leather
s 1
f 1/1/1 2/1/1 3/1/2 4/1/2
g back
usemtl wood
s off
f -2//-1 -3//2 -1//2  # the gable
l 1/1 2/1
"""


def test_everything_else_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(GIVEN)
    uv = np.array([[0, 0], [0.5, 0], [0.5, 0.5], [0, 0.5], [0.9, 0.9], [0.7, 0.9], [0.8, 0.6]])
    uv_faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]])
    text = repainted_obj(path, uv, uv_faces, "asset.mtl")
    kept = [line for line in GIVEN.splitlines() if line.split()[0] not in ("f", "l", "vt", "mtllib")]
    assert [line for line in text.splitlines() if line.split()[0] not in ("f", "l", "vt", "mtllib")] == kept
    faces = [line for line in text.splitlines() if line.startswith("f ")]
    assert faces == ["f 1/1/1 2/2/1 3/3/2 4/4/2", "f -2/5/-1 -3/6/2 -1/7/2"]  # the square is still one
    assert "l 1 2" in text.splitlines()
    assert text.startswith("mtllib asset.mtl\n")
    assert "old.mtl" not in text
    assert material_names(path) == ["red leather", "wood"]
    (tmp_path / "b.obj").write_text(text)
    one, other = parse_obj(path), parse_obj(tmp_path / "b.obj")
    for name in ("vertices", "faces", "part", "normals", "normal_faces"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_allclose(other.uv[other.uv_faces], (uv * [1, -1] + [0, 1])[uv_faces])


def test_a_polygon_in_two_charts_becomes_its_triangles(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    text = repainted_obj(path, np.random.default_rng(0).random((6, 2)), np.arange(6).reshape(2, 3), "m.mtl")
    lines = text.splitlines()
    assert lines[-2:] == ["f 1/1 2/2 3/3", "f 1/4 3/5 4/6"]
    assert lines[-3] == "usemtl albedo"


def test_normals_of_a_ply_are_kept(tmp_path: Path) -> None:
    """Normals that no program would make up, so that they can only be the file's."""
    ball = trimesh.creation.icosphere(subdivisions=1)
    odd = np.tile([[0.6, 0.0, -0.8]], (len(ball.vertices), 1))
    rows = [f"{x!r} {y!r} {z!r} 0.6 0 -0.8" for x, y, z in ball.vertices.astype(float).tolist()]
    rows += [f"3 {a} {b} {c}" for a, b, c in ball.faces.tolist()]
    properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    (tmp_path / "ball.ply").write_text(
        f"ply\nformat ascii 1.0\nelement vertex {len(ball.vertices)}\n{properties}"
        f"element face {len(ball.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
        + "\n".join(rows)
        + "\n"
    )
    given = read_mesh(tmp_path / "ball.ply")
    assert given.normals is not None
    assert given.normal_faces is not None
    np.testing.assert_allclose(given.normals, odd)
    uv = np.random.default_rng(0).random((len(given.vertices), 2))
    mesh = PaintMesh(given.vertices, given.vertices, given.faces, given.part, given.names, uv, given.faces)
    normals = Normals(given.normals, given.normal_faces)
    (part,) = painted_parts(mesh, (0.0, 0.0, 0.0), None, normals)
    assert part.normals is not None
    np.testing.assert_allclose(part.normals, odd[: len(part.normals)], atol=1e-7)
    assert glb_bytes([part], None, PLAIN).count(b'"NORMAL"') == 1
    (tmp_path / "asset.obj").write_text(painted_obj(mesh, None, None, normals))
    again = read_mesh(tmp_path / "asset.obj")
    assert again.normals is not None
    np.testing.assert_allclose(
        again.normals[again.normal_faces].reshape(-1, 3), odd[:1].repeat(3 * len(mesh.faces), 0)
    )
    coloured = painted_obj(mesh, None, np.zeros((len(mesh.faces), 3)), normals)
    assert "f 1//1 " in coloured


def test_a_ply_without_normals_gets_none(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(trimesh.creation.box().export(file_type="ply", vertex_normal=False))
    assert read_mesh(tmp_path / "a.ply").normals is None


def test_broken_normals_of_an_obj_are_left_out(tmp_path: Path) -> None:
    for number, line in enumerate(("vn a b c", "vn 0 1", "vn nan 0 0", "")):
        path = tmp_path / f"{number}.obj"
        path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{line}\nf 1//1 2//1 3//1\n")
        assert read_mesh(path).normals is None
