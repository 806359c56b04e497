from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from pipeline.errors import InputError
from pipeline.mesh.mesh import (
    Mesh,
    bounding_radius,
    check_mesh,
    face_areas,
    read_obj,
    read_ply,
    split_seams,
    vertex_normals,
    write_obj,
    write_ply,
)
from pipeline.mesh.unwrap import unwrap_mesh
from tests import shapes


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return unwrap_mesh(shapes.mesh_of(shapes.ball(0.5), 24), 256, 4)[0]


def test_ply_keeps_every_bit(ball: Mesh, tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", ball)
    again = read_ply(tmp_path / "a.ply")
    np.testing.assert_array_equal(again.vertices, ball.vertices)
    np.testing.assert_array_equal(again.faces, ball.faces)
    write_ply(tmp_path / "b.ply", again)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def test_obj_keeps_positions_connectivity_and_texture(ball: Mesh, tmp_path: Path) -> None:
    write_obj(tmp_path / "a.obj", ball)
    again = read_obj(tmp_path / "a.obj")
    np.testing.assert_array_equal(again.vertices, ball.vertices)
    np.testing.assert_array_equal(again.faces, ball.faces)
    np.testing.assert_array_equal(again.uv_faces, ball.uv_faces)
    np.testing.assert_allclose(again.uv, ball.uv, rtol=0, atol=1e-7)
    write_obj(tmp_path / "b.obj", again)
    assert (tmp_path / "a.obj").read_bytes() == (tmp_path / "b.obj").read_bytes()


def test_obj_is_flipped_as_other_programs_expect(ball: Mesh, tmp_path: Path) -> None:
    write_obj(tmp_path / "a.obj", ball, "a.mtl", normals=True)
    (tmp_path / "a.mtl").write_text("newmtl albedo\n")
    loaded = trimesh.load_mesh(tmp_path / "a.obj", process=False)
    split = split_seams(ball)
    order = np.lexsort(np.round(np.c_[split.vertices, split.uv], 6).T)
    visual: Any = loaded.visual
    theirs = np.c_[loaded.vertices, visual.uv[:, 0], 1 - visual.uv[:, 1]]
    theirs = theirs[np.lexsort(np.round(theirs, 6).T)]
    np.testing.assert_allclose(theirs, np.c_[split.vertices, split.uv][order], atol=2e-6)


def test_seams_repeat_vertices_and_nothing_else(ball: Mesh) -> None:
    split = split_seams(ball)
    np.testing.assert_array_equal(split.vertices[split.faces], ball.vertices[ball.faces])
    assert ball.uv is not None
    np.testing.assert_array_equal(split.uv[split.faces], ball.uv[ball.uv_faces])
    assert len(ball.vertices) < len(split.vertices) <= ball.faces.size
    assert len(np.unique(np.c_[split.vertices, split.uv], axis=0)) == len(split.vertices)
    # A normal belongs to the place, not to the copy.
    _, inverse = np.unique(split.vertices, axis=0, return_inverse=True)
    first = np.zeros((inverse.max() + 1, 3), np.float32)
    first[inverse] = split.normals
    np.testing.assert_array_equal(first[inverse], split.normals)


def test_normals_of_a_ball_point_outwards(ball: Mesh) -> None:
    normals = vertex_normals(ball)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, rtol=1e-12)
    radial = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    assert (normals * radial).sum(axis=1).min() > 0.98


def test_normals_without_direction_point_up() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 1]], np.int32)
    np.testing.assert_array_equal(vertex_normals(Mesh(vertices, faces)), np.tile([0.0, 1.0, 0.0], (4, 1)))


def test_area_of_a_ball(ball: Mesh) -> None:
    assert face_areas(ball).sum() == pytest.approx(4 * np.pi * 0.25, rel=0.01)


TRIANGLE = np.array([[0, 1, 2]], np.int32)
PLACES = np.eye(3, dtype=np.float32)


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        (Mesh(PLACES, TRIANGLE[:0]), "no faces"),
        (Mesh(np.where(np.eye(3), np.float32(np.nan), PLACES), TRIANGLE), "3 vertices are NaN"),
        (Mesh(PLACES, TRIANGLE + 1), "from 1 to 3, expected 0 to 2"),
        (Mesh(PLACES, TRIANGLE - 1), "from -1 to 1"),
    ],
)
def test_bad_meshes_are_refused(mesh: Mesh, words: str) -> None:
    with pytest.raises(InputError, match=f"here: .*{words}"):
        check_mesh(mesh, "here")


@pytest.mark.parametrize("content", [b"", b"<html>", b"ply\nformat binary_little_endian 1.0\nend_header\n"])
def test_files_that_are_no_ply_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.ply"):
        read_ply(tmp_path / "a.ply")


@pytest.mark.parametrize(
    "content", ["", "v 1 2 x\n", "v 0 0 0\nf 1/1 1/1 1/1\n", "v 0 0 0\nvt 0 0\nf 1 1 1\n"]
)
def test_files_that_are_no_textured_obj_are_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "a.obj").write_text(content)
    with pytest.raises(InputError, match=r"a\.obj"):
        read_obj(tmp_path / "a.obj")


def test_a_vertex_that_no_face_uses_is_not_seen(ball: Mesh) -> None:
    stray = ball._replace(vertices=np.concatenate([ball.vertices, [[100, 0, 0]]]).astype(np.float32))
    assert bounding_radius(stray) == bounding_radius(ball)
