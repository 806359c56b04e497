"""Levels of detail: an asset with fewer faces that shows the same texture.

Edges collapse by quadrics of position and texture coordinates (Garland and Heckbert 1998), so that borders of
charts stay where they are.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pymeshlab

from pipeline.mesh.mesh import Mesh

SHARES = (0.25, 0.06)
"""Of the faces, from the second level on."""
QUALITY = 0.3
"""Of triangles, below which a collapse is put off (MeshLab's usual value)."""


def coarser(path: Path, faces: int) -> Mesh:
    """Return a textured OBJ file's mesh with at most `faces` faces, or as few as borders of charts allow.

    pymeshlab takes texture coordinates of corners from files only, and with the texture that MTL names.
    """
    maker = pymeshlab.MeshSet()
    maker.load_new_mesh(str(path))
    maker.meshing_decimation_quadric_edge_collapse_with_texture(
        targetfacenum=faces, qualitythr=QUALITY, preservenormal=True
    )
    made = maker.current_mesh()
    corners = (made.wedge_tex_coord_matrix() * [1, -1] + [0, 1]).astype(np.float32)
    uv, rows = np.unique(corners, axis=0, return_inverse=True)
    vertices = made.vertex_matrix().astype(np.float32)
    return Mesh(vertices, made.face_matrix().astype(np.int32), uv, rows.reshape(-1, 3).astype(np.int32))
