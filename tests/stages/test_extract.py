import numpy as np
import pytest
from scipy.spatial import cKDTree

from pipeline.errors import InputError
from pipeline.mesh.mesh import face_areas
from pipeline.mesh.silhouettes import comparison_cameras, mean_iou, silhouettes
from pipeline.mesh.topology import face_components, signed_volumes, topology
from pipeline.sketch.winding import distances
from pipeline.stages.extract import choose_surface, sample_logarithm, surface
from tests import shapes


@pytest.mark.parametrize(
    ("distance", "volume", "euler"),
    [
        (shapes.ball(0.6), 4 / 3 * np.pi * 0.6**3, 2),
        (shapes.torus(0.55, 0.2), 2 * np.pi**2 * 0.55 * 0.2**2, 0),
    ],
    ids=["ball", "torus"],
)
def test_surface_converges_to_the_analytic_one_with_the_resolution(
    distance: shapes.Distance, volume: float, euler: int
) -> None:
    errors = []
    for resolution in (24, 48):
        mesh = shapes.mesh_of(distance, resolution)
        counts = topology(mesh)
        assert (counts.components, counts.euler, counts.manifold, counts.closed) == (1, euler, True, True)
        assert counts.flipped_edges == 0
        centroids = mesh.vertices[mesh.faces].mean(axis=1)
        errors.append(np.abs(distance(np.concatenate([mesh.vertices, centroids]))).max())
        assert signed_volumes(mesh, face_components(mesh)).sum() == pytest.approx(
            volume, rel=40 / resolution**2
        )
    # A logarithm that is linear across the surface leaves only its curvature: second order in the cell.
    assert errors[0] < 0.15 * 2 / 24
    assert errors[1] < errors[0] / 3


def test_every_part_of_the_analytic_surface_is_found() -> None:
    mesh = shapes.mesh_of(shapes.torus(0.55, 0.2), 48)
    a, b = np.meshgrid(np.linspace(0, 2 * np.pi, 80), np.linspace(0, 2 * np.pi, 40))
    ring = 0.55 + 0.2 * np.cos(b)
    points = np.stack([ring * np.sin(a), 0.2 * np.sin(b), ring * np.cos(a)], axis=-1).reshape(-1, 3)
    distance, _ = cKDTree(mesh.vertices).query(points)
    assert distance.max() < 2 / 48


def test_hausdorff_distance_falls_with_the_square_of_the_cell() -> None:
    """Both ways: from points all over the surface found to the ball, and from the ball to that surface."""
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(5000, 3))
    truth *= 0.6 / np.linalg.norm(truth, axis=1, keepdims=True)
    found = []
    for resolution in (16, 32):
        mesh = shapes.mesh_of(shapes.ball(0.6), resolution)
        weights = rng.dirichlet(np.ones(3), (len(mesh.faces), 8))
        inner = np.einsum("fkc,fcd->fkd", weights, mesh.vertices[mesh.faces].astype(np.float64))
        points = np.concatenate([mesh.vertices, inner.reshape(-1, 3)])
        forth = np.abs(np.linalg.norm(points, axis=1) - 0.6).max()
        back = distances(mesh.vertices.astype(np.float64), mesh.faces, truth).max()
        found.append(max(forth, back))
        assert found[-1] < 0.15 * 2 / resolution
    assert found[1] < found[0] / 2.5


def test_an_object_that_touches_the_wall_of_the_box_is_closed_inside_it() -> None:
    mesh = shapes.mesh_of(shapes.ball(0.7, (0.6, 0.0, 0.0)), 32)
    counts = topology(mesh)
    assert counts.closed
    assert counts.manifold
    assert 0.98 < mesh.vertices.max() <= 1.0
    assert face_areas(mesh).sum() > 1


def test_points_of_empty_cells_are_not_evaluated() -> None:
    seen = []

    def field(points: np.ndarray) -> np.ndarray:
        seen.append(points)
        return shapes.density(shapes.ball(0.3))(points)

    centres = (np.arange(16) + 0.5) / 8 - 1
    grid = np.stack(np.meshgrid(centres, centres, centres, indexing="ij"), axis=-1)
    occupied = np.linalg.norm(grid, axis=-1) < 0.55
    sparse = sample_logarithm(field, occupied, 24)
    points = np.concatenate(seen)
    assert np.linalg.norm(points, axis=1).max() < 0.55 + np.sqrt(3) / 16
    assert len(points) < 0.75 * 24**3
    # The grid covers only the occupied part of the box, so its cells are smaller.
    assert sparse.cell == pytest.approx(2 * 8 / 16 / 24)
    radii = np.linalg.norm(surface(sparse, shapes.LEVEL).vertices, axis=1)
    assert np.abs(radii - 0.3).max() < 0.05 * sparse.cell


