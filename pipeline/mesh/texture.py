"""Textures of an unwrapped mesh: texels on its surface, projection of views onto them, filling, lookup.

Letters: s texels along a side, n texels that some face covers, f faces, p pixels along a side of a picture.
Texture coordinates are in [0, 1], origin top left; texel (row, column) has its centre at ((column, row) +
0.5) / s. Colours are sRGB in [0, 1].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from pipeline.cameras import Camera
from pipeline.kernels import parallel
from pipeline.kernels import texels as kernel
from pipeline.mesh.mesh import Mesh, face_normals, texture_points, vertex_normals
from pipeline.mesh.rasterize import Fragments, rasterize

DEPTH_SIZE = 512  # pixels of the visibility picture: fine enough for a texel, whatever the view's own size
DEPTH_BIAS = 1.5  # pixels of that picture
LEAST_COSINE = 0.1  # texels seen more aslant than 84 degrees are not seen
NEIGHBOURS = 16  # enough to reach past the texels along an outline, which are seen but badly
NORMAL_SCALE = (
    0.1  # distance that a full turn of the normal counts for, so that colours do not cross thin walls
)


class Texels(NamedTuple):
    """The texels that faces cover; `place` is row * s + column."""

    size: int
    place: Int[np.ndarray, " n"]
    position: Float[np.ndarray, "n 3"]
    normal: Float[np.ndarray, "n 3"]
    overlap: float  # share of the covered texels that more than one face covers

    @property
    def mask(self) -> np.ndarray:
        """(s, s), True where a face covers the texel's centre."""
        mask = np.zeros(self.size * self.size, bool)
        mask[self.place] = True
        return mask.reshape(self.size, self.size)


class Covered(NamedTuple):
    """The texels that faces cover; see `Texels`."""

    place: Int[np.ndarray, " n"]
    face: Int[np.ndarray, " n"]
    barycentric: Float[np.ndarray, "n 3"]
    """float32, of the face's corners."""
    overlap: float


def covered_texels(mesh: Mesh, size: int) -> Covered:
    """Return the texels of a `size` x `size` texture that lie on the mesh, and where in which face."""
    uv, uv_faces = texture_points(mesh)
    face = np.full((size, size), -1, np.int32)
    barycentric = np.zeros((size, size, 3), np.float32)
    cover = np.zeros((size, size), np.int32)
    corners = np.ascontiguousarray(uv.astype(np.float64)[uv_faces] * size)
    kernel.draw_charts(corners, face, barycentric, cover)
    _claim_between_centres(corners, face, barycentric)
    place = np.flatnonzero(face >= 0)
    overlap = float((cover > 1).sum() / max(len(place), 1))
    return Covered(place, face.ravel()[place], barycentric.reshape(-1, 3)[place], overlap)


def surface_texels(mesh: Mesh, size: int) -> Texels:
    """Return the texels of a `size` x `size` texture that lie on the mesh, with their places on it."""
    place, face, weights, overlap = covered_texels(mesh, size)
    corner = mesh.faces[face]
    position = np.einsum("nk,nki->ni", weights, mesh.vertices.astype(np.float32)[corner])
    normal = np.einsum("nk,nki->ni", weights, vertex_normals(mesh)[corner])
    flat = face_normals(mesh)[face]  # where smooth normals cancel out, the face's own
    normal = np.where((normal * flat).sum(axis=1, keepdims=True) > 0, normal, flat)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-20)
    return Texels(size, place, position.astype(np.float32), normal.astype(np.float32), overlap)


def _claim_between_centres(
    corners: Float[np.ndarray, "f 3 2"],
    face: Int[np.ndarray, "s s"],
    barycentric: Float[np.ndarray, "s s 3"],
) -> None:
    """Give faces that lie between texel centres the texel round their middle, if no face has it.

    A chart smaller than a texel would otherwise have none and show its neighbour in the atlas.
    """
    size = len(face)
    edges = corners[:, 1:] - corners[:, :1]
    area = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    missed = np.ones(len(corners), bool)
    missed[face[face >= 0]] = False
    missed &= area != 0
    column, row = np.clip(corners[missed].mean(axis=1).astype(np.int64), 0, size - 1).T
    _, first = np.unique(row * size + column, return_index=True)
    free = first[face[row[first], column[first]] < 0]
    face[row[free], column[free]] = np.flatnonzero(missed)[free]
    barycentric[row[free], column[free]] = 1 / 3


