"""Given the gradient by what a scene has made, the gradient by what it is made of.

The same as ``torch.autograd.backward(outputs, gradients)``, to the bit: the gradient of the inner product
<outputs, gradients> by the outputs is the gradients. Handed gradients, torch imports its symbolic shapes and
sympy to compare sizes, which takes a process more than a second of its first step.
"""

from collections.abc import Sequence

import torch
from torch import Tensor


def backward(outputs: Sequence[Tensor], gradients: Sequence[Tensor]) -> None:
    """Add the gradients by all leaves below `outputs` to those that these have; `gradients[i]` is the one by
    `outputs[i]`, of its shape.

    Raises:
        ValueError: shapes that differ: they would be broadcast.
    """
    inner_product(outputs, gradients).backward()


def inner_product(outputs: Sequence[Tensor], gradients: Sequence[Tensor]) -> Tensor:
    """Return <outputs, gradients>, a scalar; see `backward`."""
    for output, gradient in zip(outputs, gradients, strict=True):
        if output.shape != gradient.shape:
            raise ValueError(f"a gradient of shape {tuple(gradient.shape)} for {tuple(output.shape)}")
    products = [(output * gradient).sum() for output, gradient in zip(outputs, gradients, strict=True)]
    return torch.stack(products).sum()
