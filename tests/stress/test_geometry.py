"""Triangles without area, slivers, distant and tiny coordinates, textures of one texel."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.cameras import camera_rays, orbit_camera, ring
from pipeline.mesh.baking import bake_cameras, bake_texture
from pipeline.mesh.coordinates import unwrap_any
from pipeline.mesh.mesh import Mesh, bounding_radius, face_areas, face_normals, split_seams, vertex_normals
from pipeline.mesh.rasterize import rasterize
from pipeline.mesh.texture import paint, render_texture, resolve, surface_texels
from pipeline.mesh.topology import topology
from pipeline.mesh.unwrap import unwrap_mesh
from pipeline.options.job import Job
from pipeline.options.paint import Prepare, TrainPaint
from pipeline.paint.given_mesh import load_paint_mesh
from pipeline.paint.step import initial_paint, make_pool, paint_step
from pipeline.paint.surface_latents import complete
from pipeline.paint.view_weights import view_weights
from pipeline.run.stage import Context
from pipeline.sketch.winding import distances, orient_outwards, place, tabulate, winding_numbers
from pipeline.stages import prepare
from pipeline.stages.clean import clean_mesh
from tests import shapes
from tests.nerf.test_step import BACKGROUNDS


def slivers(count: int = 200) -> Mesh:
    """Return faces that are points, lines, repeated, and needles from 1e-1 down to 1e-12 wide."""
    rng = np.random.default_rng(0)
    a = rng.uniform(-0.7, 0.7, (count, 3))
    along, across = rng.standard_normal((2, count, 3))
    width = 10.0 ** rng.uniform(-12, -1, (count, 1))
    width[::15] = 0
    along[::10] = 0
    corners = np.stack([a, a + 0.5 * along, a + 0.25 * along + width * across], axis=1)
    corners[5] = corners[4]
    vertices = corners.reshape(-1, 3)
    return Mesh(vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))


@pytest.mark.parametrize("radius", [0.0, 0.3, 2.0, 1e6])
def test_a_picture_of_slivers_is_sound(radius: float) -> None:
    """Also from among them, where faces reach behind the camera."""
    mesh = slivers()
    fragments = rasterize(orbit_camera(0.5, 1.2, radius, 0.9), mesh.vertices, mesh.faces, 64)
    mask = fragments.mask
    assert np.isfinite(fragments.depth[mask]).all()
    assert (fragments.depth[mask] > 0).all()
    assert fragments.barycentric.min() >= 0
    np.testing.assert_allclose(fragments.barycentric[mask].sum(-1), 1, atol=1e-5)
    flat = np.flatnonzero(face_areas(mesh) == 0)
    assert len(flat) > 10
    assert not np.isin(fragments.triangle, flat).any()


def test_normals_of_slivers_are_finite_and_unit() -> None:
    mesh = slivers()
    assert np.isfinite(face_normals(mesh)).all()
    np.testing.assert_allclose(np.linalg.norm(vertex_normals(mesh), axis=1), 1, rtol=1e-6)


def with_slivers() -> Mesh:
    """Return a ball with slivers and folded faces glued to it, as one mesh."""
    ball, thin = trimesh.creation.icosphere(2, 0.6), slivers(60)
    vertices = np.concatenate([ball.vertices, thin.vertices])
    collapsed = np.stack([ball.faces[:5, 0], ball.faces[:5, 1], ball.faces[:5, 1]], axis=1)
    faces = np.concatenate([ball.faces, thin.faces + len(ball.vertices), collapsed])
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32))


def test_slivers_are_unwrapped_painted_and_baked() -> None:
    mesh, figures = unwrap_any(with_slivers(), 128, 2)
    assert figures["faces_without_area"] > 5
    options = TrainPaint(steps=3, texture=16, views=8, resolution=8, supersampling=2)
    pool = make_pool(mesh, options, 16, 8, 0)
    for views in pool.views:
        for view in views:
            np.testing.assert_allclose(view.weights.sum(axis=1), view.covered.ravel(), atol=1e-5)
    state = initial_paint(options, pool, BACKGROUNDS, 0)
    for _ in range(3):
        paint_step(state, options, pool, lambda latents, batch: latents - batch.noise)
    latents, _ = complete(mesh, pool.seen, state.colours.detach().numpy(), 16)
    assert np.isfinite(latents).all()
    split = split_seams(mesh)
    assert np.isfinite(split.normals).all()


def test_the_clean_stage_survives_slivers() -> None:
    """Marching cubes makes some where the surface grazes a lattice point."""
    mesh, *_ = clean_mesh(with_slivers(), 400, 2, 0.02)
    counts = topology(mesh)
    assert counts.manifold
    assert np.isfinite(mesh.vertices).all()
    assert face_areas(mesh).min() > 0


def test_winding_and_distance_ignore_slivers() -> None:
    ball, mesh = trimesh.creation.icosphere(2, 0.6), with_slivers()
    solid = mesh._replace(faces=mesh.faces[face_areas(mesh) < 1e-9])
    faces = np.concatenate([ball.faces, solid.faces])
    points = np.random.default_rng(0).uniform(-1, 1, (500, 3))
    away = np.abs(np.linalg.norm(points, axis=1) - 0.6) > 0.05
    found = winding_numbers(mesh.vertices, faces, points)[away]
    np.testing.assert_array_equal(found > 0.5, (np.linalg.norm(points, axis=1) < 0.6)[away])
    assert np.isfinite(distances(mesh.vertices, mesh.faces, points)).all()


@pytest.mark.parametrize(
    ("scale", "offset"), [(1e-6, 0.0), (1e-3, 1e6), (1.0, 1e6), (1e6, 1e6), (1e-12, 0), (1e12, 1e12)]
)
def test_a_sketch_is_the_same_whatever_its_units(scale: float, offset: float) -> None:
    box = trimesh.creation.box([1.0, 0.7, 0.4])
    vertices, faces = np.asarray(box.vertices, np.float64), np.asarray(box.faces)
    moved = vertices * scale + offset
    np.testing.assert_allclose(place(moved, 0.75), place(vertices, 0.75), atol=1e-6)
    inverted = faces[:, ::-1]
    np.testing.assert_array_equal(
        orient_outwards(place(moved, 0.75), inverted), orient_outwards(place(vertices, 0.75), inverted)
    )
    sketch = tabulate(place(moved, 0.75), faces, 12, "box")
    assert np.isfinite(sketch.distance).all()
    assert 0.02 < (sketch.winding > 0.5).mean() < 0.3


def test_an_offset_of_1e6_and_a_scale_of_1e_minus_6_at_once(tmp_path: Path) -> None:
    """Float64 leaves 1e-4 of the shape there: nothing else may be lost on the way to the cameras."""
    box = trimesh.creation.box((1.0, 0.7, 0.4)).subdivide()
    found = []
    for scale, offset in ((1.0, 0.0), (1e-6, 1e6)):
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in (box.vertices * scale + offset).tolist()]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in box.faces.tolist()]
        source = tmp_path / f"{scale}.obj"
        source.write_text("\n".join(lines) + "\n")
        job = Job(prompt="x", mesh=str(source), prepare=Prepare(resolution=128))
        context = Context(job, {"mesh": source}, {"mesh": tmp_path / f"{scale}.npz"}, tmp_path)
        prepare.main(context)
        found.append(load_paint_mesh(context.outputs["mesh"]))
    assert found[1].uv is not None
    np.testing.assert_allclose(found[0].unit, found[1].unit, atol=3e-4)
    assert ((found[1].uv >= 0) & (found[1].uv <= 1)).all()
    assert found[1].vertices.dtype == np.float64


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return unwrap_mesh(shapes.mesh_of(shapes.ball(0.6), 12), 64, 2)[0]


def test_a_texture_of_one_texel(ball: Mesh) -> None:
    """Every place shows the one colour, and painting it moves that colour."""
    red = np.float32([0.8, 0.2, 0.1])
    cameras = bake_cameras(6, bounding_radius(ball))
    pictures = [np.broadcast_to(red, (24, 24, 3)) for _ in cameras]
    texture, figures = bake_texture(ball, cameras, pictures, 1, 1.5)
    np.testing.assert_allclose(texture, red.reshape(1, 1, 3), atol=1e-5)
    assert figures["texel_coverage"] == 1
    fragments = rasterize(cameras[0], ball.vertices, ball.faces, 24)
    shown = render_texture(fragments, ball, texture)
    np.testing.assert_allclose(
        shown[fragments.mask], np.broadcast_to(red, (fragments.mask.sum(), 3)), atol=1e-5
    )

    view = view_weights(ball, cameras[0], 12, 1, 2)
    np.testing.assert_allclose(view.weights.toarray()[:, 0], view.covered.ravel(), atol=1e-5)
    latents, _ = complete(ball, np.array([0]), np.ones((1, 4), np.float32), 1)
    np.testing.assert_array_equal(latents, np.ones((1, 4), np.float32))


@pytest.mark.parametrize("side", [0.9, 0.3, 0.01])
def test_charts_of_one_texel_and_less_have_their_own_colour(side: float) -> None:
    """64 loose triangles, each in a texel of its own (every other one, as padding has it), off its centre.

    Those that hold no texel's centre would otherwise be given the colour of whatever is near in the atlas.
    """
    size, count = 16, 64
    rng = np.random.default_rng(0)
    row, column = np.divmod(np.arange(count), 8)
    corner = np.stack([column, row], 1) * 2.0 + 0.04
    uv = (corner[:, None] + side * np.array([[0, 0], [1, 0], [0, 1]])) / size
    centres = rng.uniform(-1, 1, (count, 1, 3))
    vertices = (centres + 0.05 * rng.standard_normal((count, 3, 3))).reshape(-1, 3)
    index = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    mesh = Mesh(vertices.astype(np.float32), index, uv.reshape(-1, 2).astype(np.float32), index)
    texels = surface_texels(mesh, size)
    own = (row * 2) * size + column * 2
    assert np.isin(own, texels.place).all()
    order = np.searchsorted(texels.place, own)
    reach = np.linalg.norm(texels.position[order] - centres[:, 0], axis=1)
    assert reach.max() < 0.25, "each texel is on its own triangle"
    total = np.concatenate([texels.position.astype(np.float64), np.ones((len(texels.place), 1))], axis=1)
    colours, seen = resolve(total, texels)
    assert seen.all()
    texture = paint(colours, texels, 16)
    np.testing.assert_array_equal(texture.reshape(-1, 3)[own], texels.position[order])


def test_rays_of_every_camera_meet_what_embree_says() -> None:
    """The rasteriser against embree (through trimesh), with slivers in the way and from close by."""
    assert trimesh.ray.has_embree
    mesh = with_slivers()
    broad = mesh._replace(faces=mesh.faces[face_areas(mesh) > 1e-6])
    solid = trimesh.Trimesh(broad.vertices, broad.faces, process=False)
    assert type(solid.ray).__module__.endswith("ray_pyembree")
    size = 40
    for camera in ring(3, 1.1, 2.6, 0.8):
        found = rasterize(camera, broad.vertices, broad.faces, size)
        origin, directions = camera_rays(camera, size)
        first = solid.ray.intersects_first(np.broadcast_to(origin, directions.shape), directions)
        assert ((first >= 0) != found.mask.ravel()).mean() < 5e-3
        both = (first >= 0) & found.mask.ravel()
        assert (first[both] == found.triangle.ravel()[both]).mean() > 0.99
