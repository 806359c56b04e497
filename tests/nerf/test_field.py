"""The field and its handwritten gradient against torch's autograd in float64."""

import numpy as np
import pytest
import torch
from torch import Tensor

from pipeline.kernels import parallel
from pipeline.nerf.field import FieldShape, LatentField
from tests.nerf.test_grid_levels import reference_encode

SHAPE = FieldShape(levels=6, finest=64, table_log2=12, density_bias=-0.5)


def make_field(seed: int = 0) -> LatentField:
    rng = np.random.default_rng(seed)
    field = LatentField(SHAPE, rng)
    with torch.no_grad():
        field.table.copy_(torch.from_numpy(rng.standard_normal(field.table.shape).astype(np.float32)))
    field.sharpening = 2.5
    return field


def reference(field: LatentField, points: np.ndarray) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
    """Return density and latents in float64 with the parameters they depend on (features as leaves)."""
    leaves = {n: p.detach().double().requires_grad_() for n, p in field.named_parameters() if n != "table"}
    features = torch.from_numpy(reference_encode(field.grid, field.table.detach().numpy(), points))
    leaves["features"] = features.requires_grad_()
    hidden = torch.relu(features @ leaves["weight1"].T + leaves["bias1"])
    hidden = torch.relu(hidden @ leaves["weight2"].T + leaves["bias2"])
    raw = hidden @ leaves["weight3"].T + leaves["bias3"]
    squared = torch.from_numpy((points.astype(np.float64) ** 2).sum(1))
    blob = 5.0 * torch.exp(-squared / (2 * 0.2**2)) - 0.5
    return 2.5 * torch.exp(raw[:, 0] + blob), raw[:, 1:], leaves


@pytest.fixture
def points() -> np.ndarray:
    return np.random.default_rng(1).uniform(-1, 1, (5000, 3)).astype(np.float32)


def test_values_match_reference(points: np.ndarray) -> None:
    field = make_field()
    segment = field.evaluate(torch.from_numpy(points))
    density, latents, _ = reference(field, points)
    np.testing.assert_allclose(segment.density.numpy(), density.detach().numpy(), rtol=2e-4)
    np.testing.assert_allclose(segment.latents.numpy(), latents.detach().numpy(), atol=2e-5)


def test_gradient_matches_autograd(points: np.ndarray) -> None:
    field = make_field()
    segments = [field.evaluate(torch.from_numpy(part)) for part in (points[:3000], points[3000:])]
    density, latents = field.attach(segments)
    rng = np.random.default_rng(2)
    by_density, by_latents = rng.standard_normal(5000), rng.standard_normal((5000, 4))
    torch.autograd.backward(
        [density, latents], [torch.from_numpy(g.astype(np.float32)) for g in (by_density, by_latents)]
    )
    exact = reference(field, points)
    torch.autograd.backward(list(exact[:2]), [torch.from_numpy(by_density), torch.from_numpy(by_latents)])
    for name, leaf in exact[2].items():
        assert leaf.grad is not None
        if name == "features":
            continue
        found = field.get_parameter(name).grad
        assert found is not None
        # Not element by element: where an activation is about zero, rounding decides which side it is on.
        assert (found - leaf.grad).norm() < 2e-3 * leaf.grad.norm(), name
    # The table's gradient through the exact feature gradient: encoding is linear, so use its adjoint.
    by_features = exact[2]["features"].grad
    assert by_features is not None
    assert field.table.grad is not None
    for seed in range(3):
        direction = np.random.default_rng(seed).standard_normal(field.table.shape)
        expected = np.vdot(reference_encode(field.grid, direction, points), by_features.numpy())
        found_change = np.vdot(direction, field.table.grad.numpy().astype(np.float64))
        assert found_change == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("logarithm", [-1e30, -100.0, 100.0, 1e30])
def test_extreme_densities_stay_finite(points: np.ndarray, logarithm: float) -> None:
    field = make_field()
    with torch.no_grad():
        field.weight3[0] = 0
        field.bias3[0] = logarithm
    density, latents = field.attach([field.evaluate(torch.from_numpy(points))])
    (density.sum() + latents.sum()).backward()
    assert torch.isfinite(density).all()
    assert (density >= 0).all()
    for parameter in field.parameters():
        assert parameter.grad is not None
        assert torch.isfinite(parameter.grad).all()


def test_threads_do_not_change_a_bit(points: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    results = []
    for count in (1, 2, 3):
        monkeypatch.setattr(parallel, "threads", lambda count=count: count)
        field = make_field()
        density, latents = field.attach([field.evaluate(torch.from_numpy(points))])
        (density.sum() + latents.square().sum()).backward()
        results.append([density, latents, *(p.grad for p in field.parameters())])
    for other in results[1:]:
        for left, right in zip(results[0], other, strict=True):
            assert torch.equal(left, right)


def test_no_points_give_no_values_and_zero_gradients() -> None:
    field = make_field()
    density, latents = field.attach([])
    (density.sum() + latents.sum()).backward()
    assert density.shape == (0,)
    assert field.weight1.grad is not None
    assert not field.weight1.grad.any()


def test_blob_is_densest_in_the_centre() -> None:
    field = LatentField(FieldShape(), np.random.default_rng(0))
    axis = torch.zeros(5, 3)
    axis[:, 0] = torch.tensor([0, 0.1, 0.2, 0.4, 0.9])
    density = field.evaluate(axis).density
    assert (density[:-1] > density[1:]).all()
    assert density[0] / density[-1] == pytest.approx(np.exp(5), rel=0.05)


def test_memory_is_used_again_after_the_gradient_and_not_before(points: np.ndarray) -> None:
    field, fresh = make_field(), make_field()
    places = [torch.from_numpy(part) for part in (points[:3000], points[3000:])]
    for _ in range(3):
        segments = [field.evaluate(place) for place in places]
        assert len({segment.memory.data_ptr() for segment in segments}) == 2
        density, latents = field.attach(segments)
        field.zero_grad()
        (density.sum() + latents.square().sum()).backward()
    assert len(field.spare) == 2
    expected, latents = fresh.attach([fresh.evaluate(place) for place in places])
    (expected.sum() + latents.square().sum()).backward()
    assert torch.equal(density, expected)
    for mine, other in zip(field.parameters(), fresh.parameters(), strict=True):
        assert mine.grad is not None
        assert other.grad is not None
        assert torch.equal(mine.grad, other.grad)


def test_a_second_gradient_of_the_same_segments_is_refused(points: np.ndarray) -> None:
    field = make_field()
    density, latents = field.attach([field.evaluate(torch.from_numpy(points))])
    total = density.sum() + latents.sum()
    total.backward(retain_graph=True)
    with pytest.raises(RuntimeError, match="evaluate the field again"):
        total.backward()
