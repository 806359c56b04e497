"""The passes between the field's matrix products against torch's own operations."""

import numpy as np
import pytest
import torch

from pipeline.kernels import activation

RNG = np.random.default_rng(0)


def draw(*shape: int) -> np.ndarray:
    return RNG.standard_normal(shape).astype(np.float32)


def test_relu_and_its_gradient_are_torchs() -> None:
    before, bias, gradient = draw(100, 64), draw(64), draw(100, 64)
    hidden = before.copy()
    activation.relu(hidden, bias)
    source = torch.from_numpy(before).requires_grad_()
    offset = torch.from_numpy(bias).requires_grad_()
    wanted = torch.relu(source + offset)
    np.testing.assert_array_equal(hidden, wanted.detach().numpy())
    wanted.backward(torch.from_numpy(gradient))
    sums = np.full(64, 7, np.float32)
    activation.relu_backward(gradient, hidden, sums)
    assert source.grad is not None
    assert offset.grad is not None
    np.testing.assert_array_equal(gradient, source.grad.numpy())
    np.testing.assert_allclose(sums, offset.grad.numpy(), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("count", [1, 4, 103])
def test_the_layer_behind_relu_is_a_matrix_product(count: int) -> None:
    before, bias, weight, output_bias = draw(count, 64), draw(64), draw(5, 64), draw(5)
    hidden, output = before.copy(), np.full((count, 5), 7, np.float32)
    activation.relu_linear(hidden, bias, weight, output_bias, output)
    wanted = np.maximum(before + bias, 0).astype(np.float64) @ weight.T + output_bias
    np.testing.assert_array_equal(hidden, np.maximum(before + bias, 0))
    np.testing.assert_allclose(output, wanted, rtol=1e-5, atol=2e-5)


def test_density_and_latents_are_those_of_the_formula() -> None:
    output, points = 8 * draw(200, 5), draw(200, 3)
    constants = np.array([5, -12.5, -3, 2, 15], np.float32)
    density, latents = np.empty(200, np.float32), np.empty((200, 4), np.float32)
    activation.activate(output, points, constants, density, latents)
    squared = np.square(points, dtype=np.float64).sum(1)
    logarithm = output[:, 0] - 3 + 5 * np.exp(-12.5 * squared)
    np.testing.assert_allclose(density, 2 * np.exp(np.minimum(logarithm, 15)), rtol=1e-5)
    assert (logarithm > 15).any()
    np.testing.assert_array_equal(latents, output[:, 1:])

    by_density, by_latents, gradient = draw(200), draw(200, 4), np.empty((200, 5), np.float32)
    activation.activate_backward(by_density, by_latents, density, np.float32(0.01), gradient)
    np.testing.assert_allclose(gradient[:, 0], by_density * np.maximum(density, 0.01), rtol=1e-6)
    np.testing.assert_array_equal(gradient[:, 1:], by_latents)


@pytest.mark.parametrize("place", ["output", "density", "hidden", "gradient"])
def test_a_nan_is_not_lost(place: str) -> None:
    values = {"output": draw(4, 5), "density": np.ones(4, np.float32), "hidden": draw(4, 8)}
    values["gradient"] = draw(4, 8)
    values[place][1] = np.nan
    density, latents = np.empty(4, np.float32), np.empty((4, 4), np.float32)
    activation.activate(
        values["output"], np.zeros((4, 3), np.float32), np.ones(5, np.float32), density, latents
    )
    gradient = np.empty((4, 5), np.float32)
    ones = np.ones(4, np.float32)
    activation.activate_backward(ones, np.ones((4, 4), np.float32), values["density"], ones[0], gradient)
    activation.relu(values["hidden"], np.zeros(8, np.float32))
    sums = np.empty(8, np.float32)
    activation.relu_backward(values["gradient"], np.ones((4, 8), np.float32), sums)
    outputs = np.empty((4, 5), np.float32)
    activation.relu_linear(values["hidden"].copy(), np.zeros(8, np.float32), draw(5, 8), draw(5), outputs)
    assert np.isnan(outputs).any() == (place == "hidden")
    results = {"output": density, "density": gradient, "hidden": values["hidden"], "gradient": sums}
    for name, result in results.items():
        assert np.isnan(result).any() == (name == place)
