import os
import signal
import time

import numpy as np
import pytest
from scipy.ndimage import label
from scipy.spatial import cKDTree

from pipeline.errors import InputError
from pipeline.mesh import unwrap
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.texture import surface_texels
from pipeline.mesh.unwrap import longest_rim, unwrap_mesh, uv_figures
from tests import shapes


@pytest.fixture(scope="module")
def chair() -> Mesh:
    return shapes.mesh_of(shapes.chair(), 40)


def test_charts_lie_inside_the_texture_and_do_not_overlap(chair: Mesh) -> None:
    mesh, figures = unwrap_mesh(chair, 512, 4)
    assert mesh.uv is not None
    assert mesh.uv_faces is not None
    np.testing.assert_array_equal(mesh.vertices, chair.vertices)
    np.testing.assert_array_equal(mesh.faces, chair.faces)
    assert mesh.uv.min() >= 0
    assert mesh.uv.max() <= 1
    assert figures["overlap"] == 0
    assert figures["coverage"] > 0.34
    assert figures["charts"] >= 6
    assert 1 <= figures["stretch"] < 1.1
    assert figures["degenerate_faces"] == 0


def test_padding_is_kept_between_charts(chair: Mesh) -> None:
    """Two texels of different charts, hence of faces without a common texture point, are never close."""
    mesh, _ = unwrap_mesh(chair, 512, 6)
    assert mesh.uv is not None
    assert mesh.uv_faces is not None
    mask = surface_texels(mesh, 512).mask
    islands, count = label(mask, np.ones((3, 3)))
    assert count >= 6
    rows, columns = np.nonzero(mask)
    pairs = cKDTree(np.c_[rows, columns]).query_pairs(5.0, output_type="ndarray")
    of = islands[rows, columns]
    assert (of[pairs[:, 0]] == of[pairs[:, 1]]).all()


def polygon(corners: int, height: float) -> Mesh:
    turn = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    vertices = np.stack([np.cos(turn), np.sin(turn), np.full(corners, height)], axis=1).astype(np.float32)
    fan = np.stack([np.zeros(corners - 2), np.arange(1, corners - 1), np.arange(2, corners)], axis=1)
    return Mesh(vertices, fan.astype(np.int32))


def test_the_longest_rim_is_one_charts_own() -> None:
    faces = np.concatenate([polygon(9, 0).faces, polygon(5, 0).faces + 9]).astype(np.int32)
    assert longest_rim(faces, 14) == 9


def test_polygons_of_many_corners_are_packed_with_the_padding_of_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Past RIM xatlas filters no texels of theirs, which took minutes; apart they lie all the same."""
    one, other = polygon(300, 0), polygon(300, 1)
    both = Mesh(
        np.concatenate([one.vertices, other.vertices]), np.concatenate([one.faces, other.faces + 300])
    )
    for rim in (unwrap.RIM, 299):
        monkeypatch.setattr(unwrap, "RIM", rim)
        mesh, figures = unwrap_mesh(both, 256, 6)
        assert (figures["charts"], figures["padding"], figures["overlap"]) == (2, 6, 0)
        mask = surface_texels(mesh, 256).mask
        islands, count = label(mask, np.ones((3, 3)))
        assert count == 2
        apart = cKDTree(np.argwhere(islands == 1)).query(np.argwhere(islands == 2))[0].min()
        assert apart > 5


def test_same_input_same_bytes(chair: Mesh) -> None:
    first, second = (unwrap_mesh(chair, 256, 4)[0] for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert a is not None
        assert b is not None
        assert a.tobytes() == b.tobytes()


def square(uv: list[list[float]]) -> Mesh:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(vertices, faces, np.array(uv, np.float32), faces)


def test_figures_of_a_square() -> None:
    same = uv_figures(square([[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]]), 64)
    assert same["coverage"] == 0.25
    assert same["stretch"] == pytest.approx(1)
    assert same["texels_per_unit"] == pytest.approx(32)
    assert same["overlap"] == 0
    squeezed = uv_figures(square([[0, 0], [1, 0], [1, 0.25], [0, 0.25]]), 64)
    # Singular values 1 and 4, area ratio 1/4: sqrt((1 + 16) / 2 / 4).
    assert squeezed["stretch"] == pytest.approx(np.sqrt(17 / 8))
    folded = uv_figures(square([[0, 0], [1, 0], [1, 1], [1, 0]]), 64)
    assert folded["overlap"] > 0.9


def test_padding_gives_way_when_the_charts_need_the_room() -> None:
    mesh, figures = unwrap_mesh(shapes.mesh_of(shapes.chair(), 24), 64, 40)
    assert mesh.uv is not None
    assert 1 <= figures["padding"] < 40
    assert figures["overlap"] == 0


def test_a_texture_too_small_for_the_charts_is_refused() -> None:
    with pytest.raises(InputError, match=r"do not fit.*unwrap\.resolution"):
        unwrap_mesh(shapes.mesh_of(shapes.chair(), 24), 8, 4)


def test_small_things_far_apart_have_charts() -> None:
    """Each face is smaller than xatlas sees: it made no chart, and a division by their number."""
    corners = np.array([[0, 0, 0], [1e-4, 0, 0], [0, 1e-4, 0]])
    vertices = np.concatenate([corners, corners + np.array([1, 0, 0])])
    made, metrics = unwrap_mesh(Mesh(vertices, np.arange(6, dtype=np.int32).reshape(2, 3)), 128, 2)
    assert metrics["charts"] == 2
    assert made.uv is not None
    assert np.isfinite(made.uv).all()
    assert metrics["coverage"] > 0.2
    with pytest.raises(InputError, match="none of 2 faces has an area"):
        unwrap_mesh(made._replace(vertices=vertices * 0), 128, 2)


def test_no_atlas_is_destroyed_right_after_its_work() -> None:
    # Its threads may not yet wait for work, and would then be waited for without end.
    unwrap._recent.clear()
    unwrap_mesh(shapes.mesh_of(shapes.ball(0.5), 12), 128, 2)
    assert len(unwrap._recent) >= 2, "charts are cut in one, packed in others"
    assert all(atlas.chart_count for atlas in unwrap._recent)


def test_a_fork_does_not_wait_for_the_threads_of_its_parent() -> None:
    mesh = shapes.mesh_of(shapes.ball(0.5), 12)
    unwrap_mesh(mesh, 128, 2)
    assert unwrap._recent
    child = os.fork()
    if child == 0:
        try:
            unwrap._recent.clear()  # what sixteen more atlases would do
            unwrap_mesh(mesh, 128, 2)
            os._exit(0)
        finally:
            os._exit(1)
    ended, until = 0, time.monotonic() + 60
    while not ended and time.monotonic() < until:
        ended, status = os.waitpid(child, os.WNOHANG)
        time.sleep(0.01)
    if not ended:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        pytest.fail("the fork waits for ever")
    assert os.waitstatus_to_exitcode(status) == 0
