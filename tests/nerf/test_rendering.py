"""Marching and compositing against brute force, a slow float64 reference and closed forms."""

import numpy as np
import pytest
import torch

from pipeline.cameras import orbit_camera, sphere
from pipeline.kernels import parallel
from pipeline.nerf import occupancy
from pipeline.nerf.field import FieldShape, LatentField
from pipeline.nerf.rendering import (
    NEAR,
    Rays,
    Samples,
    composite,
    count_samples,
    evaluate_visible,
    make_rays,
    march,
    render_rays,
    render_views,
)
from pipeline.nerf.scene import Scene, density
from pipeline.training.background import FlatBackground, LearnedBackground, frequency_encoding

FOV = np.deg2rad(50)


def make_scene(bias: float = -3.0, blob: float = 5.0, samples_per_ray: int = 48) -> Scene:
    """Return a random scene around the centre; `bias` raises the density everywhere and so hides more."""
    rng = np.random.default_rng(3)
    shape = FieldShape(
        levels=4, finest=32, table_log2=12, blob_density=blob, blob_radius=0.4, density_bias=bias
    )
    field = LatentField(shape, rng)
    with torch.no_grad():
        field.table.mul_(3e3)
    return Scene(
        field, occupancy.everywhere(16), FlatBackground(np.ones((1, 4), np.float32)), samples_per_ray
    )


