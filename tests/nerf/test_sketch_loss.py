"""The loss of the paper's equation, against that equation as it stands."""

import numpy as np
import pytest
import torch
import trimesh

from pipeline.nerf.scene import density as scene_density
from pipeline.nerf.sketch_loss import LEAST_WEIGHT, LENGTH, nearest_judged, shape_loss, unjudged_share
from pipeline.nerf.step import initial_state, training_step
from pipeline.options.nerf import TrainNerf
from pipeline.sketch.lattice import Sketch, look_up, solid_cells, volume_iou
from pipeline.sketch.winding import tabulate
from tests.nerf.test_step import BACKGROUNDS, SMALL, no_guidance

POINTS = np.random.default_rng(0).uniform(-1, 1, (5000, 3)).astype(np.float32)


@pytest.fixture(scope="module")
def bar() -> Sketch:
    """A bar whose ends are far from the middle, where the blob would be."""
    box = trimesh.creation.box([1.4, 0.4, 0.4])
    return tabulate(box.vertices, box.faces, 32, "bar")


def equation(sketch: Sketch, sigma: float, density: torch.Tensor) -> torch.Tensor:
    """Return CE(alpha, inside) (1 - exp(-d^2 / (2 sigma^2))), the mean over POINTS, in double precision."""
    inside, distance = look_up(sketch, POINTS)
    alpha = 1 - torch.exp(-LENGTH * density)
    entropy = torch.nn.functional.binary_cross_entropy(
        alpha, torch.from_numpy(inside).double(), reduction="none"
    )
    d = torch.from_numpy(distance).double()
    return (entropy * (1 - torch.exp(-d.square() / (2 * sigma**2)))).mean()


@pytest.mark.parametrize("sigma", [0.05, 0.3, 1.5])
def test_value_and_gradient_are_the_equations(bar: Sketch, sigma: float) -> None:
    density = np.random.default_rng(1).gamma(0.5, 10, len(POINTS)).astype(np.float32) + np.float32(1e-3)
    exact = torch.from_numpy(density).double().requires_grad_()
    reference = equation(bar, sigma, exact)
    reference.backward()
    loss, gradient = shape_loss(bar, sigma, POINTS, density)
    assert loss == pytest.approx(reference.item(), rel=1e-3)
    assert exact.grad is not None
    truth = exact.grad.numpy()
    judged = gradient != 0
    np.testing.assert_allclose(gradient[judged], truth[judged], rtol=2e-3)
    _, distance = look_up(bar, POINTS)
    np.testing.assert_array_equal(judged, distance >= nearest_judged(sigma))
    weight = 1 - np.exp(-(nearest_judged(sigma) ** 2) / (2 * sigma**2))
    assert weight == pytest.approx(LEAST_WEIGHT)


def test_the_share_left_out_is_that_of_random_points(bar: Sketch) -> None:
    assert unjudged_share(bar, 0.01) < unjudged_share(bar, 1.5) < 0.2
    _, gradient = shape_loss(bar, 1.5, POINTS, np.ones(len(POINTS), np.float32))
    assert unjudged_share(bar, 1.5) == pytest.approx((gradient == 0).mean(), abs=0.02)


def test_any_density_gives_finite_numbers(bar: Sketch) -> None:
    for value in (0.0, 1e-38, 1e-6, 1.0, 1e3, 3.3e6):
        loss, gradient = shape_loss(bar, 0.05, POINTS, np.full(len(POINTS), value, np.float32))
        assert np.isfinite(loss)
        assert np.isfinite(gradient).all()


def test_it_is_normalised_by_the_number_of_points(bar: Sketch) -> None:
    density = np.ones(len(POINTS), np.float32)
    once = shape_loss(bar, 0.3, POINTS, density)
    twice = shape_loss(bar, 0.3, np.repeat(POINTS, 2, axis=0), np.repeat(density, 2))
    assert twice[0] == pytest.approx(once[0], rel=1e-5)
    np.testing.assert_allclose(2 * twice[1][::2], once[1], rtol=1e-5)


def test_points_at_the_surface_alone_cost_and_say_nothing(bar: Sketch) -> None:
    surface = np.array([[0.7, 0, 0], [0.1, 0.2, 0], [0, 0, -0.2]], np.float32)
    loss, gradient = shape_loss(bar, 10.0, surface, np.ones(3, np.float32))
    assert loss == 0
    assert not gradient.any()
    assert shape_loss(bar, 0.3, surface[:0], np.ones(0, np.float32))[0] == 0


def trained(sketch: Sketch, **options: float) -> tuple[float, float]:
    """Return the agreement of scene and sketch in volume at the start and after training without guidance."""
    plain = {"steps": 40, "updates_per_call": 1, "sparsity_weight": 0.0, "sigma_s": 0.05}
    settings = TrainNerf(**{**plain, **SMALL, **options})
    state = initial_state(settings, BACKGROUNDS, 0, sketch)
    inside, _ = look_up(sketch, POINTS)

    def agreement() -> float:
        return volume_iou(scene_density(state.scene, POINTS) * LENGTH > np.log(2), inside)

    start = agreement()
    for _ in range(settings.steps):
        training_step(state, settings, 12, no_guidance, sketch=sketch)
        assert state.scene.occupancy.occupied[solid_cells(sketch, 64)].all(), "the inside is always sampled"
    return start, agreement()


def test_a_scene_grows_into_its_sketch_and_stays(bar: Sketch) -> None:
    start, end = trained(bar)
    assert start > 0.8
    assert end > 0.85


def test_the_weight_acts(bar: Sketch) -> None:
    """Against a push to transparency only the loss keeps the sketch."""
    free, held = (trained(bar, shape_weight=weight, opacity_weight=100.0)[1] for weight in (0.0, 1000.0))
    assert held > 0.8 > free + 0.2


def test_without_a_start_the_loss_alone_grows_it(bar: Sketch) -> None:
    start, end = trained(bar, shape_start=0, steps=80, emptiness_weight=0.0, grid_learning_rate=0.03)
    assert start < 0.2
    assert end > 0.7
