import numpy as np
import pytest

from pipeline.mesh.mesh import Mesh
from pipeline.mesh.topology import face_components, fans_per_vertex, signed_volumes, topology
from tests import shapes

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)


def test_tetrahedron() -> None:
    mesh = Mesh(CORNERS, TETRAHEDRON)
    assert topology(mesh) == (1, 2, 0, 0, 0, 0)
    assert signed_volumes(mesh, face_components(mesh)) == pytest.approx([1 / 6])


def test_volume_does_not_depend_on_the_place_and_changes_sign_with_the_orientation() -> None:
    far = Mesh(CORNERS + 50, TETRAHEDRON[:, ::-1].copy())
    assert signed_volumes(far, face_components(far)) == pytest.approx([-1 / 6], rel=1e-3)


def test_a_missing_face_is_a_border_of_three_edges() -> None:
    assert topology(Mesh(CORNERS, TETRAHEDRON[1:])).boundary_edges == 3


def test_a_flipped_face_disagrees_along_three_edges() -> None:
    faces = TETRAHEDRON.copy()
    faces[0] = faces[0, ::-1]
    assert topology(Mesh(CORNERS, faces)).flipped_edges == 3


def test_two_tetrahedra_that_share_a_corner_are_not_manifold_there() -> None:
    vertices = np.concatenate([CORNERS, -CORNERS[1:]])
    second = np.array([0, 4, 5, 6])[TETRAHEDRON][:, ::-1]
    mesh = Mesh(vertices, np.concatenate([TETRAHEDRON, second]).astype(np.int32))
    counts = topology(mesh)
    assert (counts.non_manifold_vertices, counts.non_manifold_edges, counts.components) == (1, 0, 1)
    assert fans_per_vertex(mesh).tolist() == [2, 1, 1, 1, 1, 1, 1]


def test_two_tetrahedra_that_share_an_edge_are_not_manifold_there() -> None:
    vertices = np.concatenate([CORNERS, [[0.5, -1, 0], [0.5, 0, -1]]]).astype(np.float32)
    second = np.array([0, 1, 4, 5])[TETRAHEDRON]
    counts = topology(Mesh(vertices, np.concatenate([TETRAHEDRON, second]).astype(np.int32)))
    assert counts.non_manifold_edges == 1
    assert not counts.manifold


def test_components_are_numbered_by_their_first_face() -> None:
    mesh = shapes.mesh_of(shapes.union(shapes.ball(0.2, (0.6, 0, 0)), shapes.ball(0.4, (-0.4, 0, 0))), 32)
    component = face_components(mesh)
    assert component[0] == 0
    assert set(component) == {0, 1}
    right = mesh.vertices[mesh.faces[:, 0], 0] > 0.2
    assert len(set(component[right])) == len(set(component[~right])) == 1
