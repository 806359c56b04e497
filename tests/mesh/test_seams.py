"""Seams by construction: a strip of two squares whose charts lie apart in the texture."""

import numpy as np
import pytest

from pipeline.mesh.bilinear import sample
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.seams import find_seams, seam_jump

# Two squares side by side, the second one's vertices repeated, as glTF files have them.
VERTICES = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0]], np.float64
)
FACES = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)


def strip(apart: float) -> Mesh:
    left = VERTICES[:4, :2] * 0.25
    right = VERTICES[4:, :2] * 0.25 + [apart, 0]
    return Mesh(VERTICES, FACES, np.concatenate([left, right]), FACES)


def test_an_edge_with_two_places_in_the_texture_is_a_seam() -> None:
    assert len(find_seams(strip(0.0)).length) == 0
    seams = find_seams(strip(0.5))
    assert seams.length.tolist() == [1.0]
    shared = 1 + 2 * np.sqrt(2)  # the seam and both diagonals
    assert seams.share == pytest.approx(1 / shared)
    np.testing.assert_allclose(seams.first[0] + [0.5, 0], seams.second[0])


def test_the_jump_is_the_difference_of_the_colours() -> None:
    seams = find_seams(strip(0.5))
    texture = np.zeros((32, 32, 3), np.float32)
    texture[:, 16:] = [0.3, 0.3, 0.3]
    assert seam_jump(seams, texture) == pytest.approx(0.3, abs=1e-6)
    assert seam_jump(find_seams(strip(0.0)), texture) == 0
    repeated = np.tile(np.random.default_rng(0).random((32, 16, 3)), (1, 2, 1))
    assert seam_jump(seams, repeated) == pytest.approx(0, abs=1e-7)


def test_lookups_are_bilinear_and_clamped() -> None:
    texture = np.arange(4, dtype=np.float64).reshape(2, 2, 1)
    points = np.array([[0.25, 0.25], [0.75, 0.25], [0.5, 0.5], [0.0, 0.0], [1.0, 1.0]])
    assert sample(texture, points)[:, 0].tolist() == [0, 1, 1.5, 0, 3]
