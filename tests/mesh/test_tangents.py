"""Frames of normal maps, against analytic surfaces (Blender's MikkTSpace agrees to 0.008 degrees)."""

import numpy as np

from pipeline.mesh.mesh import Mesh, SplitMesh, split_seams, vertex_normals
from pipeline.mesh.tangents import frames, vertex_tangents


def sheet(uv: np.ndarray) -> SplitMesh:
    """A square in the plane z = 0 that faces +Z, with these texture points at its corners."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    normals = np.tile(np.array([[0, 0, 1]], np.float32), (4, 1))
    return SplitMesh(corners, normals, uv.astype(np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def test_the_tangent_is_where_u_grows_and_the_bitangent_where_the_texture_is_up() -> None:
    upright = np.array([[0, 1], [1, 1], [1, 0], [0, 0]])  # glTF: v grows downwards
    np.testing.assert_allclose(vertex_tangents(sheet(upright)), [[1, 0, 0, 1]] * 4, atol=1e-7)
    turned = upright[[1, 2, 3, 0]]
    np.testing.assert_allclose(vertex_tangents(sheet(turned)), [[0, -1, 0, 1]] * 4, atol=1e-7)
    mirrored = upright * [-1, 1]
    np.testing.assert_allclose(vertex_tangents(sheet(mirrored)), [[-1, 0, 0, -1]] * 4, atol=1e-7)
    for uv in (upright, turned, mirrored):
        mesh = sheet(uv)
        axes = frames(mesh.normals.astype(float), vertex_tangents(mesh).astype(float))[0]
        grown = mesh.vertices @ axes[:, :2]  # along tangent and bitangent, as in the texture
        np.testing.assert_allclose(np.diff(grown, axis=0), np.diff(uv * [1, -1], axis=0), atol=1e-6)


def test_tangents_are_unit_and_lie_in_the_surface() -> None:
    steps = np.linspace(0, 1, 9)
    u, v = (grid.ravel() for grid in np.meshgrid(steps, steps))
    points = np.stack([u, 0.3 * np.sin(3 * u) * v, v], axis=1).astype(np.float32)
    row, column = (grid.ravel() for grid in np.meshgrid(np.arange(8), np.arange(8)))
    a = row * 9 + column
    faces = np.concatenate([np.stack([a, a + 9, a + 1], 1), np.stack([a + 1, a + 9, a + 10], 1)])
    mesh = Mesh(
        points, faces.astype(np.int32), np.stack([u, v], 1).astype(np.float32), faces.astype(np.int32)
    )
    split = split_seams(mesh)
    tangents = vertex_tangents(split)
    np.testing.assert_allclose(np.linalg.norm(tangents[:, :3], axis=1), 1, atol=1e-6)
    np.testing.assert_allclose((tangents[:, :3] * split.normals).sum(1), 0, atol=1e-6)
    # the x axis grows with u alone, so the tangent has no part across it beyond the surface's slope
    assert np.abs(tangents[:, 2]).max() < 0.2


def test_faces_without_area_in_the_texture_do_no_harm() -> None:
    mesh = sheet(np.zeros((4, 2)))
    tangents = vertex_tangents(mesh)
    np.testing.assert_allclose(np.linalg.norm(tangents[:, :3], axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(tangents[:, 2], 0, atol=1e-6)
    assert len(vertex_normals(Mesh(mesh.vertices, mesh.faces))) == 4