def view_trust(fragments: Fragments, camera: Camera, margin: float) -> Float[np.ndarray, "p p"]:
    """Return how far the colours of a view can be believed, in (0, 1].

    A decoded picture mixes what lies on both sides of an outline, so trust falls towards silhouettes and
    steps in depth, over `margin` pixels. It never falls to 0: a chair's leg, narrower than that, has nothing
    better.
    """
    mask = fragments.mask
    depth = np.where(mask, fragments.depth, 1e3)
    step = np.where(mask, 12 * np.tan(camera.fov / 2) / len(mask) * depth, 0)  # six pixels wide
    inside = mask.copy()
    for axis in (0, 1):
        along, tolerance, kept = (np.moveaxis(grid, axis, 0) for grid in (depth, step, inside))
        whole = np.abs(np.diff(along, axis=0)) <= np.maximum(tolerance[1:], tolerance[:-1])
        kept[1:] &= whole
        kept[:-1] &= whole
    padded = np.pad(inside, 1, constant_values=True)  # the picture's border is no outline
    distance = distance_transform_edt(padded)[1:-1, 1:-1]
    trust: np.ndarray = np.clip(distance / max(margin, 1.0), 0.03, 1.0).astype(np.float32) ** 2
    return trust


def project_view(
    total: Float[np.ndarray, "n 4"],
    texels: Texels,
    mesh: Mesh,
    camera: Camera,
    picture: Float[np.ndarray, "p p 3"],
    trust: Float[np.ndarray, "p p"],
    power: float,
    two_sided: bool = False,
) -> None:
    """Add what a view shows to `total` (float64, in place): sums of weight * colour, and of weight.

    A texel is seen if no face hides it (a depth test with a tolerance that grows with the slant) and it faces
    the camera (`two_sided`: or faces away from it); its weight is trust * cosine ** `power`: with a high
    power the best views decide, and the texture stays sharp.
    """
    depth = rasterize(camera, mesh.vertices, mesh.faces, DEPTH_SIZE).depth
    parallel.run(
        kernel.accumulate_view,
        len(total),
        np.asarray(camera.pose, np.float64),
        float(np.tan(camera.fov / 2)),
        texels.position,
        texels.normal,
        depth,
        np.ascontiguousarray(picture, np.float32),
        np.ascontiguousarray(trust, np.float32),
        float(power),
        two_sided,
        LEAST_COSINE,
        DEPTH_BIAS,
        total,
        block=8192,
    )


def resolve(
    total: Float[np.ndarray, "n 4"], texels: Texels
) -> tuple[Float[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
    """Return the colour of every texel and which of them some view saw; the others are filled, see
    `fill_unseen`. Raises ValueError if no view saw anything.
    """
    seen = total[:, 3] > 0
    if not seen.any():
        raise ValueError("no view sees any texel of the mesh")
    colours = np.zeros((len(total), 3), np.float32)
    colours[seen] = total[seen, :3] / total[seen, 3:]
    return fill_unseen(colours, total[:, 3], texels.position, texels.normal), seen


def fill_unseen(
    values: Float[np.ndarray, "n c"],
    weight: Float[np.ndarray, " n"],
    position: Float[np.ndarray, "n 3"],
    normal: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n c"]:
    """Return `values`, those without weight replaced by the mean of the nearest others on the surface (by
    distance, normal and weight): the atlas would take it from a chart that lies elsewhere on the object.
    """
    seen = weight > 0
    filled = np.array(values, np.float32)
    if not seen.all():
        places = np.concatenate([position, NORMAL_SCALE * normal], axis=1)
        count = min(NEIGHBOURS, int(seen.sum()))
        distance, nearest = cKDTree(places[seen]).query(places[~seen], k=[*range(1, count + 1)])
        share = weight[seen][nearest] / np.maximum(distance, 1e-6)
        share /= share.sum(axis=1, keepdims=True)
        filled[~seen] = np.einsum("nk,nkc->nc", share, values[seen][nearest])
    return filled


def paint(
    colours: Float[np.ndarray, "n 3"],
    texels: Texels,
    padding: int,
    beyond: tuple[float, float, float] | None = None,
) -> Float[np.ndarray, "s s 3"]:
    """Return the texture, its islands widened by `padding` texels of their border's colour; what is further
    away is `beyond`, or the mean.

    Bilinear lookups and mip maps read across an island's border; the padding is what they must find there.
    """
    flat = np.empty((texels.size * texels.size, 3), np.float32)
    flat[:] = colours.mean(axis=0) if beyond is None else beyond
    flat[texels.place] = colours
    texture = flat.reshape(texels.size, texels.size, 3)
    distance, (row, column) = distance_transform_edt(~texels.mask, return_indices=True)
    near = distance <= padding
    texture[near] = texture[row[near], column[near]]
    return texture


def render_texture(
    fragments: Fragments, mesh: Mesh, texture: Float[np.ndarray, "h w 3"]
) -> Float[np.ndarray, "p p 3"]:
    """Return the textured mesh as the camera of `fragments` sees it, unlit; zeros where there is no face.

    Lookups are bilinear, and clamped at the texture's border.
    """
    uv, uv_faces = texture_points(mesh)
    picture = np.zeros((*fragments.triangle.shape, 3), np.float32)
    parallel.run(
        kernel.look_up,
        len(picture),
        fragments.triangle,
        fragments.barycentric,
        uv.astype(np.float64),
        np.ascontiguousarray(uv_faces, np.int32),
        np.ascontiguousarray(texture, np.float32),
        picture,
        block=64,
    )
    return picture
