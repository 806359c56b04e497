"""Single kernels against straightforward torch, forward and backward, the same work in turn."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch

from benchmarks import _plain
from benchmarks._timing import compared, in_turn, torch_threads
from benchmarks._trials import backgrounds
from benchmarks._truths import Truth
from pipeline.cameras import orbit_camera
from pipeline.kernels import hashgrid as kernels
from pipeline.kernels import parallel
from pipeline.mesh.unwrap import unwrap_mesh
from pipeline.nerf.rendering import Rays, composite, evaluate_visible, make_rays, march
from pipeline.nerf.scene import Scene
from pipeline.nerf.step import initial_state
from pipeline.options.nerf import TrainNerf
from pipeline.paint.view_weights import view_weights


class Size(NamedTuple):
    """How much is measured."""

    points: int = 2**17
    """Encoded at once."""
    side: int = 64
    """Rays along a side of a view."""
    sides: tuple[int, ...] = (16, 32, 64, 128)
    samples: tuple[int, ...] = (32, 64, 128)
    steps: int = 100
    """Training steps of the scenes for skipping: a draft."""
    rounds: int = 5
    scaling_rounds: int = 3
    """For the times against rays and samples."""


def foggy(options: TrainNerf) -> Scene:
    """Return a scene in which nothing hides anything: all samples in the box count."""
    scene = initial_state(options, backgrounds(), 0).scene
    scene.field.shape = scene.field.shape._replace(blob_density=0.0, density_bias=-3.0)
    with torch.no_grad():
        scene.field.table.uniform_(-0.5, 0.5, generator=torch.Generator().manual_seed(0))
    return scene


def view_rays(side: int) -> Rays:
    """Return the rays of one view from where training looks, sampled at random offsets."""
    return make_rays([orbit_camera(0.6, 1.2, 2.5, np.radians(40))], side, np.random.default_rng(0))


def encoding(scene: Scene, size: Size) -> dict[str, Any]:
    """Compare the encoding of random points, and of its gradient."""
    rng = np.random.default_rng(0)
    grid, table = scene.field.grid, scene.field.table
    points = rng.uniform(-1, 1, (size.points, 3)).astype(np.float32)
    gradient = rng.standard_normal((size.points, grid.width), np.float32)
    features = np.empty_like(gradient)
    result = np.zeros(tuple(table.shape), np.float32)

    def ours() -> None:
        result[:] = 0
        arguments = (points, table.detach().numpy(), *grid, features)
        parallel.run(kernels.encode, len(points), *arguments, block=8192)
        parallel.run(kernels.encode_backward, len(grid.resolutions), points, gradient, *grid, result)

    def plain() -> None:
        table.grad = None
        _plain.encode(torch.from_numpy(points), table, grid).backward(torch.from_numpy(gradient))

    return both(plain, ours, size.rounds)


def marching(scene: Scene, size: Size) -> dict[str, Any]:
    """Compare finding the samples in the occupied eighth of the box."""
    rays = view_rays(size.side)
    occupied = np.zeros_like(scene.occupancy.occupied)
    quarter = len(occupied) // 4
    occupied[quarter:-quarter, quarter:-quarter, quarter:-quarter] = True
    return both(
        lambda: _plain.march(rays, scene.samples_per_ray, occupied),
        lambda: march(rays, occupied, scene.step),
        size.rounds,
    )


def compositing(scene: Scene, size: Size) -> dict[str, Any]:
    """Compare the sums along rays, and their gradient."""
    rays = view_rays(size.side)
    samples = march(rays, scene.occupancy.occupied, scene.step)
    _, rows = evaluate_visible(scene.field, rays, samples)
    rng = np.random.default_rng(0)
    density = torch.from_numpy(rng.uniform(0, 1, len(rows)).astype(np.float32)).requires_grad_()
    latents = torch.from_numpy(rng.standard_normal((len(rows), 4), np.float32)).requires_grad_()
    kept = torch.from_numpy(np.arange(scene.samples_per_ray + 1) < np.diff(samples.offsets)[:, None])
    by_pixel = torch.from_numpy(rng.standard_normal((len(rays.origins), 4), np.float32))

    def ours() -> None:
        pixels, _, dimmed = composite(density, latents, samples, rows)
        torch.autograd.backward([pixels, dimmed], [by_pixel, by_pixel[:, 0]])

    def plain() -> None:
        padded = torch.zeros(kept.shape).masked_scatter(kept, density)
        colours = torch.zeros(*kept.shape, 4).masked_scatter(kept[..., None], latents)
        pixels, dimmed = _plain.composite(padded, colours, scene.step)
        torch.autograd.backward([pixels, dimmed], [by_pixel, by_pixel[:, 0]])

    return both(plain, ours, size.rounds)


def texels(truth: Truth, size: Size) -> dict[str, Any]:
    """Compare what a view reads of a latent texture, and its gradient."""
    mesh = unwrap_mesh(truth.mesh, 512, 8)[0]
    view = view_weights(mesh, orbit_camera(0.6, 1.2, 2.5, np.radians(40)), size.side, 128, 3)
    taps = view.weights.tocoo()
    row, column = (torch.from_numpy(index.astype(np.int64)) for index in taps.coords)
    shares = torch.from_numpy(taps.data)
    rng = np.random.default_rng(0)
    latents = rng.standard_normal((128 * 128, 4), np.float32)
    leaf = torch.from_numpy(latents).requires_grad_()
    by_pixel = rng.standard_normal((4, size.side, size.side), np.float32)
    flat = np.zeros(4, np.float32)
    given = torch.from_numpy(np.ascontiguousarray(by_pixel.reshape(4, -1).T))

    def ours() -> None:
        view.render(latents, flat)
        view.gradient(by_pixel)

    def plain() -> None:
        leaf.grad = None
        _plain.gather(leaf, row, column, shares, size.side**2).backward(given)

    return both(plain, ours, size.rounds)


def both(plain: Callable[[], Any], ours: Callable[[], Any], rounds: int) -> dict[str, Any]:
    """Time the two in turn; torch's own operations get as many threads as our kernels have."""

    def with_threads() -> None:
        with torch_threads(parallel.threads()):
            plain()

    paces = in_turn({"plain": with_threads, "ours": ours}, rounds)
    return compared(paces["plain"], paces["ours"])
