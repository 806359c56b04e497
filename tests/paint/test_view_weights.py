"""The matrix of a view against looping over its samples, and what it leaves out."""

import numpy as np
import pytest

from pipeline.cameras import Camera, orbit_camera
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.rasterize import rasterize
from pipeline.mesh.unwrap import unwrap_mesh
from pipeline.paint.view_weights import seen_columns, view_weights
from tests import shapes

SIZE, TEXTURE, SAMPLES = 8, 16, 2
CAMERA = orbit_camera(0.4, 1.2, 2.0, 0.9)


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return unwrap_mesh(shapes.mesh_of(shapes.ball(0.6), 16), 64, 2)[0]


def reference(mesh: Mesh, camera: Camera, latents: np.ndarray, background: np.ndarray) -> np.ndarray:
    """Return the view (4, h, w), one sample after another, in float64."""
    fragments = rasterize(camera, mesh.vertices, mesh.faces, SIZE * SAMPLES)
    assert mesh.uv is not None
    assert mesh.uv_faces is not None
    grid = latents.astype(np.float64).reshape(TEXTURE, TEXTURE, 4)
    picture = np.zeros((SIZE, SIZE, 4))
    assert mesh.uv is not None
    uv_faces = mesh.uv_faces
    assert uv_faces is not None
    for row in range(SIZE * SAMPLES):
        for column in range(SIZE * SAMPLES):
            face = fragments.triangle[row, column]
            colour = background.astype(np.float64)
            if face >= 0:
                u, v = fragments.barycentric[row, column] @ mesh.uv[uv_faces[face]].astype(np.float64)
                x, y = (min(max(c * TEXTURE - 0.5, 0), TEXTURE - 1) for c in (u, v))
                colour = np.zeros(4)
                for j in (int(y), min(int(y) + 1, TEXTURE - 1)):
                    for i in (int(x), min(int(x) + 1, TEXTURE - 1)):
                        colour += max(0, 1 - abs(x - i)) * max(0, 1 - abs(y - j)) * grid[j, i]
            picture[row // SAMPLES, column // SAMPLES] += colour / SAMPLES**2
    return picture.transpose(2, 0, 1)


def test_a_view_is_the_mean_of_its_bilinear_samples(ball: Mesh) -> None:
    rng = np.random.default_rng(0)
    latents = rng.standard_normal((TEXTURE**2, 4)).astype(np.float32)
    background = rng.standard_normal(4).astype(np.float32)
    view = view_weights(ball, CAMERA, SIZE, TEXTURE, SAMPLES)
    expected = reference(ball, CAMERA, latents, background)
    np.testing.assert_allclose(view.render(latents, background), expected, atol=2e-6)
    np.testing.assert_allclose(view.weights.sum(axis=1), view.covered.ravel(), atol=1e-6)


def test_the_gradient_is_the_transposed_view(ball: Mesh) -> None:
    """<W x, g> = <x, W' g> for all x and g."""
    rng = np.random.default_rng(1)
    view = view_weights(ball, CAMERA, SIZE, TEXTURE, SAMPLES)
    latents = rng.standard_normal((TEXTURE**2, 4)).astype(np.float32)
    by_pixel = rng.standard_normal((4, SIZE, SIZE)).astype(np.float32)
    forward = float((view.render(latents, np.zeros(4, np.float32)) * by_pixel).sum(dtype=np.float64))
    backward = float((latents * view.gradient(by_pixel)).sum(dtype=np.float64))
    assert forward == pytest.approx(backward, rel=1e-4)
    again = view_weights(ball, CAMERA, SIZE, TEXTURE, SAMPLES).gradient(by_pixel)
    np.testing.assert_array_equal(view.gradient(by_pixel), again)


def test_faces_are_columns_without_texture_points(ball: Mesh) -> None:
    view = view_weights(ball._replace(uv=None, uv_faces=None), CAMERA, SIZE, None, SAMPLES)
    colours = np.repeat(np.arange(len(ball.faces), dtype=np.float32)[:, None], 4, axis=1)
    fragments = rasterize(CAMERA, ball.vertices, ball.faces, SIZE * SAMPLES)
    values = np.where(fragments.mask, fragments.triangle, -1.0)
    expected = values.reshape(SIZE, SAMPLES, SIZE, SAMPLES).mean((1, 3))
    np.testing.assert_allclose(view.render(colours, -np.ones(4, np.float32))[0], expected, rtol=1e-5)


def test_only_what_some_view_reads_is_a_column(ball: Mesh) -> None:
    cameras = [orbit_camera(a, 1.3, 2.0, 0.9) for a in (0.0, 0.5)]
    whole = [view_weights(ball, camera, SIZE, TEXTURE, SAMPLES) for camera in cameras]
    seen, views = seen_columns(whole)
    assert 0 < len(seen) < TEXTURE**2
    latents = np.random.default_rng(2).standard_normal((TEXTURE**2, 4)).astype(np.float32)
    for view, full in zip(views, whole, strict=True):
        background = np.ones(4, np.float32)
        np.testing.assert_allclose(
            view.render(latents[seen], background), full.render(latents, background), atol=1e-6
        )
    changed = latents.copy()
    changed[np.setdiff1d(np.arange(TEXTURE**2), seen)] += 100
    np.testing.assert_array_equal(whole[0].render(changed, background), whole[0].render(latents, background))
