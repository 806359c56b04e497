"""What becomes of a surface on its way to an asset, where the true one is known.

    make bench ONLY=asset

Scenes are learned from their ideal denoisers (`_ideal`), then made into meshes once with the surface's noise
left in (`clean.denoise` 0) and once as the product does. `noise_before` and `noise_after` are the root mean
square angles [degrees] by which the normals that views show differ from the true ones at the scale of a few
pixels, where the true surface is calm: what is slower than that is another shape, no noise, and an edge is
none either. (Pixels are compared, which see other places of another shape: 0.5 to 0.8 degrees of it are
that, before and after.) `normal_noise_ratio` is the mean over the scenes of after to before; Chamfer
distances [scene units] say what that cost. `normal_error_without_map` and `..._with_map` are the mean angles
[degrees] between the normals of the published mesh and those of the surface before its faces were made fewer.
`relit_psnr` is of the makers' objects under another light, from textures with the training light divided out
(`_relighting`), `relit_psnr_undivided` with it left in [dB].
`bytes` are of the GLB file without its colours, `seconds` processor time from the raw surface to it.
"""

import io
import time
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image
from scipy.ndimage import gaussian_filter

from benchmarks._ideal import ideal_guidance
from benchmarks._relighting import relit, summarise_relit
from benchmarks._tables import markdown
from benchmarks._trials import RESOLUTION, backgrounds, job_of
from benchmarks._truths import Truth, analytic_scenes, catalogue_scenes, surface_error, visible_surface
from pipeline.cameras import Camera, sphere
from pipeline.mesh.baking import PADDING
from pipeline.mesh.gltf import Part, glb_bytes
from pipeline.mesh.materials import PLAIN
from pipeline.mesh.mesh import Mesh, face_normals, split_seams, vertex_normals
from pipeline.mesh.normal_map import normal_map
from pipeline.mesh.rasterize import interpolate, rasterize
from pipeline.mesh.silhouettes import comparison_cameras
from pipeline.mesh.tangents import vertex_tangents
from pipeline.mesh.unwrap import unwrap_mesh
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import Scene, density
from pipeline.nerf.step import initial_state
from pipeline.nerf.train import train
from pipeline.options.job import Job
from pipeline.stages.clean import clean_mesh
from pipeline.stages.extract import SILHOUETTE_SIZE, choose_surface, sample_logarithm

SCENES = ("piano", "car", "horse")
ROUND = ("ball", "torus")
"""Whose faces stand for a smooth surface; those of the others are as they are."""
VIEWS, SIZE = 8, 160
SCALE = 3.0
"""Standard deviation of the blur that tells noise from shape [pixels]."""
SAME_PLACE = 0.06
"""Depths that differ by less [scene units] are of the same part."""
CALM, COVERED = 0.985, 0.9
"""Length of the mean true normal round a pixel, and share of the pixels there that can be compared."""


