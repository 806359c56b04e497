"""Noise of normals is told from shape and from edges; the summary has what counts."""

import numpy as np
import pytest

from benchmarks._relighting import relighting, summarise_relit
from benchmarks.asset import normal_noise, summarise
from pipeline.mesh.mesh import Mesh, vertex_normals
from tests import shapes


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return shapes.mesh_of(shapes.ball(0.6), 64)


def waved(mesh: Mesh, height: float, waves: float) -> Mesh:
    length = np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    change = height * np.sin(waves * mesh.vertices).sum(axis=1, keepdims=True)
    return mesh._replace(vertices=(mesh.vertices * (1 + change / length)).astype(np.float32))


def test_a_surface_has_no_noise_of_its_own_and_waves_are_noise(ball: Mesh) -> None:
    still, low, high = (normal_noise(waved(ball, h, 60), ball, False) for h in (0.0, 0.001, 0.002))
    assert still is not None
    assert low is not None
    assert high is not None
    assert still < 0.01
    assert 1.6 < high / low < 2.4


def test_another_shape_is_no_noise(ball: Mesh) -> None:
    """A pixel sees another place of a longer ball. It counts as a little noise, which hardly grows."""
    noise, error = [], []
    for stretch in (1.02, 1.1):
        longer = ball._replace(vertices=(ball.vertices * [1, stretch, 1]).astype(np.float32))
        found = normal_noise(longer, ball, False)
        assert found is not None
        cosines = (vertex_normals(longer) * vertex_normals(ball)).sum(axis=1)
        noise.append(found)
        error.append(np.degrees(np.sqrt(np.square(np.arccos(np.clip(cosines, -1, 1))).mean())))
    assert noise[1] < 1
    assert noise[1] < 0.5 * error[1]
    assert noise[1] / noise[0] < 0.5 * error[1] / error[0]


def test_the_summary_is_of_all_scenes_that_have_a_figure() -> None:
    row = {
        "noise_before": 4.0, "noise_after": 1.0, "chamfer_before": 0.01, "chamfer_after": 0.011,
        "normal_error_without_map": 2.0, "normal_error_with_map": 0.2, "bytes": 1000, "seconds": 3.0,
    }  # fmt: skip
    nowhere = {**row, "noise_before": None, "noise_after": None, "chamfer_after": 0.005}
    found = summarise([row, nowhere])
    assert found["normal_noise_ratio"] == 0.25
    assert found["worst_chamfer_ratio"] == 1.1
    assert found["scenes"] == 2
    assert summarise([nowhere])["normal_noise_ratio"] is None


def test_an_object_without_its_training_light_is_nearer_to_the_truth_under_another() -> None:
    row = relighting(0)
    assert row["relit_psnr_exact_normals"] > row["relit_psnr_made_normals"] > row["relit_psnr_undivided"] + 3
    assert summarise_relit([row])["relit_worse"] == 0
