import numpy as np
import pytest

from pipeline.cameras import orbit_camera, project
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.rasterize import Fragments, rasterize
from pipeline.mesh.texture import (
    Texels,
    paint,
    project_view,
    render_texture,
    resolve,
    surface_texels,
    view_trust,
)
from tests import shapes

FACING = orbit_camera(0.0, np.pi / 2, 2.0, np.radians(60))


def quad(z: float = 0.0, half: float = 0.5) -> Mesh:
    """A square that faces +Z, its texture upright: the top left corner is texture point (0, 0)."""
    vertices = np.array([[-half, half, z], [-half, -half, z], [half, -half, z], [half, half, z]], np.float32)
    uv = np.array([[0, 0], [0, 1], [1, 1], [1, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(vertices, faces, uv, faces)


def smooth_picture(size: int) -> np.ndarray:
    y, x = np.meshgrid(*[(np.arange(size) + 0.5) / size] * 2, indexing="ij")
    return np.stack([x, y, 0.5 + 0.4 * np.sin(6 * x) * np.cos(5 * y)], axis=-1).astype(np.float32)


def test_texels_of_a_square_are_where_their_coordinates_say() -> None:
    texels = surface_texels(quad(), 16)
    assert texels.mask.all()
    assert texels.overlap == 0
    centres = (np.arange(16) + 0.5) / 16 - 0.5
    expected = np.stack([np.tile(centres, 16), np.repeat(-centres, 16), np.zeros(256)], axis=1)
    np.testing.assert_allclose(texels.position, expected, atol=1e-6)
    np.testing.assert_allclose(texels.normal, np.tile([0, 0, 1], (256, 1)), atol=1e-6)


def test_rendering_a_texture_agrees_with_bilinear_lookup_by_hand() -> None:
    texture = np.random.default_rng(0).random((8, 8, 3)).astype(np.float32)
    picture = render_texture(rasterize(FACING, *quad()[:2], 40), quad(), texture)
    row, column = 23, 17
    local = ((np.array([column, row]) + 0.5) / 40 * 2 - 1) * np.tan(np.radians(30)) * 2
    place = np.clip((local + 0.5) * 8 - 0.5, 0, 7)
    low = place.astype(int)
    fx, fy = place - low
    block = texture[low[1] : low[1] + 2, low[0] : low[0] + 2].astype(np.float64)
    expected = np.einsum("ijc,i,j->c", block, [1 - fy, fy], [1 - fx, fx])
    np.testing.assert_allclose(picture[row, column], expected, atol=1e-6)
    assert not picture[0, 0].any()


def test_projecting_a_view_gives_back_the_texture_it_shows() -> None:
    texture = smooth_picture(64)
    fragments = rasterize(FACING, *quad()[:2], 256)
    shown = render_texture(fragments, quad(), texture)
    texels = surface_texels(quad(), 64)
    total = np.zeros((len(texels.place), 4))
    project_view(total, texels, quad(), FACING, shown, view_trust(fragments, FACING, 4.0), 4.0)
    colours, seen = resolve(total, texels)
    assert seen.all()
    inner = (np.abs(texels.position[:, :2]) < 0.47).all(axis=1)
    error = colours - texture.reshape(-1, 3)
    assert np.abs(error[inner]).max() < 0.01


def test_hidden_texels_are_not_seen_and_take_their_neighbours_colour() -> None:
    """A small square before a large one: its shadow gets no colour from it."""
    front, back = quad(0.5, 0.2), quad(-0.5, 0.6)
    assert front.uv is not None
    assert back.uv is not None
    uv = np.concatenate([front.uv * [0.4, 1], back.uv * [0.4, 1] + [0.5, 0]]).astype(np.float32)
    faces = np.concatenate([front.faces, back.faces + 4])
    mesh = Mesh(np.concatenate([front.vertices, back.vertices]), faces, uv, faces)
    texels = surface_texels(mesh, 64)
    xy, _ = project(FACING, texels.position)
    fragments = rasterize(FACING, mesh.vertices, mesh.faces, 128)
    is_front = fragments.triangle < 2
    picture = np.where(is_front[..., None], [1, 0, 0], [0, 0, 1]).astype(np.float32)
    total = np.zeros((len(texels.place), 4))
    project_view(total, texels, mesh, FACING, picture, view_trust(fragments, FACING, 3.0), 4.0)
    colours, seen = resolve(total, texels)
    on_back = texels.position[:, 2] < 0
    shadow = on_back & (np.abs(xy - 0.5).max(axis=1) < 0.2 / (1.5 * 2 * np.tan(np.radians(30))) - 0.02)
    assert shadow.sum() > 20
    assert not seen[shadow].any()
    assert seen[~on_back].all()
    assert (colours[on_back, 0] < 0.5).all()
    # The texels beside the shadow are looked up between red and blue pixels; the fill must look past them.
    assert colours[shadow, 0].mean() < 0.03
    assert colours[shadow, 2].mean() > 0.97


def test_texels_that_face_away_are_not_seen() -> None:
    texels = surface_texels(quad(), 8)
    behind = orbit_camera(np.pi, np.pi / 2, 2.0, np.radians(60))
    total = np.zeros((64, 4))
    project_view(
        total, texels, quad(), behind, np.ones((16, 16, 3), np.float32), np.ones((16, 16), np.float32), 4.0
    )
    assert not total.any()
    with pytest.raises(ValueError, match="no view sees"):
        resolve(total, texels)


def test_the_view_straight_on_decides() -> None:
    texels = surface_texels(quad(), 8)
    total = np.zeros((64, 4))
    trust = np.ones((32, 32), np.float32)
    aslant = orbit_camera(np.radians(60), np.pi / 2, 2.0, np.radians(60))
    project_view(total, texels, quad(), FACING, np.zeros((32, 32, 3), np.float32), trust, 6.0)
    project_view(total, texels, quad(), aslant, np.ones((32, 32, 3), np.float32), trust, 6.0)
    colours, _ = resolve(total, texels)
    # Straight above the middle: 1 against cos(60) ** 6.
    assert colours.mean() == pytest.approx(1 / 64, abs=0.02)


def test_trust_falls_towards_outlines_and_steps_but_not_to_zero() -> None:
    depth = np.full((40, 40), np.inf, np.float32)
    depth[5:35, 5:35] = 2.0
    depth[5:35, 20:35] = 1.0
    triangle = np.where(np.isfinite(depth), 0, -1).astype(np.int32)
    trust = view_trust(Fragments(triangle, np.zeros((40, 40, 3), np.float32), depth), FACING, 5.0)
    assert trust.min() > 0
    assert trust[20, 12] == 1
    assert trust[20, 27] == 1
    assert trust[20, 19] < 0.1
    assert trust[20, 20] < 0.1
    assert trust[20, 5] < 0.1
    assert (np.diff(trust[20, 5:12]) >= 0).all()


def test_padding_widens_islands_with_their_own_colour() -> None:
    place = np.array([5 * 16 + 5, 5 * 16 + 6])
    texels = Texels(16, place, np.zeros((2, 3), np.float32), np.zeros((2, 3), np.float32), 0.0)
    texture = paint(np.array([[1, 0, 0], [0, 1, 0]], np.float32), texels, 3)
    np.testing.assert_array_equal(texture[5, 2], [1, 0, 0])
    np.testing.assert_array_equal(texture[5, 9], [0, 1, 0])
    np.testing.assert_array_equal(texture[5, 1], [0.5, 0.5, 0])


def test_unseen_texels_are_filled_across_the_surface_not_the_atlas() -> None:
    position = np.array([[0, 0, 0], [1, 0, 0], [0.01, 0, 0]], np.float32)
    texels = Texels(4, np.array([0, 2, 3]), position, np.tile([0, 0, 1], (3, 1)).astype(np.float32), 0.0)
    total = np.array([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 0, 0]], np.float64)
    colours, seen = resolve(total, texels)
    assert seen.tolist() == [True, True, False]
    assert colours[2, 0] > 0.95  # the atlas neighbour is the green one


def test_a_mesh_without_texture_points_is_refused() -> None:
    with pytest.raises(ValueError, match="unwrap it first"):
        surface_texels(shapes.mesh_of(shapes.ball(0.5), 12), 16)
