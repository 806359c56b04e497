"""Where a generated asset stands and how large it is: the origin at its base or its middle, in metres.

Letters: v vertices.
"""

from __future__ import annotations

import numpy as np

from pipeline.mesh.mesh import Mesh


def placed(mesh: Mesh, pivot: str, size: float) -> tuple[Mesh, tuple[float, float, float], float]:
    """Return the mesh moved and scaled for the people who open it, the point of the scene that became the
    origin, and the scale [metres a scene unit].

    Args:
        pivot: "base", the middle of the bottom of the bounding box, so that the asset stands on the floor
            (y = 0); "centre", the middle of that box.
        size: its longest side [m]; 0: a scene unit is a metre.
    """
    used = mesh.vertices[np.unique(mesh.faces)].astype(np.float64)
    low, high = used.min(axis=0), used.max(axis=0)
    origin = (low + high) / 2
    if pivot == "base":
        origin[1] = low[1]
    scale = size / float((high - low).max()) if size else 1.0
    vertices = ((mesh.vertices.astype(np.float64) - origin) * scale).astype(np.float32)
    x, y, z = origin.tolist()
    return mesh._replace(vertices=vertices), (x, y, z), scale
