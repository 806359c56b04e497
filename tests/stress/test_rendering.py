"""Compositing and marching where numbers are smallest and largest, against float64 and closed forms."""

import numpy as np
import pytest
import torch

from pipeline.cameras import Camera, orbit_camera
from pipeline.kernels.march import LOG_STOP
from pipeline.nerf import occupancy
from pipeline.nerf.rendering import NEAR, Samples, composite, make_rays, march, render_rays, render_views
from pipeline.nerf.scene import Scene, density
from pipeline.nerf.step import initial_state
from pipeline.options.nerf import TrainNerf
from tests.nerf.test_rendering import random_samples
from tests.nerf.test_step import BACKGROUNDS, SMALL

NUMBERS = tuple[np.ndarray, np.ndarray, np.ndarray]


def exact(samples: Samples, rows: np.ndarray, sigma: np.ndarray, latents: np.ndarray) -> NUMBERS:
    """Composite in float64, with the rays' early end; return pixels, depth and log transmittance."""
    sigma, latents = sigma.astype(np.float64), latents.astype(np.float64)
    results = []
    for begin, end in zip(samples.offsets[:-1], samples.offsets[1:], strict=True):
        pixel, depth, log = np.zeros(4), 0.0, 0.0
        for s in range(begin, end):
            if log < LOG_STOP:
                break
            optical = sigma[rows[s]] * samples.step
            weight = np.exp(log) * -np.expm1(-optical)
            pixel += weight * latents[rows[s]]
            depth += weight * samples.distances[s]
            log -= optical
        results.append((pixel, depth, log))
    pixels, depths, logs = zip(*results, strict=True)
    return np.array(pixels), np.array(depths), np.array(logs)


def test_densities_from_1e_minus_12_to_1e12_in_one_ray() -> None:
    samples, rows, sigma, latents = random_samples(300)
    sigma = (10 ** np.random.default_rng(1).uniform(-12, 12, len(sigma))).astype(np.float32)
    found = composite(torch.from_numpy(sigma), torch.from_numpy(latents), samples, rows)
    for value, truth in zip(found, exact(samples, rows, sigma, latents), strict=True):
        np.testing.assert_allclose(value.numpy(), truth, rtol=2e-6, atol=1e-6)


@pytest.mark.parametrize("level", [-12, -6, -1, 1, 2, 6, 12])
def test_the_gradient_is_the_finite_difference_in_float64(level: int) -> None:
    """Central differences of the float64 sum along random directions, at densities around 10^level."""
    samples, rows, _, latents = random_samples(20, seed=level + 20)
    rng = np.random.default_rng(level + 40)
    sigma = (10.0 ** (level + rng.uniform(-1, 1, len(latents)))).astype(np.float32)
    by = [rng.standard_normal((20, 4)), rng.standard_normal(20), rng.standard_normal(20)]

    def value(density: np.ndarray, colours: np.ndarray) -> float:
        pixels, depth, log = exact(samples, rows, density, colours)
        return float((by[0] * pixels).sum() + (by[1] * depth).sum() + (by[2] * np.exp(log)).sum())

    leaves = [torch.from_numpy(a).requires_grad_() for a in (sigma, latents)]
    pixels, depth, log = composite(leaves[0], leaves[1], samples, rows)
    outputs = [pixels, depth, log.exp()]
    torch.autograd.backward(outputs, [torch.from_numpy(g.astype(np.float32)) for g in by])
    for which, scale in ((0, sigma.astype(np.float64)), (1, np.ones(latents.shape))):
        gradient = leaves[which].grad
        assert gradient is not None
        assert torch.isfinite(gradient).all()
        for _ in range(4):
            move = rng.standard_normal(scale.shape) * scale * 1e-5
            plus = [np.float64(a) + (move if which == i else 0) for i, a in enumerate((sigma, latents))]
            minus = [np.float64(a) - (move if which == i else 0) for i, a in enumerate((sigma, latents))]
            difference = (value(*plus) - value(*minus)) / 2
            product = gradient.numpy().astype(np.float64) * move
            size = np.abs(product).sum() + 1e-14  # rounding of the difference itself
            assert abs(product.sum() - difference) < 1e-4 * size + 1e-13 * abs(value(sigma, latents))


