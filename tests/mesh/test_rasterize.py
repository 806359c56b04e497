"""Rasterisation against ray casting (trimesh) and against cases that can be worked out by hand."""

import numpy as np
import trimesh

from pipeline.cameras import camera_rays, orbit_camera, project
from pipeline.kernels import raster
from pipeline.mesh.rasterize import interpolate, rasterize


def test_agrees_with_ray_casting():
    mesh = trimesh.creation.torus(0.5, 0.2, major_sections=24, minor_sections=12)
    camera = orbit_camera(0.4, 0.9, 2.0, 0.8)
    size = 48
    found = rasterize(camera, np.asarray(mesh.vertices), np.asarray(mesh.faces), size)
    origin, directions = camera_rays(camera, size)
    points, rays, triangles = mesh.ray.intersects_location(
        np.broadcast_to(origin, directions.shape), directions, multiple_hits=False
    )
    hit = np.zeros(size * size, bool)
    hit[rays] = True
    assert (found.mask.ravel() != hit).mean() < 1e-3  # only rays through an edge, to rounding
    both = found.mask.ravel()[rays]
    depth = -((points - camera.pose[:3, 3]) @ camera.pose[:3, :3])[:, 2]
    assert np.abs(found.depth.ravel()[rays] - depth)[both].max() < 1e-5
    assert (found.triangle.ravel()[rays] == triangles)[both].mean() > 0.99


def test_barycentrics_are_perspective_correct():
    vertices = np.array([[-1, -1, 0.8], [1, -1, -2.0], [0, 1.5, 0.0]])
    faces = np.array([[0, 1, 2]])
    camera = orbit_camera(0, np.pi / 2, 3, 0.9)
    size = 33
    fragments = rasterize(camera, vertices, faces, size)
    seen = interpolate(fragments, faces, vertices)[fragments.mask]
    origin, directions = camera_rays(camera, size)
    rays = directions.reshape(size, size, 3)[fragments.mask]
    along = seen - origin
    across = along - np.sum(along * rays, axis=1, keepdims=True) * rays
    assert len(seen) > 100
    assert np.abs(across).max() < 1e-5


def test_the_nearer_of_two_faces_wins_whatever_their_order():
    near = np.array([[-1, -1, 0.5], [1, -1, 0.5], [0, 1, 0.5]])
    vertices = np.concatenate([near - (0, 0, 1), near])
    camera = orbit_camera(0, np.pi / 2, 3, 0.9)
    for faces, winner in (([[0, 1, 2], [3, 4, 5]], 1), ([[3, 4, 5], [0, 1, 2]], 0)):
        fragments = rasterize(camera, vertices, np.array(faces), 17)
        assert fragments.triangle[8, 8] == winner


def test_a_shared_edge_leaves_no_hole():
    vertices = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    fragments = rasterize(orbit_camera(0, np.pi / 2, 2, 0.5), vertices, np.array([[0, 1, 2], [0, 2, 3]]), 64)
    assert fragments.mask.all()


def test_a_fan_of_slivers_leaves_no_crack():
    rng = np.random.default_rng(0)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 300))
    rim = 3 * np.stack([np.cos(angle), np.sin(angle), np.zeros(300)], axis=-1)
    vertices = np.concatenate([[[0.137, -0.071, 0.0]], rim])
    i = np.arange(300)
    faces = np.stack([np.zeros(300, int), 1 + i, 1 + (i + 1) % 300], axis=-1)
    fragments = rasterize(orbit_camera(0.3, 1.3, 2, 0.8), vertices, faces, 128)
    assert fragments.mask.all()
    assert np.allclose(fragments.barycentric.sum(-1), 1, atol=1e-5)


def test_degenerate_hidden_and_absent_faces_draw_nothing():
    camera = orbit_camera(0, np.pi / 2, 2, 0.9)
    line = np.array([[-1.0, 0, 0], [0, 0, 0], [1, 0, 0]])
    behind = np.array([[-1.0, -1, 5], [1, -1, 5], [0, 1, 5]])
    through = np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 2.0]])  # one corner exactly in the camera plane
    for vertices in (line, behind, through):
        assert not rasterize(camera, vertices, np.array([[0, 1, 2]]), 16).mask.any()
    empty = rasterize(camera, np.zeros((3, 3)), np.zeros((0, 3), int), 16)
    assert not empty.mask.any()
    assert np.isinf(empty.depth).all()


def test_vertices_land_where_the_readable_projection_puts_them():
    rng = np.random.default_rng(3)
    vertices = rng.uniform(-1, 1, (500, 3)).astype(np.float32)
    camera = orbit_camera(0.7, 1.1, 0.4, 0.8)  # some are behind it
    screen = np.empty((500, 3))
    raster.to_screen(vertices, camera.pose, float(np.tan(camera.fov / 2)), 96, screen)
    xy, depth = project(camera, vertices)
    assert (depth < 0).any()
    np.testing.assert_allclose(screen[:, :2], 96 * xy, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(screen[:, 2], 1 / depth, rtol=1e-9)
