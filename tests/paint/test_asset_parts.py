"""The asset has the geometry that was given, to the bit that float32 allows."""

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.mesh.gltf import glb_bytes
from pipeline.mesh.materials import PLAIN
from pipeline.mesh.readers import read_mesh
from pipeline.paint.asset_parts import float32_place, linear_light, painted_obj, painted_parts
from pipeline.paint.given_mesh import PaintMesh


def two_parts(scale: float = 1.0, offset: float = 0.0) -> PaintMesh:
    """A square cut into two parts along its diagonal; the texture has a seam inside one of them."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.2, 0]]) * scale + offset
    faces = np.array([[0, 1, 4], [1, 2, 4], [0, 2, 3]], np.int32)
    uv = np.random.default_rng(0).random((7, 2))
    uv_faces = np.array([[0, 1, 2], [1, 3, 4], [0, 5, 6]], np.int32)  # vertex 4 has two texture points
    return PaintMesh(
        corners, corners, faces, np.array([0, 0, 1], np.int32), ("ä lower", "upper"), uv, uv_faces
    )


def glb(mesh: PaintMesh, colours: np.ndarray | None = None) -> trimesh.Scene:
    png = io.BytesIO()
    Image.new("RGB", (4, 4), (200, 10, 10)).save(png, format="PNG")
    place = float32_place(mesh.vertices)
    parts = painted_parts(mesh, place, colours)
    image = png.getvalue() if colours is None else None
    data = glb_bytes(parts, image, PLAIN, translation=place, double_sided=True)
    return trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False)


def world_triangles(scene: trimesh.Scene) -> np.ndarray:
    """Return all triangles in the scene's coordinates, float64, by part in order of name."""
    found = []
    for node in sorted(scene.graph.nodes_geometry):
        transform, name = scene.graph[node]
        part = scene.geometry[name]
        found.append(part.vertices.astype(np.float64)[part.faces] + transform[:3, 3])
    return np.concatenate(found)


@pytest.mark.parametrize(("scale", "offset"), [(1, 0), (1e-3, 1e6), (1e12, 0), (1e-12, 0), (100, 3000)])
def test_the_surface_is_the_one_given(scale: float, offset: float) -> None:
    mesh = two_parts(scale, offset)
    scene = glb(mesh)
    expected = mesh.vertices[mesh.faces[[2, 0, 1]]]  # "upper" sorts before the umlaut
    order = sorted(scene.graph.nodes_geometry)
    assert sorted(mesh.names) == order
    expected = mesh.vertices[mesh.faces][np.argsort([mesh.names[p] for p in mesh.part], kind="stable")]
    assert np.abs(world_triangles(scene) - expected).max() <= 2.0**-22 * scale


def test_positions_that_float32_holds_are_bit_identical() -> None:
    mesh = two_parts()
    assert float32_place(mesh.vertices) == (0, 0, 0)
    assert float32_place(mesh.vertices * 1e-3 + 1e6) != (0, 0, 0)
    (lower, upper) = painted_parts(mesh, (0.0, 0.0, 0.0), None)
    np.testing.assert_array_equal(
        lower.vertices[lower.faces], mesh.vertices[mesh.faces[:2]].astype(np.float32)
    )
    assert (len(lower.vertices), len(upper.vertices)) == (5, 3), "only the vertex on the seam is repeated"


def test_obj_keeps_every_digit_and_the_parts(tmp_path: Path) -> None:
    mesh = two_parts(1e-3, 1e6)
    (tmp_path / "a.obj").write_text(painted_obj(mesh, "a.mtl", None), encoding="utf-8")
    again = read_mesh(tmp_path / "a.obj")
    np.testing.assert_array_equal(again.vertices, mesh.vertices)
    np.testing.assert_array_equal(again.faces, mesh.faces)
    np.testing.assert_array_equal(again.part, mesh.part)
    assert again.names == mesh.names
    assert mesh.uv is not None
    assert again.uv is not None
    np.testing.assert_allclose(again.uv[again.uv_faces], mesh.uv[mesh.uv_faces], atol=1e-8)


def test_a_colour_a_face_is_a_vertex_colour(tmp_path: Path) -> None:
    mesh = two_parts()._replace(uv=None, uv_faces=None)
    colours = np.array([[1, 0, 0], [0.5, 0.5, 0.5], [1, 0, 0]])
    lower, upper = painted_parts(mesh, (0.0, 0.0, 0.0), colours)
    assert lower.colours is not None
    assert (len(lower.vertices), len(upper.vertices)) == (6, 3)
    assert lower.colours is not None
    np.testing.assert_allclose(lower.colours[lower.faces[1]], 0.214, atol=1e-3)  # linear light
    scene = glb(mesh, colours)
    assert {len(part.faces) for part in scene.geometry.values()} == {1, 2}
    text = painted_obj(mesh, None, colours)
    assert "mtllib" not in text
    assert "v 0.5 0.2 0.0 0.5000 0.5000 0.5000" in text
    (tmp_path / "a.obj").write_text(text, encoding="utf-8")
    again = read_mesh(tmp_path / "a.obj")
    np.testing.assert_array_equal(again.vertices[again.faces], mesh.vertices[mesh.faces])


def test_linear_light_is_the_standard_curve() -> None:
    given = np.array([[0.0, 1.0, 0.04045]])
    np.testing.assert_allclose(linear_light(given), [[0, 1, 0.0031308]], atol=1e-6)
