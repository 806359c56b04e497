"""The tabulated sketch against exact values at random points."""

from pathlib import Path

import igl
import numpy as np
import pytest
import trimesh
from scipy.interpolate import RegularGridInterpolator

from pipeline.errors import InputError
from pipeline.sketch.lattice import Sketch, load_sketch, look_up, save_sketch, solid_cells, volume_iou
from pipeline.sketch.winding import distances, orient_outwards, place, tabulate

CELLS = 48
RNG = np.random.default_rng(0)
POINTS = RNG.uniform(-1, 1, (8_000, 3)).astype(np.float32)


def pieces() -> list[trimesh.Trimesh]:
    """A ball, a box and a torus that overlap."""
    ball = trimesh.creation.icosphere(3, radius=0.4).apply_translation([-0.2, 0.1, 0])
    block = trimesh.creation.box([0.7, 0.3, 0.5]).apply_translation([0.2, 0, 0.1])
    ring = trimesh.creation.torus(0.5, 0.12).apply_translation([0, -0.2, 0])
    return [ball, block, ring]


def soup(holes: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the pieces, torn into single triangles, without a share of them."""
    triangles = np.concatenate([piece.triangles for piece in pieces()])
    corners = triangles[np.random.default_rng(1).random(len(triangles)) >= holes]
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def exact(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact winding number (a sum over all triangles) and distance of POINTS."""
    points = POINTS.astype(np.float64)
    winding = igl.winding_number(vertices, faces.astype(np.int64), points)
    squared, _, _ = igl.point_mesh_squared_distance(points, vertices, faces.astype(np.int64))
    return winding, np.sqrt(squared)


def assert_within_half_a_cell(distance: np.ndarray, truth: np.ndarray, cell: float) -> None:
    """A function of slope 1 interpolates to 0.87 of a cell at worst: at a cone's tip in the middle of a cell.

    Such a tip is the middle of the ball; a cell has that place somewhere, and few points are as near to it.
    """
    error = np.abs(distance - truth) / cell
    assert error[np.linalg.norm(POINTS - [-0.2, 0.1, 0], axis=1) > cell].max() < 0.5
    assert error.max() < 0.87


def test_a_soup_of_overlapping_parts_is_their_union() -> None:
    vertices, faces = soup()
    sketch = tabulate(vertices, faces, CELLS, "soup")
    inside, distance = look_up(sketch, POINTS)
    winding, truth = exact(vertices, faces)
    union = np.any([exact(p.vertices, p.faces)[0] > 0.5 for p in pieces()], axis=0)
    away = truth > sketch.cell
    assert away.mean() > 0.3
    np.testing.assert_array_equal(inside[away], union[away])
    np.testing.assert_array_equal(winding[away] > 0.5, union[away])
    assert_within_half_a_cell(distance, truth, sketch.cell)


@pytest.mark.parametrize("holes", [0.02, 0.1])
def test_a_soup_with_holes_is_still_a_solid(holes: float) -> None:
    vertices, faces = soup(holes)
    sketch = tabulate(vertices, faces, CELLS, "soup")
    inside, distance = look_up(sketch, POINTS)
    winding, truth = exact(vertices, faces)
    assert_within_half_a_cell(distance, truth, sketch.cell)
    # In a hole there is no surface to be far from: where the winding number itself says so without doubt.
    sure = (truth > sketch.cell) & (np.abs(winding - 0.5) > 0.1)
    np.testing.assert_array_equal(inside[sure], winding[sure] > 0.5)
    whole, _ = look_up(tabulate(*soup(), CELLS, "soup"), POINTS)
    assert volume_iou(inside, whole) > 0.9


def test_a_box_without_its_lid_is_filled() -> None:
    box = trimesh.creation.box([1.0, 1.0, 1.0])
    open_box = box.faces[box.face_normals[:, 1] < 0.5]
    sketch = tabulate(box.vertices, open_box, CELLS, "box")
    inside, _ = look_up(sketch, np.array([[0, 0, 0], [0, -0.45, 0], [0, 0.8, 0], [0.6, 0, 0]], np.float32))
    assert inside.tolist() == [True, True, False, False]


def test_the_lookup_interpolates() -> None:
    """Against scipy in double precision, on values that mean nothing."""
    rng = np.random.default_rng(2)
    values = rng.random((2, 9, 9, 9)).astype(np.float32)
    axis = np.linspace(-1, 1, 9)
    points = np.concatenate([POINTS[:2000], [[-1, -1, -1], [1, 1, 1], [1, -1, 0]]]).astype(np.float32)
    inside, distance = look_up(Sketch(*values), points)
    winding, reference = (
        RegularGridInterpolator([axis] * 3, v.astype(np.float64))(points.astype(np.float64)) for v in values
    )
    np.testing.assert_allclose(distance, reference, atol=1e-6)
    sure = np.abs(winding - 0.5) > 1e-5
    np.testing.assert_array_equal(inside[sure], winding[sure] > 0.5)
    skipped, _ = look_up(Sketch(*values), points, least=0.5)
    np.testing.assert_array_equal(skipped[distance >= 0.5], inside[distance >= 0.5])
    assert not skipped[distance < 0.5].any()
    beyond, _ = look_up(Sketch(*values), points * 50)
    assert len(beyond) == len(points), "points outside the box are taken to its wall"


def test_place_centres_and_scales_whatever_the_units() -> None:
    vertices, _ = soup()
    reference = place(vertices, 0.75)
    assert np.linalg.norm(reference, axis=1).max() == pytest.approx(0.75)
    np.testing.assert_allclose(reference.max(axis=0), -reference.min(axis=0), atol=1e-12)
    np.testing.assert_allclose(place(vertices * 1e-3 + 1e6, 0.75), reference, atol=1e-5)
    for scale in (1e-25, 1e200):
        np.testing.assert_allclose(place(vertices * scale, 0.75), reference, atol=1e-9)


def test_parts_that_are_inside_out_are_turned() -> None:
    vertices, first = [], 0
    faces = []
    for number, piece in enumerate(pieces()):
        index = piece.faces[:, ::-1] if number != 1 else piece.faces
        vertices.append(piece.vertices)
        faces.append(index + first)
        first += len(piece.vertices)
    turned = orient_outwards(np.concatenate(vertices), np.concatenate(faces))
    inside, _ = look_up(tabulate(np.concatenate(vertices), turned, CELLS, "soup"), POINTS)
    whole, _ = look_up(tabulate(*soup(), CELLS, "soup"), POINTS)
    np.testing.assert_array_equal(inside, whole)
    sheet = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    np.testing.assert_array_equal(orient_outwards(sheet, np.array([[0, 1, 2]])), [[0, 1, 2]])


def test_a_sheet_encloses_nothing() -> None:
    sheet = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0, 0.5, 0.0]])
    with pytest.raises(InputError, match=r"sheet\.obj: the mesh encloses no space"):
        tabulate(sheet, np.array([[0, 1, 2]]), 16, "sheet.obj")


