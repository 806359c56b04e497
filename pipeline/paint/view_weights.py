"""What a view of a painted mesh reads of its colours, as a matrix that is computed once.

The geometry is fixed, so a rendered view is linear in the latents: pixels = weights @ latents + (1 - covered)
* background, and the gradient by the latents is weights.T @ gradient. Both products run over the matrix in
its own order: no atomic additions, the same bits every time. A pixel is the mean of its samples.

Letters: c columns (texels of the latent texture, row-major, or faces), h x w latent pixels, s texels a side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array

from pipeline.cameras import Camera
from pipeline.mesh.bilinear import neighbours
from pipeline.mesh.mesh import Mesh, texture_points
from pipeline.mesh.rasterize import Fragments, rasterize


class ViewWeights(NamedTuple):
    """One view."""

    weights: csr_array
    """(h * w, c) float32; a row sums to the share of the pixel that the mesh covers."""
    covered: Float[np.ndarray, "h w"]

    def render(
        self, latents: Float[np.ndarray, "c d"], background: Float[np.ndarray, "... d"]
    ) -> Float[np.ndarray, "d h w"]:
        """Return the view before a flat background, or one of its own for every pixel (h, w, d).

        d = 4 latents, or the 3 channels of RGB.
        """
        size = len(self.covered)
        seen = (self.weights @ latents).reshape(size, size, -1)
        picture = seen + (1 - self.covered)[..., None] * background
        return np.ascontiguousarray(picture.transpose(2, 0, 1), np.float32)

    def gradient(self, by_pixel: Float[np.ndarray, "d h w"]) -> Float[np.ndarray, "c d"]:
        """Return the gradient by the latents of a function whose gradient by the view is `by_pixel`."""
        return np.asarray(self.weights.T @ by_pixel.reshape(len(by_pixel), -1).T)


def view_weights(
    mesh: Mesh, camera: Camera, size: int, texture: int | None, supersampling: int
) -> ViewWeights:
    """Return the weights of a `size` x `size` view with `supersampling`^2 samples a pixel.

    `texture`: side of the latent texture, looked up bilinearly; None: every face has one colour.
    """
    fragments = rasterize(camera, mesh.vertices, mesh.faces, size * supersampling)
    row, column = np.nonzero(fragments.mask)
    pixel = (row // supersampling) * size + column // supersampling
    if texture is None:
        columns, shares = fragments.triangle[row, column][:, None], np.ones((len(row), 1))
    else:
        columns, shares = neighbours(_coordinates(fragments, mesh, row, column), texture, texture)
    entries = (shares / supersampling**2).astype(np.float32).ravel()
    place = (np.repeat(pixel, columns.shape[1]), columns.ravel())
    count = len(mesh.faces) if texture is None else texture**2
    weights = csr_array((entries, place), shape=(size * size, count))
    weights.sum_duplicates()
    covered = np.bincount(pixel, minlength=size * size).reshape(size, size) / supersampling**2
    return ViewWeights(weights, covered.astype(np.float32))


def _coordinates(
    fragments: Fragments, mesh: Mesh, row: np.ndarray, column: np.ndarray
) -> Float[np.ndarray, "n 2"]:
    uv, uv_faces = texture_points(mesh)
    corners = uv.astype(np.float64)[uv_faces[fragments.triangle[row, column]]]
    return np.einsum("nk,nkc->nc", fragments.barycentric[row, column], corners)


def seen_columns(views: list[ViewWeights]) -> tuple[np.ndarray, list[ViewWeights]]:
    """Return the columns that some view reads, rising, and the views with only these: nothing else can be
    learned, so nothing else is optimised."""
    seen = np.unique(np.concatenate([view.weights.indices[view.weights.data > 0] for view in views]))
    return seen, [view._replace(weights=csr_array(view.weights[:, seen])) for view in views]
