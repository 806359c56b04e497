"""Cameras: geometry by hand, rays and projection as inverses, sampling ranges."""

import numpy as np
import pytest

from pipeline.cameras import camera_rays, orbit_camera, project, ring, sample_cameras, sphere


@pytest.mark.parametrize(
    ("azimuth", "polar", "where"),
    [
        (0, np.pi / 2, (0, 0, 2)),
        (np.pi / 2, np.pi / 2, (2, 0, 0)),
        (0.3, 0, (0, 2, 0)),
        (np.pi, np.pi / 2, (0, 0, -2)),
    ],
)
def test_position(azimuth, polar, where):
    assert np.allclose(orbit_camera(azimuth, polar, 2, 1).pose[:3, 3], where)


@pytest.mark.parametrize("polar", [0.0, 0.4, np.pi / 2, 2.8, np.pi])
def test_pose_is_rigid_and_looks_at_the_origin(polar):
    pose = orbit_camera(0.7, polar, 3, 1).pose
    assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3))
    assert np.isclose(np.linalg.det(pose[:3, :3]), 1)
    assert np.allclose(-pose[:3, 2] * 3, -pose[:3, 3])


def test_front_view_has_x_to_the_right_and_y_up():
    camera = orbit_camera(0, np.pi / 2, 2, 1)
    (right, up, middle), depth = project(camera, np.array([[0.3, 0, 0], [0, 0.3, 0], [0, 0, 0]]))
    assert right[0] > 0.5
    assert np.isclose(right[1], 0.5)
    assert up[1] < 0.5
    assert np.isclose(up[0], 0.5)
    assert np.allclose(middle, 0.5)
    assert np.allclose(depth, 2)


def test_projection_at_the_edge_of_the_field_of_view():
    camera = orbit_camera(0, np.pi / 2, 2, 0.8)
    (xy,), _ = project(camera, np.array([[2 * np.tan(0.4), 0, 0]]))
    assert np.isclose(xy[0], 1)


@pytest.mark.parametrize("size", [1, 4, 7])
def test_rays_pass_through_the_pixels_that_project_back(size):
    camera = orbit_camera(2.1, 1.1, 2.5, 0.7)
    origin, directions = camera_rays(camera, size)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
    xy, _ = project(camera, origin + 1.7 * directions)
    centres = (np.arange(size) + 0.5) / size
    x, y = np.meshgrid(centres, centres)
    assert np.allclose(xy, np.stack([x, y], -1).reshape(-1, 2), atol=1e-5)


def test_samples_stay_in_range_and_cover_every_sector():
    rng = np.random.default_rng(0)
    cameras, azimuths, polars = sample_cameras(rng, 8, (1.0, 1.5), (0.7, 1.2), (0.5, 2.0))
    radii = [np.linalg.norm(c.pose[:3, 3]) for c in cameras]
    assert min(radii) >= 1
    assert max(radii) <= 1.5
    assert all(0.7 <= c.fov <= 1.2 for c in cameras)
    assert polars.min() >= 0.5
    assert polars.max() <= 2.0
    gaps = np.diff(np.sort(azimuths), append=np.min(azimuths) + 2 * np.pi)
    assert gaps.max() <= 2 * 2 * np.pi / 8 + 1e-9
    assert ((azimuths >= 0) & (azimuths < 2 * np.pi)).all()


def test_samples_repeat_with_the_seed():
    first, second = (sample_cameras(np.random.default_rng(3), 4, (1, 2), (1, 1), (1, 1)) for _ in range(2))
    assert all(np.array_equal(a.pose, b.pose) for a, b in zip(first[0], second[0], strict=True))


def test_sphere_is_even():
    positions = np.array([c.pose[:3, 3] for c in sphere(200, 1.0, 1.0)])
    assert np.linalg.norm(positions.mean(0)) < 0.02
    assert np.allclose(positions.T @ positions / 200, np.eye(3) / 3, atol=0.02)


def test_ring_starts_in_front():
    cameras = ring(4, np.pi / 2, 2, 1)
    expected = [(0, 0, 2), (2, 0, 0), (0, 0, -2), (-2, 0, 0)]
    assert np.allclose([c.pose[:3, 3] for c in cameras], expected)
