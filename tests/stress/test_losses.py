"""Every loss where it is clamped: value, gradient and direction are those of the clamped formula."""

import numpy as np
import pytest
import torch
import trimesh

from pipeline.nerf import occupancy
from pipeline.nerf.field import FieldShape, LatentField
from pipeline.nerf.sketch_loss import LENGTH, nearest_judged, shape_loss
from pipeline.nerf.step import binary_entropy, initial_state, unseen_thickness
from pipeline.options.nerf import TrainNerf
from pipeline.sketch.lattice import Sketch, look_up
from pipeline.sketch.winding import tabulate
from tests.nerf.test_step import BACKGROUNDS, SMALL


@pytest.mark.parametrize("opacity", [0.0, 1e-45, 1e-12, 0.9e-5, 1.1e-5, 0.3, 1 - 1.2e-5, 1 - 6e-8, 1.0])
def test_entropy_at_its_clamp(opacity: float) -> None:
    leaf = torch.tensor([opacity], requires_grad=True)
    value = binary_entropy(leaf)
    value.sum().backward()
    given = float(leaf.detach())
    o = min(max(given, 1e-5), 1 - 1e-5)
    assert float(value.detach()) == pytest.approx(-o * np.log(o) - (1 - o) * np.log1p(-o), rel=5e-3)
    assert leaf.grad is not None
    free = 1e-5 <= given <= 1 - 1e-5
    assert float(leaf.grad) == pytest.approx(np.log1p(-o) - np.log(o) if free else 0.0, rel=5e-3)


def test_entropy_of_any_thickness_has_a_finite_gradient_by_it() -> None:
    """As training has it: opacity = -expm1(log transmittance), whose slope is the transmittance."""
    log = torch.tensor([-0.0, -1e-38, -1e-12, -1e-5, -0.7, -12.0, -1e2, -1e12, -3e38]).requires_grad_()
    entropy = binary_entropy(-torch.expm1(log))
    (entropy.sum() + (-torch.expm1(log)).sum()).backward()
    assert torch.isfinite(entropy).all()
    assert log.grad is not None
    assert torch.isfinite(log.grad).all()


@pytest.fixture(scope="module")
def box() -> Sketch:
    mesh = trimesh.creation.box([1.0, 1.0, 1.0])
    return tabulate(mesh.vertices, mesh.faces, 16, "box")


@pytest.mark.parametrize(
    "density", [0.0, 1e-45, 1e-12, np.exp(-15), 1e-3, 1.0, 399.0, 401.0, 1e6, 1e12, 1e30]
)
def test_the_sketchs_loss_at_its_clamps(box: Sketch, density: float) -> None:
    sigma = 0.1
    points = np.random.default_rng(0).uniform(-1, 1, (500, 3)).astype(np.float32)
    inside, distance = look_up(box, points)
    judged = distance >= nearest_judged(sigma)
    loss, gradient = shape_loss(box, sigma, points, np.full(500, density, np.float32))
    thickness = max(float(np.float32(density)), np.exp(-15)) * LENGTH
    held = min(thickness, 80.0)
    weight = -np.expm1(-(distance.astype(np.float64) ** 2) / (2 * sigma**2)) / 500 * judged
    entropy = np.where(inside, -np.log(-np.expm1(-held)), thickness)
    slope = np.where(inside, -1 / np.expm1(held), 1.0) * LENGTH
    assert loss == pytest.approx(float(weight @ entropy), rel=2e-3)
    np.testing.assert_allclose(gradient, weight * slope, rtol=2e-3, atol=1e-37)
    assert (gradient[inside & judged] <= 0).all(), "inside is never told to thin out"
    assert (gradient[~inside & judged] > 0).all(), "outside is never told to thicken"


@pytest.mark.parametrize("sigma", [1e-2, 10.0])
def test_the_sketchs_loss_is_the_finite_difference(box: Sketch, sigma: float) -> None:
    points = np.random.default_rng(1).uniform(-1, 1, (300, 3)).astype(np.float32)
    density = (10 ** np.random.default_rng(2).uniform(-2, 1, 300)).astype(np.float32)
    _, gradient = shape_loss(box, sigma, points, density)
    move = (1e-2 * density * np.random.default_rng(3).standard_normal(300)).astype(np.float32)
    higher, lower = (shape_loss(box, sigma, points, density + sign * move)[0] for sign in (1, -1))
    assert (higher - lower) / 2 == pytest.approx(float(gradient @ move), rel=2e-2)


@pytest.mark.parametrize("logarithm", [-1e30, -100.0, -15.0, 0.0, 15.0, 100.0, 1e30])
def test_the_emptiness_of_unseen_cells_at_the_densitys_clamp(logarithm: float) -> None:
    state = initial_state(TrainNerf(**SMALL), BACKGROUNDS, 0)
    with torch.no_grad():
        for parameter in state.scene.field.parameters():
            parameter.zero_()
    state.scene.field.shape = state.scene.field.shape._replace(blob_density=0.0, density_bias=logarithm)
    state.scene.occupancy = occupancy.Occupancy(np.zeros((4,) * 3, np.float32), np.zeros((4,) * 3, np.bool_))
    thickness = unseen_thickness(state.scene, state.rng)
    thickness.backward()
    assert float(thickness.detach()) == pytest.approx(2 * np.exp(min(logarithm, 15.0)), rel=1e-4)
    slope = state.scene.field.bias3.grad
    assert slope is not None
    # Below exp(-15) the slope stays that of exp(-15): a density may always come back.
    assert float(slope[0]) == pytest.approx(2 * np.exp(np.clip(logarithm, -15.0, 15.0)), rel=1e-4)


def test_the_fields_gradient_is_the_finite_difference() -> None:
    """Along random directions of all parameters; float32, so the differences are wide and the bound loose."""
    rng = np.random.default_rng(0)
    field = LatentField(FieldShape(levels=4, finest=32, table_log2=10, density_bias=-0.5), rng)
    with torch.no_grad():
        field.table.mul_(3e3)
    points = torch.from_numpy(rng.uniform(-1, 1, (400, 3)).astype(np.float32))
    by_density, by_latents = rng.standard_normal(400), rng.standard_normal((400, 4))

    def value() -> float:
        segment = field.evaluate(points)
        return float(
            (segment.density.numpy() * by_density).sum() + (segment.latents.numpy() * by_latents).sum()
        )

    density, latents = field.attach([field.evaluate(points)])
    torch.autograd.backward(
        [density, latents], [torch.from_numpy(g.astype(np.float32)) for g in (by_density, by_latents)]
    )
    start = {name: p.detach().clone() for name, p in field.named_parameters()}
    for name, parameter in field.named_parameters():
        assert parameter.grad is not None
        move = parameter.grad / parameter.grad.norm() * 1e-3 * (30 if name == "table" else 1)
        results = []
        for sign in (1, -1):
            with torch.no_grad():
                parameter.copy_(start[name] + sign * move)
            results.append(value())
        with torch.no_grad():
            parameter.copy_(start[name])
        product = float((parameter.grad.double() * move.double()).sum())
        assert (results[0] - results[1]) / 2 == pytest.approx(product, rel=2e-2), name
