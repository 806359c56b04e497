from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from pipeline.cameras import Camera, project, ring
from pipeline.diffusion.decoding import view_resolution
from pipeline.mesh.baking import bake_cameras, bake_texture, decibels, extend_foreground
from pipeline.mesh.mesh import Mesh, bounding_radius
from pipeline.mesh.rasterize import interpolate, rasterize
from pipeline.mesh.texture import render_texture, surface_texels
from pipeline.mesh.unwrap import unwrap_mesh
from tests import shapes


def colour(points: np.ndarray) -> np.ndarray:
    """A colour of every place, smooth and different on every side."""
    return (0.5 + 0.4 * np.sin(points * [5, 7, 6] + [0, 1, 2])).astype(np.float32)


def photograph(mesh: Mesh, camera: Camera, size: int, backdrop: float) -> np.ndarray:
    fragments = rasterize(camera, mesh.vertices, mesh.faces, size)
    places = interpolate(fragments, mesh.faces, mesh.vertices)
    return np.where(fragments.mask[..., None], colour(places), np.float32(backdrop))


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return unwrap_mesh(shapes.mesh_of(shapes.ball(0.6), 24), 256, 4)[0]


@pytest.fixture(scope="module")
def chair() -> Mesh:
    return unwrap_mesh(shapes.mesh_of(shapes.chair(), 48), 256, 4)[0]


def quality(error: np.ndarray) -> float:
    return decibels(float((error**2).mean()))


def error_of(texture: np.ndarray, mesh: Mesh) -> np.ndarray:
    texels = surface_texels(mesh, len(texture))
    return texture.reshape(-1, 3)[texels.place] - colour(texels.position)


def test_a_known_colour_comes_back_from_its_views(ball: Mesh) -> None:
    cameras = bake_cameras(12, bounding_radius(ball))
    views = [photograph(ball, camera, 128, 0.0) for camera in cameras]
    texture, figures = bake_texture(ball, cameras, views, 256, 4.0)
    error = error_of(texture, ball)
    assert quality(error) > 38
    assert np.abs(error).max() < 0.25  # black background got in nowhere
    assert figures["texel_coverage"] > 0.97
    assert figures["psnr"] > 38
    assert figures["psnr_worst"] <= figures["psnr"]


def test_views_that_were_not_baked_look_like_direct_renders(ball: Mesh) -> None:
    """The textured mesh, drawn from between the cameras, against the colour of every place seen."""
    cameras = bake_cameras(12, bounding_radius(ball))
    views = [photograph(ball, camera, 128, 0.0) for camera in cameras]
    texture, _ = bake_texture(ball, cameras, views, 256, 4.0)
    for camera in ring(3, 1.3, 2.1, 0.7):
        fragments = rasterize(camera, ball.vertices, ball.faces, 96)
        seen = render_texture(fragments, ball, texture)
        error = (seen - photograph(ball, camera, 96, 0.0))[fragments.mask]
        assert quality(error) > 35


def test_thin_parts_keep_their_colour_against_a_white_background(chair: Mesh) -> None:
    cameras = bake_cameras(18, bounding_radius(chair))
    sharp = [photograph(chair, camera, 128, 1.0) for camera in cameras]
    texture, figures = bake_texture(chair, cameras, sharp, 256, 4.0)
    legs = surface_texels(chair, 256).position[:, 1] < -0.1
    error = error_of(texture, chair)
    assert quality(error[legs]) > 33
    assert quality(error) > 41
    assert figures["texel_coverage"] > 0.9


def test_outlines_that_a_decoder_made_soft_are_believed_less(chair: Mesh) -> None:
    cameras = bake_cameras(18, bounding_radius(chair))
    sharp = [photograph(chair, camera, 128, 1.0) for camera in cameras]
    soft = [gaussian_filter(view, (1.5, 1.5, 0)) for view in sharp]
    careful, trusting = (bake_texture(chair, cameras, soft, 256, margin)[0] for margin in (4.0, 0.0))
    assert quality(error_of(careful, chair)) > quality(error_of(trusting, chair)) + 0.5


def test_same_views_same_texture(ball: Mesh) -> None:
    cameras = bake_cameras(6, bounding_radius(ball))
    views = [photograph(ball, camera, 64, 0.0) for camera in cameras]
    first, second = (bake_texture(ball, cameras, views, 128, 4.0)[0] for _ in range(2))
    assert first.tobytes() == second.tobytes()


@pytest.mark.parametrize("bound", [0.2, 1.7])
def test_the_object_fits_every_view(bound: float) -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(500, 3))
    points *= bound / np.linalg.norm(points, axis=1, keepdims=True)
    cameras = bake_cameras(24, bound)
    assert len(cameras) == 24
    for camera in cameras:
        xy, depth = project(camera, points)
        assert depth.min() > 0
        assert xy.min() > 0
        assert xy.max() < 1
        assert xy.max() - xy.min() > 0.8


def test_the_foreground_is_continued_and_half_opaque_pixels_are_made_whole() -> None:
    solid = np.array([1.0, -2.0, 3.0, 0.5], np.float32)
    opacity = np.zeros((6, 6), np.float32)
    opacity[2:4, 2:4] = 1.0
    opacity[2, 4] = 0.6
    opacity[2, 5] = 0.2
    latents = solid[:, None, None] * opacity
    result = extend_foreground(latents, opacity, opacity > 0.5)
    np.testing.assert_allclose(result, np.broadcast_to(solid[:, None, None], result.shape), rtol=1e-6)


def test_a_view_of_nothing_is_left_alone() -> None:
    latents = np.random.default_rng(0).random((4, 5, 5)).astype(np.float32)
    nothing = np.zeros((5, 5), np.float32)
    np.testing.assert_array_equal(extend_foreground(latents, nothing, nothing > 0.5), latents)


@pytest.mark.parametrize(
    ("text", "expected"), [('{"latent_size": 32}', 64), ('{"latent_size": 96}', 96), ("{}", 64)]
)
def test_small_latents_are_rendered_larger(tmp_path: Path, text: str, expected: int) -> None:
    (tmp_path / "bundle.json").write_text(text)
    assert view_resolution(tmp_path / "bundle.json") == expected
    assert view_resolution(None) == 64
