"""Stage `extract`: the surface of the density at the threshold that looks most like the renders.

Letters: n views, s pixels along a side, g cells along a side of the box. Surfaces are level sets of the
logarithm of the
density: the field is the exponential of a smooth function, so its logarithm interpolates well between samples
where the density itself makes steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from skimage.measure import marching_cubes

from pipeline.errors import InputError
from pipeline.scene.cameras import Camera
from pipeline.scene.mesh import Mesh, write_ply
from pipeline.scene.rendering import render_views
from pipeline.scene.scene import density as scene_density
from pipeline.scene.scene import load_scene
from pipeline.scene.silhouettes import comparison_cameras, mean_iou, opacity_masks, silhouettes
from pipeline.stage import Context, Progress, execute

SILHOUETTE_SIZE = 96
LEAST_DENSITY = 0.1  # thresholds below it [1 / scene unit] only find haze: a whole box of it is 18 % opaque
LEAST_OPACITY = 0.05  # a scene that is nowhere more opaque is empty
COARSE, FINE, ROUNDS = 10, 4, 2  # thresholds of the first sweep, of each refinement, and refinements
FAR = 4.0  # logarithms further than this from the threshold say only "inside" or "outside"

Density = Callable[[Float[np.ndarray, "k 3"]], Float[np.ndarray, " k"]]


class Samples(NamedTuple):
    """Log density [log of 1 / scene unit] at the centres of cubic cells, with one layer of empty cells
    around.
    """

    logarithm: Float[np.ndarray, "x y z"]
    """-inf where there is nothing."""
    origin: Float[np.ndarray, " 3"]
    """The corner of the first cell inside the empty layer."""
    cell: float
    """Side of a cell [scene units]."""


def sample_logarithm(density: Density, occupied: Bool[np.ndarray, "g g g"], resolution: int) -> Samples:
    """Sample the density in the bounding box of the occupied cells, `resolution` times along its longest
    side.

    Points in unoccupied cells are not evaluated, since the renderer skips them too; they and the layer
    outside are empty, which closes the surface of whatever touches the wall of the box.

    Args:
        density: (k, 3) points -> (k,) densities [1 / scene unit].
        occupied: cells of the box [-1, 1]^3, indexed [x, y, z].
    """
    sides = len(occupied)
    used = np.argwhere(occupied) if occupied.any() else np.array([[0] * 3, [sides - 1] * 3])
    origin = used.min(axis=0) / sides * 2 - 1
    extent = (used.max(axis=0) + 1) / sides * 2 - 1 - origin
    cell = float(extent.max()) / resolution
    counts = np.ceil(extent / cell - 1e-9).astype(np.int64)
    centres = [origin[axis] + (np.arange(counts[axis]) + 0.5) * cell for axis in range(3)]
    places = [np.minimum(((along + 1) / 2 * sides).astype(np.int64), sides - 1) for along in centres]
    index = np.argwhere(occupied[np.ix_(*places)])
    points = np.stack([centres[axis][index[:, axis]] for axis in range(3)], axis=1).astype(np.float32)
    values = np.asarray(density(points), np.float64)
    if not np.isfinite(values).all():
        raise InputError("the scene's density is NaN or infinite; train it again with a lower learning rate")
    grid = np.full(counts + 2, -np.inf, np.float32)
    with np.errstate(divide="ignore"):
        grid[tuple(index.T + 1)] = np.log(values)
    return Samples(grid, origin, cell)


def surface(samples: Samples, threshold: float) -> Mesh:
    """Return the closed surface where the density is `threshold` (Lewiner's marching cubes), faces outwards.

    The threshold must be below the greatest density sampled.
    """
    level = np.clip(samples.logarithm - np.float32(np.log(threshold)), -FAR, FAR)
    vertices, faces, _, _ = marching_cubes(level, 0.0, gradient_direction="ascent", allow_degenerate=False)
    places = samples.origin + (vertices.astype(np.float64) - 0.5) * samples.cell
    return Mesh(np.clip(places, -1.0, 1.0).astype(np.float32), faces.astype(np.int32))


def choose_surface(
    samples: Samples,
    opacity: Float[np.ndarray, "n s s"],
    cameras: Sequence[Camera],
    tell: Callable[[int, str], None] = lambda done, note: None,
) -> tuple[Mesh, dict[str, Any]]:
    """Return the surface whose silhouettes agree best with the rendered opacities, and how it was chosen.

    Thresholds are swept coarsely over all densities there are, on a logarithmic scale, then finely around the
    best.

    Raises:
        InputError: the scene is empty, so that no threshold can find anything.
    """
    mask, level = opacity_masks(opacity)
    highest = float(np.exp(samples.logarithm.max()))
    if float(opacity.max(initial=0.0)) < LEAST_OPACITY or not highest > 0:
        raise InputError(
            f"the trained scene is empty (greatest opacity {float(opacity.max(initial=0.0)):.3f}, "
            f"expected {LEAST_OPACITY} or more); try another SEED, more train_nerf.steps "
            "or less train_nerf.opacity_weight"
        )
    agreement: dict[float, float] = {}
    best: tuple[float, Mesh] | None = None
    candidates = np.geomspace(min(LEAST_DENSITY, highest / 100), 0.9 * highest, COARSE)
    for _ in range(1 + ROUNDS):
        for threshold in candidates.tolist():
            mesh = surface(samples, threshold)
            agreement[threshold] = mean_iou(silhouettes(mesh, cameras, opacity.shape[-1]), mask)
            if best is None or agreement[threshold] > best[0]:
                best = agreement[threshold], mesh
            tell(len(agreement), f"silhouette IoU {best[0]:.3f}")
        tried = sorted(agreement)
        place = tried.index(max(agreement, key=lambda t: agreement[t]))
        around = tried[max(place - 1, 0)], tried[min(place + 1, len(tried) - 1)]
        candidates = np.setdiff1d(np.geomspace(*around, FINE + 2)[1:-1], tried)
    assert best is not None
    curve = sorted(agreement.items())
    return best[1], {
        "threshold": max(agreement, key=lambda t: agreement[t]),
        "silhouette_iou": best[0],
        "iou_curve": [[round(threshold, 4), round(iou, 4)] for threshold, iou in curve],
        "opacity_level": level,
        "greatest_opacity": float(opacity.max()),
        "greatest_density": highest,
    }


def main(context: Context) -> None:
    options = context.job.extract
    scene = load_scene(context.inputs["scene"])
    cameras = comparison_cameras(options.views)
    opacity = render_views(scene, cameras, SILHOUETTE_SIZE, np.zeros(4, np.float32)).opacity
    occupied = scene.occupancy.occupied
    samples = sample_logarithm(lambda points: scene_density(scene, points), occupied, options.resolution)
    with Progress("extract", COARSE + ROUNDS * FINE, "thresholds") as progress:
        mesh, figures = choose_surface(samples, opacity, cameras, progress.update)
    context.metrics.update(
        **figures,
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        cell=samples.cell,
        occupied_share=float(occupied.mean()),
    )
    write_ply(context.outputs["mesh"], mesh)


if __name__ == "__main__":
    execute("extract", main)
