"""Fewer faces: closed as before, and the texture lies where it lay."""

from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial import cKDTree

from pipeline.mesh.levels import coarser
from pipeline.mesh.materials import PLAIN, mtl_text
from pipeline.mesh.mesh import texture_points, write_obj
from pipeline.mesh.topology import topology
from pipeline.mesh.unwrap import unwrap_mesh
from tests import shapes


def test_texture_coordinates_stay_with_the_surface(tmp_path: Path) -> None:
    mesh, _ = unwrap_mesh(shapes.mesh_of(shapes.torus(0.5, 0.2), 32), 128, 2)
    Image.new("RGB", (8, 8)).save(tmp_path / "albedo.png")
    (tmp_path / "asset.mtl").write_text(mtl_text(["torus"], PLAIN, "albedo.png"))
    write_obj(tmp_path / "asset.obj", mesh, "asset.mtl", "torus")
    uv, uv_faces = texture_points(mesh)
    middles = uv[uv_faces].mean(axis=1), mesh.vertices[mesh.faces].mean(axis=1)
    tree = cKDTree(middles[0])
    for share in (0.25, 0.06):
        found = coarser(tmp_path / "asset.obj", round(share * len(mesh.faces)))
        assert len(found.faces) <= 1.5 * share * len(mesh.faces)
        counts = topology(found)
        assert counts.closed
        assert counts.manifold
        assert counts.euler == 0
        points, rows = texture_points(found)
        _, nearest = tree.query(points[rows].mean(axis=1))
        away = np.linalg.norm(found.vertices[found.faces].mean(axis=1) - middles[1][nearest], axis=1)
        assert np.median(away) < 0.04