def test_cells_are_cubes_in_a_box_that_is_none() -> None:
    occupied = np.zeros((16, 16, 16), np.bool_)
    occupied[2:14, 6:10, 7:9] = True
    samples = sample_logarithm(shapes.density(shapes.box((0.6, 0.15, 0.08))), occupied, 50)
    assert samples.logarithm.shape == (52, 19, 11)
    mesh = surface(samples, shapes.LEVEL)
    np.testing.assert_allclose(np.abs(mesh.vertices).max(axis=0), [0.6, 0.15, 0.08], atol=0.3 * samples.cell)


def test_the_chosen_threshold_keeps_thin_legs_where_a_fixed_one_loses_them() -> None:
    cameras = comparison_cameras(8)
    opacity = shapes.opacity_of(shapes.chair(), cameras, 56)
    samples = sample_logarithm(shapes.density(shapes.chair()), shapes.EVERYWHERE, 64)
    mesh, figures = choose_surface(samples, opacity, cameras)
    for x in (-1, 1):
        for z in (-1, 1):
            foot = np.abs(mesh.vertices - [0.3 * x, -0.5, 0.3 * z]).max(axis=1)
            assert (foot < 0.06).sum() > 8, "a leg has no foot"
    assert figures["silhouette_iou"] > 0.93
    curve = dict(figures["iou_curve"])
    assert max(curve.values()) == pytest.approx(figures["silhouette_iou"], abs=1e-4)
    high = surface(samples, 5 * shapes.LEVEL)
    assert mean_iou(silhouettes(high, cameras, 56), opacity > 0.5) < figures["silhouette_iou"] - 0.1


def test_the_blur_takes_the_grain_off_a_surface() -> None:
    cameras = comparison_cameras(8)
    opacity = shapes.opacity_of(shapes.ball(0.5), cameras, 48)
    samples = sample_logarithm(shapes.density(shapes.ball(0.5)), shapes.EVERYWHERE, 48)
    grain = np.random.default_rng(0).normal(0, 1.5, samples.logarithm.shape).astype(np.float32)
    rough = samples._replace(logarithm=samples.logarithm + grain)
    errors = []
    for smoothing in (0.0, 1.0):
        mesh, figures = choose_surface(rough, opacity, cameras, smoothing)
        assert figures["smoothing"] == smoothing
        assert figures["silhouette_iou"] > 0.93
        largest = face_components(mesh) == np.bincount(face_components(mesh)).argmax()
        corners = mesh.vertices[mesh.faces[largest]].astype(np.float64)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        middle = corners.mean(axis=1)
        lengths = np.linalg.norm(normals, axis=1) * np.linalg.norm(middle, axis=1)
        cosine = (normals * middle).sum(axis=1)[lengths > 0] / lengths[lengths > 0]
        errors.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())
    assert errors[1] < 0.5 * errors[0]


def test_a_blur_that_would_lose_thin_parts_is_left_out() -> None:
    cameras = comparison_cameras(8)
    opacity = shapes.opacity_of(shapes.chair(), cameras, 56)
    samples = sample_logarithm(shapes.density(shapes.chair()), shapes.EVERYWHERE, 64)
    mesh, figures = choose_surface(samples, opacity, cameras, 4.0)
    sharp, _ = choose_surface(samples, opacity, cameras)
    assert figures["smoothing"] == 0
    assert np.array_equal(mesh.vertices, sharp.vertices)


def test_a_pale_scene_still_gives_a_mesh() -> None:
    """Nowhere half opaque: judged by half of its own greatest opacity."""
    cameras = comparison_cameras(8)
    opacity = 0.3 * shapes.opacity_of(shapes.ball(0.5), cameras, 32)
    samples = sample_logarithm(shapes.density(shapes.ball(0.5)), shapes.EVERYWHERE, 32)
    mesh, figures = choose_surface(samples, opacity, cameras)
    assert figures["opacity_level"] == pytest.approx(0.15, abs=0.01)
    assert figures["silhouette_iou"] > 0.93
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 0.5).max() < 0.08


def test_an_empty_scene_is_refused_with_advice() -> None:
    cameras = comparison_cameras(4)
    nothing = np.zeros((4, 16, 16), np.float32)
    samples = sample_logarithm(shapes.density(shapes.ball(0.3)), np.zeros((8, 8, 8), np.bool_), 16)
    assert not np.isfinite(samples.logarithm).any()
    with pytest.raises(InputError, match=r"empty.*another SEED"):
        choose_surface(samples, nothing, cameras)


def test_a_density_that_is_not_finite_is_named() -> None:
    with pytest.raises(InputError, match="NaN or infinite"):
        sample_logarithm(lambda points: np.full(len(points), np.nan, np.float32), shapes.EVERYWHERE, 8)
