"""Waves go, edges and places stay."""

import numpy as np
import pytest

from pipeline.mesh.denoise import denoise
from pipeline.mesh.mesh import Mesh, face_normals
from pipeline.stages.clean import decimate
from tests import shapes


def wavy(mesh: Mesh, height: float = 0.004) -> Mesh:
    """Return the mesh with waves as long as a few of its faces."""
    waves = height * np.sin(70 * mesh.vertices).sum(axis=1, keepdims=True)
    away = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    return mesh._replace(vertices=(mesh.vertices + waves * away).astype(np.float32))


def unit_normals(mesh: Mesh) -> np.ndarray:
    normals = face_normals(mesh)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def angle_to_ball(mesh: Mesh) -> float:
    """Return the mean angle between the faces of a ball around the origin and the ball [degrees]."""
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    away = middle / np.linalg.norm(middle, axis=1, keepdims=True)
    return float(np.degrees(np.arccos(np.clip((unit_normals(mesh) * away).sum(1), -1, 1))).mean())


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return decimate(shapes.mesh_of(shapes.ball(0.5), 64), 8000)


def test_waves_of_a_ball_are_taken_out_and_its_size_stays(ball: Mesh) -> None:
    noisy = wavy(ball)
    smooth = denoise(noisy, 0.08, 20)
    assert angle_to_ball(smooth) < 0.3 * angle_to_ball(noisy)
    assert np.linalg.norm(smooth.vertices, axis=1).mean() == pytest.approx(0.5, abs=0.003)
    np.testing.assert_array_equal(smooth.faces, noisy.faces)


def test_edges_of_a_box_stay_sharp() -> None:
    box = decimate(shapes.mesh_of(shapes.box((0.4, 0.3, 0.35)), 64), 8000)
    smooth = denoise(wavy(box, 0.002), 0.08, 15)
    steepness = np.abs(unit_normals(smooth)).max(axis=1)  # 1 on the sides, 0.7 on a rounded edge
    assert np.mean(steepness > 0.99) > 0.9
    sides = np.abs(smooth.vertices).max(axis=0)
    np.testing.assert_allclose(sides, np.abs(box.vertices).max(axis=0), atol=0.01)


def test_nothing_is_done_without_reach_and_the_same_is_done_twice(ball: Mesh) -> None:
    assert denoise(ball, 0, 10) is ball
    first, second = (denoise(wavy(ball), 0.03, 10) for _ in range(2))
    np.testing.assert_array_equal(first.vertices, second.vertices)


def test_borders_and_edges_of_three_faces_do_no_harm() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]], np.float32)
    fan = Mesh(corners, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]], np.int32))
    assert np.isfinite(denoise(fan, 1.0, 20).vertices).all()