def shown_normals(
    mesh: Mesh, camera: Camera, flat: bool
) -> tuple[Float[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Return the unit normals that a view shows, where it shows any, and the depths there."""
    seen = rasterize(camera, mesh.vertices, mesh.faces, SIZE)
    if flat:
        normals = face_normals(mesh)[np.maximum(seen.triangle, 0)]
    else:
        normals = interpolate(seen, mesh.faces, vertex_normals(mesh))
    normals = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)
    return normals, seen.mask, np.where(seen.mask, seen.depth, 0.0)


def normal_noise(found: Mesh, true: Mesh, flat: bool) -> float | None:
    """Return the noise of the normals of a surface [degrees]; None where the true one is nowhere calm."""
    squares = []
    for camera in sphere(VIEWS, 2.5, np.radians(40)):
        here, seen, depth = shown_normals(found, camera, False)
        there, true_seen, true_depth = shown_normals(true, camera, flat)
        there = np.where((here * there).sum(-1, keepdims=True) < 0, -there, there)  # windings may be mixed
        both = seen & true_seen & (np.abs(depth - true_depth) < SAME_PLACE)
        error = np.where(both[..., None], here - there, 0.0)
        share = gaussian_filter(both.astype(np.float64), SCALE)
        slow = gaussian_filter(error, (SCALE, SCALE, 0)) / np.maximum(share, 1e-6)[..., None]
        mean = gaussian_filter(np.where(true_seen[..., None], there, 0.0), (SCALE, SCALE, 0))
        around = gaussian_filter(true_seen.astype(np.float64), SCALE)
        calm = both & (np.linalg.norm(mean, axis=-1) > CALM * around) & (share > COVERED)
        squares.append(np.square(error - slow)[calm].sum(axis=-1))
    found_squares = np.concatenate(squares)
    return float(np.degrees(np.sqrt(found_squares.mean()))) if len(found_squares) else None


def learned(truth: Truth, job: Job) -> Scene:
    """Return a scene learned from the ideal denoiser of `truth`."""
    options = job.train_nerf
    state = initial_state(options, backgrounds(), job.seed)
    train(state, [], options, RESOLUTION, ideal_guidance(truth.draw, signal_power=options.signal_power))
    return state.scene


def raw_surface(scene: Scene, job: Job) -> Mesh:
    """Return what stage `extract` makes of a scene."""
    views = comparison_cameras(job.extract.views)
    opacity = render_views(scene, views, SILHOUETTE_SIZE, np.zeros(4, np.float32)).opacity
    occupied = scene.occupancy.occupied
    samples = sample_logarithm(lambda points: density(scene, points), occupied, job.extract.resolution)
    return choose_surface(samples, opacity, views, job.extract.smoothing)[0]


def figures(truth: Truth, raw: Mesh, job: Job) -> dict[str, Any]:
    """Return what the module says, of one scene."""
    options, flat = job.clean, truth.name not in ROUND
    true = visible_surface(truth.mesh)
    row: dict[str, Any] = {"scene": truth.name}
    for name, reach in (("before", 0.0), ("after", options.denoise)):
        began = time.process_time()
        made = clean_mesh(raw, options.faces, options.smoothing, options.min_component, reach=reach)
        seconds = time.process_time() - began
        chamfer, error = surface_error(visible_surface(made.mesh), true)
        row[f"noise_{name}"] = normal_noise(made.mesh, truth.mesh, flat)
        row[f"chamfer_{name}"], row[f"normal_error_{name}"] = round(chamfer, 5), round(error, 2)
    began = time.process_time()
    mesh, _ = unwrap_mesh(made.mesh, job.unwrap.resolution, job.unwrap.padding)
    split = split_seams(mesh)
    image, errors = normal_map(mesh, split, made.fine, job.bake.texture, PADDING)
    png = io.BytesIO()
    Image.fromarray(image).save(png, format="PNG")
    part = Part("asset", split.vertices, split.faces, split.normals, split.uv, vertex_tangents(split))
    size = len(glb_bytes([part], None, PLAIN, normal_png=png.getvalue()))
    return {
        **row,
        "normal_error_without_map": errors["error_without"],
        "normal_error_with_map": errors["error_with"],
        "bytes": size,
        "seconds": round(seconds + time.process_time() - began, 2),
    }


def summarise(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return means over the scenes, and the worst Chamfer distance after as a share of the one before."""
    ratios = [row["noise_after"] / row["noise_before"] for row in rows if row["noise_before"]]
    means = {
        name: round(float(np.mean([row[name] for row in rows])), 4)
        for name in ("normal_error_without_map", "normal_error_with_map", "bytes", "seconds")
    }
    return {
        "scenes": len(rows),
        "normal_noise_ratio": round(float(np.mean(ratios)), 3) if ratios else None,
        "worst_chamfer_ratio": round(max(row["chamfer_after"] / row["chamfer_before"] for row in rows), 3),
        **means,
    }


def main(folder: Path) -> dict[str, Any]:
    """Learn the scenes, measure, write the table into `folder`, return the figures."""
    job = job_of("standard")
    truths = [*analytic_scenes(), *catalogue_scenes(list(SCENES))]
    rows = [figures(truth, raw_surface(learned(truth, job), job), job) for truth in truths]
    table = markdown([*rows[0]], [[*row.values()] for row in rows])
    (folder / "asset.md").write_text(table, encoding="utf-8")
    lit = relit()
    (folder / "relit.md").write_text(markdown([*lit[0]], [[*row.values()] for row in lit]), encoding="utf-8")
    return {"summary": {**summarise(rows), **summarise_relit(lit)}, "scenes": rows, "relit": lit}
