from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.mesh.mesh import Mesh
from pipeline.mesh.unwrap import unwrap_mesh
from pipeline.report.preview import (
    BACKDROP,
    GAP,
    albedo_shade,
    normal_shade,
    picture,
    preview,
    sheet,
    turn,
)
from pipeline.report.turntable import write_turntable
from tests import shapes


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return unwrap_mesh(shapes.mesh_of(shapes.ball(0.6), 24), 128, 2)[0]


RED = np.broadcast_to(np.array([0.8, 0.1, 0.1], np.float32), (16, 16, 3))


def test_a_red_ball_on_the_backdrop(ball: Mesh) -> None:
    image = picture(ball, turn(ball, 1)[0], 48, albedo_shade(ball, RED), 3)
    np.testing.assert_allclose(image[24, 24], RED[0, 0], atol=1e-5)
    np.testing.assert_allclose(image[0, 0], BACKDROP, atol=1e-6)
    edge = (image[..., 1] > 0.2) & (image[..., 1] < BACKDROP - 0.1)
    assert 50 < edge.sum() < 400, "the outline is anti-aliased"
    share = (image[..., 1] < 0.5).mean()
    radius = np.sin(np.radians(17.5)) / 1.02  # of the tangent cone that just fills the view
    expected = np.pi / 4 * (np.tan(np.arcsin(radius)) / np.tan(np.radians(17.5))) ** 2
    assert share == pytest.approx(expected, rel=0.03)


def test_normals_are_shown_in_the_frame_of_the_camera(ball: Mesh) -> None:
    for camera in turn(ball, 4):
        image = picture(ball, camera, 48, normal_shade(ball), 1)
        np.testing.assert_allclose(image[24, 24], [0.5, 0.5, 1.0], atol=0.06)
        assert image[24, 44, 0] > 0.8
        assert image[4, 24, 1] > 0.8


def test_the_sheet_shows_the_views_in_order(ball: Mesh) -> None:
    tiles = [np.full((4, 4, 3), value / 10, np.float32) for value in range(6)]
    page = sheet(tiles, 4)
    assert page.shape == (2 * (4 + GAP) + GAP, 4 * (4 + GAP) + GAP, 3)
    assert page[GAP, GAP, 0] == 0
    assert page[GAP, GAP + 4 + GAP, 0] == np.float32(0.1)
    assert page[GAP + 4 + GAP, GAP, 0] == np.float32(0.4)
    assert page[0, 0, 0] == np.float32(BACKDROP)
    assert preview(ball, albedo_shade(ball, RED), 16).shape == (3 * (16 + GAP) + GAP, 4 * (16 + GAP) + GAP, 3)


def test_turntable_plays_and_shows_the_object(ball: Mesh, tmp_path: Path) -> None:
    told: list[int] = []
    write_turntable(tmp_path / "a.mp4", ball, albedo_shade(ball, RED), 63, 5, told.append)
    assert told == [1, 2, 3, 4, 5]
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(frames) == 5
    for frame in frames:
        assert frame.shape == (64, 64, 3)
        np.testing.assert_allclose(frame[32, 32] / 255, RED[0, 0], atol=0.06)
        np.testing.assert_allclose(frame[2, 2] / 255, BACKDROP, atol=0.04)
    write_turntable(tmp_path / "b.mp4", ball, albedo_shade(ball, RED), 63, 5)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()
    # The index stands before the pictures, so that a browser can start before it has the whole file.
    data = (tmp_path / "a.mp4").read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")
