"""Textured scenes that are known exactly: analytic shapes with solid colours, and models of a Debian package.

Letters: v vertices, f faces, h x w pixels, n points. Colours are latents within [-1, 1]: a fixed
linear map of RGB.
"""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import cKDTree

from export.everyday_objects.data.catalogue import LIBRARIES, RADIUS, Model, fit, load_model, read_catalogue
from pipeline.cameras import Camera, sphere
from pipeline.mesh.mesh import Mesh, face_normals
from pipeline.mesh.rasterize import Fragments, interpolate, rasterize

SUPERSAMPLING = 3
_GLASS = 0.5
_VIEWS, _POINT_SIZE = 24, 96


class Truth(NamedTuple):
    """One scene."""

    name: str
    mesh: Mesh
    colour: Callable[[Fragments], Float[np.ndarray, "h w 3"]]
    """RGB in [0, 1] of what every pixel sees; anything where it sees nothing."""

    def draw(
        self, camera: Camera, size: int, background: Float[np.ndarray, " 4"]
    ) -> Float[np.ndarray, "4 h w"]:
        """Return the anti-aliased picture; see `_ideal.Draw`."""
        return self.picture(camera, size, background)[0]

    def picture(
        self, camera: Camera, size: int, background: Float[np.ndarray, " 4"]
    ) -> tuple[Float[np.ndarray, "4 h w"], Float[np.ndarray, "h w"]]:
        """Return the anti-aliased picture and its opacity."""
        fragments = rasterize(camera, self.mesh.vertices, self.mesh.faces, size * SUPERSAMPLING)
        latents = np.where(fragments.mask[..., None], to_latents(self.colour(fragments)), background)
        pool = (size, SUPERSAMPLING, size, SUPERSAMPLING)
        opacity = fragments.mask.astype(np.float64).reshape(pool).mean((1, 3))
        return np.moveaxis(latents, -1, 0).reshape(4, *pool).mean((2, 4)), opacity


class Surface(NamedTuple):
    """Points of a surface that can be seen, and the unit normals there."""

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]


def to_latents(rgb: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 4"]:
    """Return RGB in [0, 1] as four numbers in [-1, 1]: itself, and how much redder than blue it is."""
    return np.concatenate([2 * rgb - 1, rgb[..., :1] - rgb[..., 2:]], axis=-1)


def analytic_scenes() -> list[Truth]:
    """Return a ball, a torus and a chair of boxes."""
    boxes = [((0.7, 0.1, 0.7), (0.0, 0.0, 0.0)), ((0.7, 0.6, 0.1), (0.0, 0.3, -0.3))]
    boxes += [((0.1, 0.6, 0.1), (0.3 * x, -0.3, 0.3 * z)) for x in (-1, 1) for z in (-1, 1)]
    parts = [
        trimesh.creation.box(size).apply_translation(place).subdivide().subdivide() for size, place in boxes
    ]
    turned = trimesh.transformations.rotation_matrix(np.pi / 3, (1, 0, 0))
    shapes = {
        "ball": (trimesh.creation.icosphere(5), _waves),
        "torus": (trimesh.creation.torus(0.5, 0.22, 96, 48).apply_transform(turned), _waves),
        "boxes": (trimesh.util.concatenate(parts), _checks),
    }
    return [_solid(name, shape, colour) for name, (shape, colour) in shapes.items()]


MODELS = {
    "piano": "BlendSwap-CC-0/pianoAQueue",
    "car": "Scopia/chevrolet",
    "horse": "BlendSwap-CC-BY/horse",
    "kitchen chair": "BlendSwap-CC-BY/kitchenChair",
}
"""Of `sweethome3d-furniture`: the first two have plain materials, the others textures."""


def catalogue_scenes(names: Sequence[str]) -> list[Truth]:
    """Return models of the furniture package; none where it is not installed."""
    if not names or not any(LIBRARIES.glob("*.sh3f")):
        return []
    with tempfile.TemporaryDirectory() as work:
        entries = {entry.key: entry for entry in read_catalogue(Path(work))}
        return [_model(name, load_model(entries[MODELS[name]])) for name in names]


def visible_surface(mesh: Mesh) -> Surface:
    """Return what 24 views around the mesh see of it, a point a pixel."""
    normals = face_normals(mesh)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    points, directions = [], []
    for camera in sphere(_VIEWS, 2.5, np.radians(40)):
        fragments = rasterize(camera, mesh.vertices, mesh.faces, _POINT_SIZE)
        seen = fragments.mask
        points.append(interpolate(fragments, mesh.faces, mesh.vertices.astype(np.float64))[seen])
        directions.append(normals[fragments.triangle[seen]])
    return Surface(np.concatenate(points), np.concatenate(directions))


def surface_error(found: Surface, true: Surface) -> tuple[float, float]:
    """Return the Chamfer distance [scene units] and the normal error [degrees].

    The former is the mean of both mean distances to the nearest point of the other; the latter the mean angle
    between the normals of such pairs, whichever way round: the windings of real models are mixed.
    """
    if not len(found.points):
        return float("inf"), 90.0
    distances, angles = [], []
    for here, there in ((found, true), (true, found)):
        # Nodes that are not shrunk to their points: seven times faster from a cube's surface to a ball's.
        away, nearest = cKDTree(there.points, compact_nodes=False).query(here.points)
        cosine = np.abs((here.normals * there.normals[nearest]).sum(1)).clip(0, 1)
        distances.append(away.mean())
        angles.append(np.degrees(np.arccos(cosine)).mean())
    return float(np.mean(distances)), float(np.mean(angles))


def _solid(
    name: str,
    shape: trimesh.Trimesh,
    colour: Callable[[Float[np.ndarray, "... 3"]], Float[np.ndarray, "... 3"]],
) -> Truth:
    """Return a shape whose colour is a function of the place."""
    vertices = fit(np.asarray(shape.vertices, np.float32))
    mesh = Mesh(vertices, np.asarray(shape.faces, np.int32))
    return Truth(name, mesh, lambda seen: colour(interpolate(seen, mesh.faces, vertices / RADIUS)))


def _waves(points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    return 0.5 + 0.45 * np.sin(5.0 * points[..., [1, 2, 0]] + np.array([0.3, 1.4, 2.9]))


def _checks(points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    odd = np.sign(np.sin(6.0 * points + 0.7)).prod(-1, keepdims=True) > 0
    return np.where(odd, [0.85, 0.3, 0.15], [0.15, 0.45, 0.8])


def _model(name: str, model: Model) -> Truth:
    """Return a model without its panes of glass, which no closed-form picture of a surface can hold."""
    kept = model.colours[model.material, 3] >= _GLASS
    faces, material = model.faces[kept], model.material[kept]
    mesh = Mesh(model.vertices, faces)
    flat = model.colours[:, :3].astype(np.float64)

    def colour(seen: Fragments) -> Float[np.ndarray, "h w 3"]:
        which = material[np.maximum(seen.triangle, 0)]
        rgb = flat[which]
        if model.textured.any():
            size = model.textures.shape[1]
            uv = interpolate(seen, faces, model.uv.astype(np.float64)) % 1
            column, row = np.minimum((uv * size).astype(np.int64), size - 1).transpose(2, 0, 1)
            texels = model.textures[which, row, column, :3] / 255
            rgb = np.where(model.textured[which][..., None], texels, rgb)
        return rgb

    return Truth(name, mesh, colour)