def test_solid_cells_hold_every_point_inside() -> None:
    vertices, faces = soup()
    sketch = tabulate(vertices, faces, CELLS, "soup")
    cells = solid_cells(sketch, 32)
    inside, distance = look_up(sketch, POINTS)
    index = np.minimum(((POINTS + 1) * 16).astype(int), 31)
    deep = inside & (distance > sketch.cell)
    assert cells[tuple(index.T)][deep].all()
    assert not cells[tuple(index.T)][~inside & (distance > 0.15)].any()


def test_files(tmp_path: Path) -> None:
    vertices, faces = soup()
    sketch = tabulate(vertices, faces, 8, "soup")
    save_sketch(tmp_path / "a.npz", sketch)
    save_sketch(tmp_path / "b.npz", tabulate(vertices, faces, 8, "soup"))
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    read = load_sketch(tmp_path / "a.npz")
    np.testing.assert_array_equal(read.distance, sketch.distance)
    np.testing.assert_array_equal(read.winding, sketch.winding)
    (tmp_path / "a.npz").write_bytes(b"PK")
    with pytest.raises(InputError, match=r"a\.npz is damaged"):
        load_sketch(tmp_path / "a.npz")


def test_distances_are_exact() -> None:
    box = trimesh.creation.box([1.0, 1.0, 1.0])
    found = distances(box.vertices, box.faces, np.array([[0.0, 0, 0], [1.5, 0, 0], [1.5, 1.5, 0.2]]))
    np.testing.assert_allclose(found, [0.5, 1.0, np.sqrt(2)], rtol=1e-12)
