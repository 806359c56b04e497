"""Gradients handed on: to the bit those of torch, without what torch imports for them."""

import subprocess
import sys

import pytest
import torch
from torch import Tensor

from pipeline.training.backward import backward


def outputs(leaves: list[Tensor]) -> list[Tensor]:
    """Two that share their leaves, of which one is used twice, and a scalar."""
    first, second = leaves
    hidden = torch.tanh(first @ second)
    return [hidden * first.sum(), hidden.exp(), hidden.square().mean()]


def test_the_gradients_are_torchs_to_the_bit() -> None:
    generator = torch.Generator().manual_seed(0)
    values = [torch.randn(size, generator=generator) for size in ((40, 30), (30, 20))]
    ours, theirs = ([value.clone().requires_grad_() for value in values] for _ in range(2))
    given = [torch.randn(out.shape, generator=generator) for out in outputs(ours)]
    backward(outputs(ours), given)
    torch.autograd.backward(outputs(theirs), given)
    for one, other in zip(ours, theirs, strict=True):
        assert one.grad is not None
        assert other.grad is not None
        assert torch.equal(one.grad, other.grad)


def test_gradients_are_added_to_those_that_are_there() -> None:
    leaf = torch.zeros(3, requires_grad=True)
    backward([2 * leaf], [torch.tensor([1.0, 2.0, 3.0])])
    backward([leaf], [torch.ones(3)])
    assert leaf.grad is not None
    assert leaf.grad.tolist() == [3.0, 5.0, 7.0]


def test_a_gradient_is_not_broadcast() -> None:
    leaf = torch.zeros(3, 1, requires_grad=True)
    with pytest.raises(ValueError, match=r"a gradient of shape \(3,\) for \(3, 1\)"):
        backward([leaf], [torch.ones(3)])


def test_nothing_more_is_imported() -> None:
    code = (
        "import sys, torch; from pipeline.training.backward import backward; "
        "leaf = torch.zeros(3, requires_grad=True); backward([2 * leaf], [torch.ones(3)]); "
        "assert leaf.grad.sum() == 6; sys.exit('sympy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