def random_rays(count: int, seed: int = 0) -> Rays:
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-2, 2, (count, 3))
    directions = rng.uniform(-0.7, 0.7, (count, 3)) - origins
    directions[: count // 4] = rng.standard_normal((count // 4, 3))
    directions[-3:] = np.eye(3)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Rays(origins.astype(np.float32), directions.astype(np.float32), rng.random(count, np.float32))


def random_samples(rays: int, seed: int = 0) -> tuple[Samples, np.ndarray, np.ndarray, np.ndarray]:
    """Return samples of rays with 0 to 20 of them, shuffled rows, densities and latents of the rows."""
    rng = np.random.default_rng(seed)
    offsets = np.concatenate([[0], np.cumsum(rng.integers(0, 21, rays))])
    total = int(offsets[-1])
    distances = np.sort(rng.uniform(0.1, 3, total)).astype(np.float32)
    rows = rng.permutation(total).astype(np.int32)
    values = rng.exponential(3, total).astype(np.float32), rng.standard_normal((total, 4)).astype(np.float32)
    return Samples(distances, offsets, 0.05), rows, *values


def reference_composite(
    density: torch.Tensor, latents: torch.Tensor, samples: Samples, rows: np.ndarray
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Composite in float64 with torch, a ray at a time, without an early end."""
    pixels, depths, logs = [], [], []
    for begin, end in zip(samples.offsets[:-1], samples.offsets[1:], strict=True):
        index = torch.from_numpy(rows[begin:end].astype(np.int64))
        optical = density[index] * samples.step
        before = torch.cumsum(optical, 0) - optical
        weight = torch.exp(-before) * (1 - torch.exp(-optical))
        pixels.append((weight[:, None] * latents[index]).sum(0))
        depths.append((weight * torch.from_numpy(samples.distances[begin:end]).double()).sum())
        logs.append(-optical.sum())
    return torch.stack(pixels), torch.stack(depths), torch.stack(logs)


def test_compositing_and_its_gradient_match_float64() -> None:
    samples, rows, sigma, latents = random_samples(200)
    inputs = [torch.from_numpy(a).requires_grad_() for a in (sigma, latents)]
    exact_inputs = [torch.from_numpy(a).double().requires_grad_() for a in (sigma, latents)]
    found = composite(inputs[0], inputs[1], samples, rows)
    exact = reference_composite(exact_inputs[0], exact_inputs[1], samples, rows)
    assert float(exact[2].detach().min()) > np.log(1e-4), "no ray of this test may end early"
    rng = np.random.default_rng(1)
    gradients = [rng.standard_normal(tuple(v.shape)) for v in exact]
    for value, reference in zip(found, exact, strict=True):
        np.testing.assert_allclose(value.detach().numpy(), reference.detach().numpy(), atol=2e-6, rtol=1e-6)
    torch.autograd.backward(list(found), [torch.from_numpy(g.astype(np.float32)) for g in gradients])
    torch.autograd.backward(list(exact), [torch.from_numpy(g) for g in gradients])
    for left, right in zip(inputs, exact_inputs, strict=True):
        assert left.grad is not None
        assert right.grad is not None
        np.testing.assert_allclose(left.grad.numpy(), right.grad.numpy(), atol=2e-6, rtol=1e-5)


def test_rays_end_at_an_opaque_surface() -> None:
    sigma = torch.tensor([1.0, 1e9, 1.0, 5.0]).requires_grad_()
    latents = torch.eye(4).requires_grad_()
    samples = Samples(np.arange(4, dtype=np.float32), np.array([0, 4]), 0.1)
    pixels, depth, log_transmittance = composite(sigma, latents, samples, np.arange(4, dtype=np.int32))
    (pixels.sum() + depth.sum() + log_transmittance.exp().sum()).backward()
    np.testing.assert_allclose(pixels.detach().numpy(), [[-np.expm1(-0.1), np.exp(-0.1), 0, 0]], rtol=1e-6)
    assert float(torch.exp(log_transmittance.detach())) == 0
    assert latents.grad is not None
    assert sigma.grad is not None
    assert not latents.grad[2:].any()
    assert not sigma.grad[2:].any()
    assert torch.isfinite(sigma.grad).all()


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1e6, 1e12, 3e38])
def test_extreme_densities_keep_weights_in_range(scale: float) -> None:
    samples, rows, sigma, latents = random_samples(50)
    sigma = np.minimum(sigma * np.float64(scale), 3e38).astype(np.float32)
    inputs = [torch.from_numpy(a).requires_grad_() for a in (sigma, latents)]
    pixels, depth, log_transmittance = composite(inputs[0], inputs[1], samples, rows)
    bound = np.abs(latents).max()
    assert float(pixels.detach().abs().max()) <= bound * (1 + 1e-6)
    assert float(log_transmittance.detach().max()) <= 0
    (pixels.sum() + depth.sum() + log_transmittance.exp().sum()).backward()
    for value in inputs:
        assert value.grad is not None
        assert torch.isfinite(value.grad).all()


def test_homogeneous_ball_has_its_closed_form_transmittance() -> None:
    """exp(-sigma chord); the midpoint rule errs by at most one step in the chord."""
    rays = random_rays(400)._replace(jitter=np.full(400, 0.5, np.float32))
    step, sigma, radius = 0.004, 2.0, 0.6
    samples = march(rays, np.ones((4, 4, 4), np.bool_), step)
    ray = np.repeat(np.arange(400), np.diff(samples.offsets))
    points = rays.origins[ray] + samples.distances[:, None] * rays.directions[ray]
    inside = np.linalg.norm(points, axis=1) < radius
    density = torch.from_numpy(np.where(inside, sigma, 0).astype(np.float32))
    rows = np.arange(len(points), dtype=np.int32)
    _, _, log_transmittance = composite(density, torch.zeros(len(points), 4), samples, rows)

    o, d = rays.origins.astype(np.float64), rays.directions.astype(np.float64)
    along = (o * d).sum(1)
    discriminant = along**2 - (o * o).sum(1) + radius**2
    half = np.sqrt(np.maximum(discriminant, 0))
    chord = np.maximum(np.maximum(half - along, NEAR) - np.maximum(-half - along, NEAR), 0) * (
        discriminant > 0
    )
    assert chord.max() > 1
    assert (chord == 0).any()
    error = np.abs(log_transmittance.numpy() + sigma * chord)
    assert error.max() <= sigma * step * 1.01


def brute_force_march(rays: Rays, occupied: np.ndarray, step: float) -> list[list[float]]:
    """March every ray in float64 over the whole line and keep what is in the box and occupied."""
    found = []
    side = len(occupied)
    for origin, direction, jitter in zip(*(a.astype(np.float64) for a in rays), strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            near, far = np.sort([(-1 - origin) / direction, (1 - origin) / direction], axis=0)
        enter, leave = max(NEAR, np.nanmax(near)), np.nanmin(far)
        distances = enter + (np.arange(int(8 / step)) + jitter) * step
        distances = distances[distances < leave]
        cells = np.clip((origin + distances[:, None] * direction + 1) / 2 * side, 0, side - 1e-9).astype(int)
        found.append(distances[occupied[tuple(cells.T)]].tolist())
    return found


@pytest.mark.parametrize("share", [1.0, 0.3, 0.0])
def test_marching_matches_brute_force(share: float) -> None:
    rays = random_rays(300)
    occupied = np.random.default_rng(4).random((8, 8, 8)) < share
    samples = march(rays, occupied, 0.07)
    exact = brute_force_march(rays, occupied, samples.step)
    counts = np.array([len(e) for e in exact])
    different = np.diff(samples.offsets) != counts
    assert different.mean() < 0.02, "only samples on a boundary, by rounding, may differ"
    if share == 1:
        assert (counts == 0).any()
        assert counts.max() > 20
    for i in np.flatnonzero(~different):
        own = samples.distances[samples.offsets[i] : samples.offsets[i + 1]]
        np.testing.assert_allclose(own, exact[i], atol=2e-6)


def test_skipping_hidden_samples_changes_nothing() -> None:
    """Pixels and parameter gradients with evaluation in rounds equal those from evaluating every sample."""
    scene = make_scene(bias=3.0)
    rays = make_rays(sphere(2, 1.5, FOV), 24, np.random.default_rng(0))
    samples = march(rays, scene.occupancy.occupied, scene.step)
    segments, rows = evaluate_visible(scene.field, rays, samples)
    evaluated = sum(len(s.points) for s in segments)
    assert evaluated < 0.6 * len(samples.distances), "this scene must hide something"
    ray = np.repeat(np.arange(len(rays.origins)), np.diff(samples.offsets))
    points = rays.origins[ray] + samples.distances[:, None] * rays.directions[ray]
    everything = [scene.field.evaluate(torch.from_numpy(points))]
    results = []
    for parts, order in ((segments, rows), (everything, np.arange(len(points), dtype=np.int32))):
        scene.field.zero_grad()
        pixels, depth, log_transmittance = composite(*scene.field.attach(parts), samples, order)
        (pixels.square().sum() + depth.sum() + log_transmittance.exp().sum()).backward()
        gradient = torch.cat([p.grad.flatten() for p in scene.field.parameters() if p.grad is not None])
        results.append([v.detach().numpy() for v in (pixels, depth, log_transmittance, gradient)])
    for left, right in zip(*results, strict=True):
        np.testing.assert_allclose(left, right, atol=2e-5 * np.abs(right).max())


def test_skipping_empty_cells_changes_little() -> None:
    scene = make_scene(bias=-7.0, blob=10.0)
    cameras = sphere(3, 1.5, FOV)
    full = render_views(scene, cameras, 24)
    scene.occupancy = occupancy.settle(
        np.ones((32,) * 3, np.bool_), lambda x: density(scene, x), scene.step, np.random.default_rng(0)
    )
    assert scene.occupancy.occupied.mean() < 0.7
    skipped = render_views(scene, cameras, 24)
    assert full.opacity.max() > 0.9
    assert np.abs(full.opacity - skipped.opacity).max() < 0.02
    assert np.abs(full.latents - skipped.latents).max() < 0.05


def test_threads_do_not_change_a_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    results = []
    for count in (1, 2, 3):
        monkeypatch.setattr(parallel, "threads", lambda count=count: count)
        scene = make_scene(bias=0.0)
        seen = render_rays(scene, make_rays(sphere(2, 1.5, FOV), 20, np.random.default_rng(0)))
        (seen.latents.square().sum() + seen.log_transmittance.exp().sum()).backward()
        results.append([seen.latents, seen.depth, *(p.grad for p in scene.field.parameters())])
    for other in results[1:]:
        for left, right in zip(results[0], other, strict=True):
            assert torch.equal(left, right)


def test_views_of_an_opaque_ball_have_its_depth_and_outline() -> None:
    scene = make_scene(samples_per_ray=256)
    with torch.no_grad():
        scene.field.weight3.zero_()
        scene.field.bias3.copy_(torch.tensor([0, 0.5, -1, 2, 0]))
    # log density -30 + 60 exp(-r^2 / 0.32): zero at r = .471, and one optical depth is reached at r = .42
    shape = scene.field.shape._replace(density_bias=-30.0, blob_density=60.0, blob_radius=0.4)
    scene.field.shape = shape
    views = render_views(scene, [orbit_camera(0.3, 1.2, 2.0, FOV)], 33, np.full(4, 7, np.float32))
    centre = views.depth[0, 16, 16]
    assert centre == pytest.approx(2.0 - 0.42, abs=0.01)
    np.testing.assert_allclose(views.latents[0, :, 16, 16], [0.5, -1, 2, 0], atol=1e-3)
    np.testing.assert_allclose(views.latents[0, :, 0, 0], 7)
    assert views.depth[0, 0, 0] == 0
    discs = [np.pi * (np.tan(np.arcsin(r / 2)) / np.tan(FOV / 2) * 16.5) ** 2 for r in (0.42, 0.471)]
    assert discs[0] < views.opacity[0].sum() < discs[1]


def test_empty_scene_shows_its_background() -> None:
    scene = make_scene()
    scene.occupancy = scene.occupancy._replace(occupied=np.zeros((8, 8, 8), np.bool_))
    views = render_views(scene, sphere(2, 1.5, FOV), 8)
    np.testing.assert_array_equal(views.latents, 1)
    assert not views.opacity.any()
    assert not views.depth.any()


def test_learned_background_is_a_smooth_function_of_the_direction() -> None:
    scene = make_scene()
    scene.background = LearnedBackground(np.random.default_rng(0))
    scene.occupancy = scene.occupancy._replace(occupied=np.zeros((8, 8, 8), np.bool_))
    views = render_views(scene, sphere(2, 1.5, FOV), 16)
    assert views.latents.std() > 0.01
    assert np.abs(np.diff(views.latents, axis=-1)).max() < 2 * views.latents.std()


def test_frequency_encoding_matches_its_formula() -> None:
    x = np.random.default_rng(0).standard_normal((5, 3))
    parts = [x] + [f(x * 2.0**i) for i in range(6) for f in (np.sin, np.cos)]
    found = frequency_encoding(torch.from_numpy(x), 6).numpy()
    np.testing.assert_allclose(found, np.concatenate(parts, axis=1), atol=1e-12)


def test_every_kind_of_skipping_is_counted_and_can_be_switched_off() -> None:
    """A dense half of a box: its cells alone are sampled, only its front is evaluated; the picture stays."""
    scene = make_scene(bias=6.0)
    grid = np.zeros((8, 8, 8), np.bool_)
    grid[:, :, 4:] = True
    scene.occupancy = scene.occupancy._replace(occupied=grid)
    cameras = sphere(3, 2.5, FOV)
    counts = count_samples(scene, cameras, 12)
    assert counts.all == 3 * 144 * scene.samples_per_ray
    assert counts.all > counts.in_box > counts.occupied > counts.evaluated > 0
    shares = counts.skipped()
    assert list(shares) == ["outside the box", "in empty cells", "behind a surface"]
    assert sum(shares.values()) == pytest.approx(1 - counts.evaluated / counts.all, abs=2e-4)
    rays = make_rays(cameras, 12)
    with torch.no_grad():
        ended, followed = render_rays(scene, rays), render_rays(scene, rays, -np.inf)
    assert len(ended.density) == counts.evaluated
    assert len(followed.density) == counts.occupied
    torch.testing.assert_close(ended.latents, followed.latents, atol=2e-4, rtol=1e-4)
