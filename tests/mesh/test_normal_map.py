"""A ball of few faces that looks like one of many, and a flat map where nothing is to show."""

import numpy as np
import pytest

from pipeline.mesh.mesh import Mesh, split_seams, vertex_normals
from pipeline.mesh.normal_map import normal_map
from pipeline.mesh.texture import surface_texels
from pipeline.mesh.unwrap import unwrap_mesh
from pipeline.stages.clean import decimate
from tests import shapes


def bumpy(radius: float = 0.5) -> Mesh:
    """A ball with waves that 300 faces cannot follow."""
    ball = shapes.mesh_of(shapes.ball(radius), 64)
    away = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    waves = 1 + 0.02 * np.sin(12 * away[:, :1]) * np.sin(12 * away[:, 1:2])
    return ball._replace(vertices=(radius * away * waves).astype(np.float32))


@pytest.fixture(scope="module")
def fine() -> Mesh:
    return bumpy()


@pytest.fixture(scope="module")
def coarse(fine: Mesh) -> Mesh:
    return unwrap_mesh(decimate(fine, 300), 256, 4)[0]


def test_the_map_shows_what_decimation_lost(fine: Mesh, coarse: Mesh) -> None:
    image, errors = normal_map(coarse, split_seams(coarse), fine, 256, 8)
    assert errors["error_without"] > 5
    assert errors["error_with"] < 0.5  # eight bits
    assert image.shape == (256, 256, 3)
    assert image.dtype == np.uint8
    texels = surface_texels(coarse, 256)
    assert (image.reshape(-1, 3)[texels.place, 2] > 128).all(), "no normal points inwards"
    again, _ = normal_map(coarse, split_seams(coarse), fine, 256, 8)
    np.testing.assert_array_equal(image, again)


def test_the_surface_itself_gives_a_flat_map(coarse: Mesh) -> None:
    image, errors = normal_map(coarse, split_seams(coarse), coarse, 256, 8)
    assert errors["error_without"] < 0.1
    assert np.abs(image.astype(int) - [128, 128, 255]).max() <= 1


def test_the_other_side_of_a_thin_wall_is_not_taken(coarse: Mesh) -> None:
    inside_out = Mesh(coarse.vertices, coarse.faces[:, ::-1].copy())
    assert (vertex_normals(inside_out) * vertex_normals(coarse)).sum(1).max() < 0
    image, _ = normal_map(coarse, split_seams(coarse), inside_out, 256, 8)
    assert np.abs(image.astype(int) - [128, 128, 255]).max() <= 1
