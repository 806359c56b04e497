"""Pictures of the finished asset: one view, and the sheet of eight views and four normal maps.

Letters: p pixels along a side of a picture, s texels along a side of the texture. Colours are sRGB in [0, 1];
textures are shown unlit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float

from pipeline.cameras import Camera, ring
from pipeline.kernels.parallel import threads
from pipeline.mesh.mesh import Mesh, bounding_radius, vertex_normals
from pipeline.mesh.rasterize import Fragments, interpolate, rasterize
from pipeline.mesh.texture import render_texture

BACKDROP = 0.93  # a light grey, so that both black and white objects stand out
SUPERSAMPLING = 3
FOV = np.radians(35.0)
POLAR = np.radians(72.0)
GAP = 8  # pixels between tiles

Shade = Callable[[Fragments, Camera], Float[np.ndarray, "p p 3"]]


def turn(mesh: Mesh, count: int) -> list[Camera]:
    """Return `count` cameras around the mesh that see all of it, slightly from above, the first in front."""
    radius = 1.02 * max(bounding_radius(mesh), 1e-3) / np.sin(FOV / 2)
    return ring(count, POLAR, radius, FOV)


def picture(
    mesh: Mesh, camera: Camera, size: int, shade: Shade, supersampling: int
) -> Float[np.ndarray, "p p 3"]:
    """Return one view on the backdrop; every pixel is the mean of `supersampling` squared samples."""
    fragments = rasterize(camera, mesh.vertices, mesh.faces, size * supersampling)
    samples = shade(fragments, camera)
    samples[~fragments.mask] = BACKDROP
    total = np.zeros((size, size, 3), np.float32)
    for row in range(supersampling):
        for column in range(supersampling):
            total += samples[row::supersampling, column::supersampling]
    return total / np.float32(supersampling**2)


def pictures(
    mesh: Mesh, cameras: Sequence[Camera], size: int, shade: Shade, supersampling: int
) -> Iterator[Float[np.ndarray, "p p 3"]]:
    """Give `picture` of every camera, in order; threads draw the next ones meanwhile."""
    with ThreadPoolExecutor(threads()) as pool:
        yield from pool.map(lambda camera: picture(mesh, camera, size, shade, supersampling), cameras)


def albedo_shade(mesh: Mesh, texture: Float[np.ndarray, "s s 3"]) -> Shade:
    """Show the texture as it is."""
    return lambda fragments, camera: render_texture(fragments, mesh, texture)


def face_shade(colours: Float[np.ndarray, "f 3"]) -> Shade:
    """Show one colour a face."""
    return lambda fragments, camera: np.asarray(colours[np.maximum(fragments.triangle, 0)], np.float32)


def normal_shade(mesh: Mesh) -> Shade:
    """Show smooth normals in the camera's frame: red to the right, green up, blue towards the viewer."""
    normals = vertex_normals(mesh).astype(np.float32)

    def shade(fragments: Fragments, camera: Camera) -> Float[np.ndarray, "p p 3"]:
        local = interpolate(fragments, mesh.faces, normals) @ camera.pose[:3, :3]
        local /= np.maximum(np.linalg.norm(local, axis=-1, keepdims=True), 1e-6)
        return np.asarray(0.5 + 0.5 * local, np.float32)

    return shade


def sheet(tiles: Sequence[Float[np.ndarray, "p p 3"]], columns: int) -> Float[np.ndarray, "h w 3"]:
    """Return tiles of one size side by side, row by row, with a gap of the backdrop around each."""
    size = len(tiles[0])
    rows = -(-len(tiles) // columns)
    step = size + GAP
    page = np.full((rows * step + GAP, columns * step + GAP, 3), BACKDROP, np.float32)
    for place, tile in enumerate(tiles):
        top, left = GAP + place // columns * step, GAP + place % columns * step
        page[top : top + size, left : left + size] = tile
    return page


def preview(mesh: Mesh, shade: Shade, size: int) -> Float[np.ndarray, "h w 3"]:
    """Return the sheet: eight views in colour every 45 degrees from the front, then normals every 90
    degrees.
    """
    cameras = turn(mesh, 8)
    normals = normal_shade(mesh)
    tiles = [
        *pictures(mesh, cameras, size, shade, SUPERSAMPLING),
        *pictures(mesh, cameras[::2], size, normals, SUPERSAMPLING),
    ]
    return sheet(tiles, 4)