@pytest.mark.parametrize("thickness", [1e-10, 1e-4, 30.0, 1e4])
def test_products_of_many_alphas_keep_their_digits(thickness: float) -> None:
    """20,000 samples: in float32 a product of (1 - alpha) would stay 1, or be 0 long before the end."""
    count = 20_000
    rng = np.random.default_rng(0)
    sigma = rng.uniform(0.5, 1.5, count).astype(np.float32)
    sigma *= np.float32(thickness / (sigma.sum(dtype=np.float64) * 0.01))
    samples = Samples(np.linspace(1, 2, count, dtype=np.float32), np.array([0, count]), 0.01)
    ones = torch.ones(count, 4)
    pixels, _, log = composite(torch.from_numpy(sigma), ones, samples, np.arange(count, dtype=np.int32))
    opacity = -np.expm1(-min(thickness, -LOG_STOP))
    assert float(pixels[0, 0]) == pytest.approx(opacity, rel=1e-5 if thickness < 1 else 1e-4)
    assert float(-torch.expm1(log)[0]) == pytest.approx(float(pixels[0, 0]), rel=1e-6)


def homogeneous(logarithm: float, samples_per_ray: int = 64) -> Scene:
    """Return a box of one density, exp(`logarithm`)."""
    scene = initial_state(TrainNerf(**{**SMALL, "samples_per_ray": samples_per_ray}), BACKGROUNDS, 0).scene
    with torch.no_grad():
        for parameter in scene.field.parameters():
            parameter.zero_()
    scene.field.shape = scene.field.shape._replace(blob_density=0.0, density_bias=logarithm)
    return scene


def chords(camera: Camera, size: int) -> np.ndarray:
    """Return the length of each ray inside the box beyond NEAR, float64."""
    rays = make_rays([camera], size)
    o, d = rays.origins.astype(np.float64), rays.directions.astype(np.float64)
    with np.errstate(divide="ignore"):
        sides = np.sort([(-1 - o) / d, (1 - o) / d], axis=0)
    return np.maximum(sides[1].min(1) - np.maximum(sides[0].max(1), NEAR), 0)


@pytest.mark.parametrize(
    ("radius", "fov"), [(0.0, 1.2), (0.1, 1.2), (0.999, 1.2), (1.0, 1.2), (3.0, 0.9), (100.0, 0.025)]
)
def test_a_camera_inside_the_object_and_one_far_away(radius: float, fov: float) -> None:
    camera = orbit_camera(0.3, 1.1, radius, fov)
    scene = homogeneous(np.log(2.0))
    with torch.no_grad():
        seen = render_rays(scene, make_rays([camera], 12))
    truth = chords(camera, 12)
    assert truth.max() > 0.8
    # The midpoint rule errs by a step at most, and rays end early where nothing is left to be seen.
    error = np.abs(np.exp(-2 * truth) - seen.log_transmittance.exp().numpy())
    assert error.max() < 2 * scene.step
    assert (seen.log_transmittance.numpy()[truth == 0] == 0).all()


@pytest.mark.parametrize("radius", [1e3, 1e5, 1e7])
def test_beyond_float32s_reach_the_picture_is_still_one(radius: float) -> None:
    """Options end at 100; further out steps merge in rounding, but marching ends and nothing overflows."""
    views = render_views(homogeneous(3.0), [orbit_camera(0.3, 1.1, radius, 2.4 / radius)], 8)
    assert np.isfinite(views.latents).all()
    assert ((views.opacity >= 0) & (views.opacity <= 1)).all()
    if radius < 1e6:
        assert views.opacity.max() > 0.99


@pytest.mark.parametrize("logarithm", [-1e4, -27.6, 27.6, 1e4])
def test_an_empty_scene_is_its_background_and_a_full_one_a_wall(logarithm: float) -> None:
    scene = homogeneous(logarithm)
    scene.occupancy = occupancy.settle(
        np.ones((16,) * 3, np.bool_), lambda x: density(scene, x), scene.step, np.random.default_rng(0)
    )
    cameras = [orbit_camera(0.3, 1.1, 1.2, 1.0), orbit_camera(0, 1.5, 0.0, 1.0)]
    views = render_views(scene, cameras, 8)
    flat = BACKGROUNDS[0][:, None, None]
    if logarithm < 0:
        assert views.opacity.max() < 1e-10
        np.testing.assert_allclose(views.latents, np.broadcast_to(flat, views.latents.shape), rtol=1e-6)
        assert not views.depth.any()
    else:
        assert scene.occupancy.occupied.all()
        solid = np.stack([chords(camera, 8) for camera in cameras]).reshape(2, 8, 8) > 2 * scene.step
        assert (views.opacity[solid] == 1).all()
        assert (views.depth[solid] > 0).all()


def test_marching_through_nothing_gives_nothing() -> None:
    rays = make_rays([orbit_camera(0.3, 1.1, 1.5, 1.0)], 8)
    samples = march(rays, np.zeros((4, 4, 4), np.bool_), 0.05)
    assert len(samples.distances) == 0
    assert not samples.offsets.any()
