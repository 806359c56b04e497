"""Solids are closed, upright and in millimetres; walls and overhangs of known shapes are found."""

import numpy as np
import pytest
import trimesh

from pipeline.formats import printing
from pipeline.formats.printing import advice, printable, solid
from pipeline.formats.stl import stl_bytes
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.topology import topology
from tests import shapes


def box(width: float, height: float, depth: float) -> Mesh:
    """Return a box in metres, +Y up."""
    made = trimesh.creation.box((width, height, depth))
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces, np.int32))


def test_a_plate_has_its_thickness_and_lies_on_the_bed() -> None:
    mesh, wrapped = solid(*box(0.05, 0.002, 0.03)[:2])
    assert not wrapped
    np.testing.assert_allclose(mesh.vertices.min(axis=0), 0, atol=1e-5)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [50, 30, 2], rtol=1e-5)
    found = printable(mesh)
    assert found.median_wall_mm == pytest.approx(2, abs=1e-3)
    assert found.thin_share == 0
    assert found.overhang_share == 0, "what lies on the bed needs no support"
    assert found.volume_ml == pytest.approx(3, rel=1e-4)
    assert not advice(found, wrapped)


def test_thin_walls_and_ceilings_are_told() -> None:
    thin, _ = solid(*box(0.05, 0.0005, 0.03)[:2])
    found = printable(thin)
    assert found.wall_mm == pytest.approx(0.5, abs=1e-3)
    assert found.thin_share > 0.9
    assert "from 80 mm on" in advice(found, False)[0]
    table = shapes.mesh_of(
        shapes.union(shapes.box((0.4, 0.05, 0.4)), shapes.box((0.05, 0.3, 0.05), (0, -0.3, 0)))
    )
    found = printable(solid(table.vertices, table.faces)[0])
    below = 0.8**2 - 0.1**2
    area = 2 * 0.8**2 + 4 * 0.8 * 0.1 + 4 * 0.1 * 0.55
    assert found.overhang_share == pytest.approx(below / area, abs=0.05)


def test_the_corners_of_seams_are_joined_and_an_inside_out_solid_is_turned() -> None:
    mesh = box(0.1, 0.1, 0.1)
    apart = mesh.vertices[mesh.faces].reshape(-1, 3)
    found, wrapped = solid(apart, np.arange(len(apart)).reshape(-1, 3)[:, ::-1])
    assert not wrapped
    assert len(found.vertices) == 8
    assert printable(found).volume_ml == pytest.approx(1000)


def test_an_open_surface_is_wrapped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(printing, "WRAP", 8.0)  # coarse: its seconds grow with the square
    mesh = box(0.1, 0.1, 0.1)
    found, wrapped = solid(mesh.vertices, mesh.faces[2:])
    assert wrapped
    counts = topology(found)
    assert counts.closed
    assert counts.manifold
    read = trimesh.load_mesh(trimesh.util.wrap_as_stream(stl_bytes(found)), file_type="stl")
    assert read.is_watertight
    assert "not closed" in advice(printable(found), wrapped)[0]
