"""Latents that a linear decoder turns into known colours come back as these colours, both ways."""

import numpy as np
import pytest

from pipeline.mesh.baking import bake_cameras, bake_texture
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.texture import Texels, surface_texels
from pipeline.mesh.unwrap import unwrap_mesh
from pipeline.paint.baking import atlas_texture, bake_faces, painted_views, texture_psnr, view_margin
from pipeline.paint.surface_latents import Painted, complete, face_texels
from tests import shapes

MATRIX = np.array([[0.3, 0.1, 0.0, 0.0], [0.0, 0.3, 0.1, 0.0], [0.0, 0.0, 0.3, 0.1]], np.float32)


def decode(latents: np.ndarray) -> np.ndarray:
    """A decoder without memory of its neighbours: RGB = A z + 1/2, four pixels a latent pixel."""
    colours = np.einsum("rc,bchw->bhwr", MATRIX, latents) + 0.5
    return np.clip(colours.repeat(4, axis=1).repeat(4, axis=2), 0, 1).astype(np.float32)


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return unwrap_mesh(shapes.mesh_of(shapes.ball(0.6), 24), 128, 2)[0]


def waves(places: Texels) -> np.ndarray:
    return np.concatenate([places.position, places.position[:, :1] * 0], axis=1).astype(np.float32)


@pytest.mark.parametrize("way", ["views", "atlas"])
def test_both_ways_give_the_colours(ball: Mesh, way: str) -> None:
    texels = surface_texels(ball, 64)
    painted = Painted(complete(ball, texels.place, waves(texels), 64)[0], 64, 0.6)
    cameras = bake_cameras(12, 0.6)
    views = painted_views(painted, ball, cameras, 32, decode)
    if way == "views":
        texture, figures = bake_texture(ball, cameras, views, 128, view_margin(128, 32), two_sided=True)
        assert figures["texel_coverage"] > 0.8
    else:
        texture = atlas_texture(painted, ball, 128, decode)
    fine = surface_texels(ball, 128)
    expected = waves(fine) @ MATRIX.T + 0.5
    assert np.abs(texture.reshape(-1, 3)[fine.place] - expected).mean() < 0.015
    assert texture_psnr(texture, ball, cameras, views) > 28


def test_faces_get_the_colour_at_their_centre(ball: Mesh) -> None:
    places = face_texels(ball)
    painted = Painted(waves(places), None, 0.6)
    plain = ball._replace(uv=None, uv_faces=None)
    cameras = bake_cameras(12, 0.6)
    views = painted_views(painted, plain, cameras, 32, decode)
    colours, figures = bake_faces(plain, cameras, views, view_margin(128, 32))
    assert figures["face_coverage"] > 0.8
    assert np.abs(colours - (waves(places) @ MATRIX.T + 0.5)).mean() < 0.03


def test_a_sheet_is_painted_from_behind_too() -> None:
    """Faces that turn their back to every camera are seen all the same."""
    square = Mesh(
        np.array([[-0.4, -0.4, 0], [0.4, -0.4, 0], [0.4, 0.4, 0], [-0.4, 0.4, 0]]),
        np.array([[0, 2, 1], [0, 3, 2]], np.int32),  # clockwise from the front
        np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float64),
        np.array([[0, 2, 1], [0, 3, 2]], np.int32),
    )
    cameras = bake_cameras(12, 0.6)[:1]
    red = np.broadcast_to(np.array([0.8, 0.2, 0.1], np.float32), (64, 64, 3))
    texture, figures = bake_texture(square, cameras, [red], 16, 2.0, two_sided=True)
    assert figures["texel_coverage"] > 0.95
    np.testing.assert_allclose(texture[8, 8], [0.8, 0.2, 0.1], atol=1e-6)


def test_unseen_places_continue_their_neighbours_on_the_surface(ball: Mesh) -> None:
    texels = surface_texels(ball, 64)
    seen = texels.place[texels.position[:, 1] > -0.2]
    colours = np.ones((len(seen), 4), np.float32)
    latents, figures = complete(ball, seen, colours, 64)
    np.testing.assert_allclose(latents, 1.0, atol=1e-6)
    assert figures["seen_share"] == pytest.approx(len(seen) / len(texels.place))
    assert figures["colours"] + figures["unseen_colours"] == 64 * 64
