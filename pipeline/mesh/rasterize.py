"""Which surface a camera sees: rasterisation of a triangle mesh."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pipeline.cameras import Camera
from pipeline.kernels import raster


class Fragments(NamedTuple):
    """What every pixel centre sees."""

    triangle: Int[np.ndarray, "h w"]
    """Index of the nearest face, -1 where there is none; int32."""
    barycentric: Float[np.ndarray, "h w 3"]
    """Weights of that face's three vertices (perspective-correct, sum 1; zeros where there is none);
    float32.
    """
    depth: Float[np.ndarray, "h w"]
    """Distance along the viewing axis, infinite where there is no face; float32."""

    @property
    def mask(self) -> np.ndarray:
        """True where a face is seen."""
        return self.triangle >= 0


def rasterize(
    camera: Camera, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], size: int
) -> Fragments:
    """Rasterise a mesh (both sides of its faces) into a `size` x `size` picture.

    There is no clipping: faces that reach behind the camera are left out. Coordinates are float64 throughout.
    """
    screen = np.empty((len(vertices), 3))
    half_width = float(np.tan(camera.fov / 2))
    raster.to_screen(np.ascontiguousarray(vertices), camera.pose, half_width, size, screen)
    triangle = np.full((size, size), -1, np.int32)
    barycentric = np.zeros((size, size, 3), np.float32)
    inverse_depth = np.zeros((size, size), np.float64)
    raster.draw(screen, np.ascontiguousarray(faces), triangle, barycentric, inverse_depth)
    with np.errstate(divide="ignore"):
        return Fragments(triangle, barycentric, (1.0 / inverse_depth).astype(np.float32))


def interpolate(
    fragments: Fragments, faces: Int[np.ndarray, "f 3"], values: Float[np.ndarray, "v c"]
) -> Float[np.ndarray, "h w c"]:
    """Interpolate per-vertex `values` at every pixel; zeros where no face is seen."""
    corners = values[faces[np.maximum(fragments.triangle, 0)]]
    return np.einsum("hwk,hwkc->hwc", fragments.barycentric, corners) * fragments.mask[..., None]
