"""A part of a mesh that a file holds, on the way into one mesh of all parts.

Letters: v vertices, f triangles.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int


class Part(NamedTuple):
    """Triangles with one texture point and one normal a vertex, or none."""

    vertices: Float[np.ndarray, "v 3"]
    """float64"""
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "v 2"] | None
    """Origin at the top left."""
    normals: Float[np.ndarray, "v 3"] | None
