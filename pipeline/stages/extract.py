"""Stage `extract`: the surface of the density at the threshold that looks most like the renders.

Letters: n views, s pixels along a side, g cells along a side of the box. Surfaces are level sets of the
logarithm of the density: the field is the exponential of a smooth function, so its logarithm interpolates
well between samples where the density itself makes steps. Nothing holds that logarithm to a smooth surface in
training, so it is blurred first, unless parts of the object would be lost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter
from skimage.measure import marching_cubes

from pipeline.cameras import Camera
from pipeline.errors import InputError
from pipeline.mesh.mesh import Mesh, write_ply
from pipeline.mesh.silhouettes import comparison_cameras, mean_iou, opacity_masks, silhouettes
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import Scene, load_scene
from pipeline.nerf.scene import density as scene_density
from pipeline.options.asset import Extract
from pipeline.run.stage import Context, Progress, execute

SILHOUETTE_SIZE = 96
LEAST_DENSITY = 0.1  # thresholds below it [1 / scene unit] only find haze: a whole box of it is 18 % opaque
LEAST_OPACITY = 0.05  # a scene that is nowhere more opaque is empty
COARSE, COARSE_VIEWS = 10, 3  # thresholds of the first sweep, which looks at every third view only
FINE = 4  # thresholds between two neighbours, where a sweep is refined
BLURRED = (0.1, 1.5, 5)  # thresholds for the blurred density, relative to the one without; how many
LOST = 0.01  # of the silhouettes' agreement: where a blur costs more, thin parts went, and none is applied
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


def surface(samples: Samples, threshold: float, smoothing: float = 0.0) -> Mesh:
    """Return the closed surface where the density is `threshold` (Lewiner's marching cubes), faces outwards;
    without faces where nothing is as dense.

    `smoothing`: standard deviation of a Gaussian blur of the logarithm [cells].
    """
    level = np.clip(samples.logarithm - np.float32(np.log(threshold)), -FAR, FAR)
    if smoothing:
        level = gaussian_filter(level, smoothing, mode="nearest")
    if not level.max() > 0:
        return Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    vertices, faces, _, _ = marching_cubes(level, 0.0, gradient_direction="ascent", allow_degenerate=False)
    places = samples.origin + (vertices.astype(np.float64) - 0.5) * samples.cell
    return Mesh(np.clip(places, -1.0, 1.0).astype(np.float32), faces.astype(np.int32))


def choose_surface(
    samples: Samples,
    opacity: Float[np.ndarray, "n s s"],
    cameras: Sequence[Camera],
    smoothing: float = 0.0,
    tell: Callable[[int, str], None] = lambda done, note: None,
) -> tuple[Mesh, dict[str, Any]]:
    """Return the surface whose silhouettes agree best with the rendered opacities, and how it was chosen.

    Thresholds are swept coarsely over all densities there are, on a logarithmic scale, with every other
    sample and every third view, then finely around the best. A blur, see `surface`, that costs more than
    `LOST` of the agreement is left out.

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
    everywhere = np.geomspace(min(LEAST_DENSITY, highest / 100), 0.9 * highest, COARSE)
    seen = slice(None, None, COARSE_VIEWS)
    coarse = _sweep(_halve(samples), mask[seen], cameras[seen], 0.0, everywhere, tell)
    around = _between(coarse, everywhere)
    told = len(coarse.curve)

    def sweep(blur: float, candidates: Float[np.ndarray, " k"]) -> _Swept:
        nonlocal told
        swept = _sweep(samples, mask, cameras, blur, candidates, lambda done, note: tell(told + done, note))
        told += len(swept.curve)
        return swept

    chosen, applied = sweep(0.0, around), 0.0
    if smoothing:
        near = chosen.threshold * np.geomspace(*BLURRED)
        smooth = sweep(smoothing, near)
        smooth = max(smooth, sweep(smoothing, _between(smooth, near)), key=lambda s: s.agreement)
        if smooth.agreement > chosen.agreement - LOST:
            chosen, applied = smooth, smoothing
    if not applied:
        chosen = max(chosen, sweep(0.0, _between(chosen, around)), key=lambda s: s.agreement)
    return chosen.mesh, {
        "threshold": chosen.threshold,
        "smoothing": applied,
        "silhouette_iou": chosen.agreement,
        "iou_curve": chosen.curve,
        "opacity_level": level,
        "greatest_opacity": float(opacity.max()),
        "greatest_density": highest,
    }


class _Swept(NamedTuple):
    mesh: Mesh
    threshold: float
    agreement: float
    """Intersection over union of the silhouettes."""
    curve: list[list[float]]
    """Thresholds and agreements of all candidates."""


def _sweep(
    samples: Samples,
    mask: Bool[np.ndarray, "n s s"],
    cameras: Sequence[Camera],
    smoothing: float,
    candidates: Float[np.ndarray, " k"],
    tell: Callable[[int, str], None],
) -> _Swept:
    """Return the surface of the best of the candidates."""
    best: _Swept | None = None
    curve = []
    for done, threshold in enumerate(candidates.tolist(), 1):
        mesh = surface(samples, threshold, smoothing)
        shown = silhouettes(mesh, cameras, mask.shape[-1]) if len(mesh.faces) else np.zeros_like(mask)
        agreement = mean_iou(shown, mask)
        curve.append([round(threshold, 4), round(agreement, 4)])
        if best is None or agreement > best.agreement:
            best = _Swept(mesh, threshold, agreement, curve)
        tell(done, f"silhouette IoU {best.agreement:.3f}")
    assert best is not None
    return best


def _between(swept: _Swept, candidates: Float[np.ndarray, " k"]) -> Float[np.ndarray, " m"]:
    """Return `FINE` thresholds between the neighbours of the best."""
    place = int(np.abs(candidates - swept.threshold).argmin())
    lower, upper = candidates[max(place - 1, 0)], candidates[min(place + 1, len(candidates) - 1)]
    return np.geomspace(lower, upper, FINE + 2)[1:-1]


def _halve(samples: Samples) -> Samples:
    """Return every other sample: an eighth of the work."""
    half = np.ascontiguousarray(samples.logarithm[::2, ::2, ::2])
    return Samples(half, samples.origin + 0.5 * samples.cell, 2 * samples.cell)


def _most_thresholds(smoothing: float) -> int:
    return COARSE + 2 * FINE + (BLURRED[2] + FINE if smoothing else 0)


def scene_surface(
    scene: Scene, options: Extract, tell: Callable[[int, str], None] = lambda done, note: None
) -> tuple[Mesh, dict[str, Any]]:
    """Return the surface of a trained scene, in scene units, and the metrics of its choice."""
    cameras = comparison_cameras(options.views)
    opacity = render_views(scene, cameras, SILHOUETTE_SIZE, np.zeros(4, np.float32)).opacity
    occupied = scene.occupancy.occupied
    samples = sample_logarithm(lambda points: scene_density(scene, points), occupied, options.resolution)
    mesh, metrics = choose_surface(samples, opacity, cameras, options.smoothing, tell)
    return mesh, {
        **metrics,
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "cell": samples.cell,
        "occupied_share": float(occupied.mean()),
    }


def main(context: Context) -> None:
    """Read the scene; write its raw mesh."""
    options = context.job.extract
    scene = load_scene(context.inputs["scene"])
    with Progress("extract", _most_thresholds(options.smoothing), "thresholds") as progress:
        mesh, metrics = scene_surface(scene, options, progress.update)
    context.metrics.update(metrics)
    write_ply(context.outputs["mesh"], mesh)


if __name__ == "__main__":
    execute("extract", main)
