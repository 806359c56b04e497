"""Muon: momentum whose matrices are made orthogonal (Jordan et al. 2024,
https://kellerjordan.github.io/posts/muon/).

For weights that multiply: matrices, and convolutions as matrices of (outputs, inputs x kernel).
torch.optim.Muon takes matrices alone.
"""

from collections.abc import Iterable

import torch
from torch import Tensor

_MOMENTUM, _ITERATIONS = 0.95, 5


def orthogonal(matrices: Tensor, dtype: torch.dtype) -> Tensor:
    """Return about U V^T of the singular value decompositions U S V^T of matrices (..., m, n): five steps of
    a Newton-Schulz iteration in `dtype` that brings singular values to about 1 (.7 to 1.2)."""
    a, b, c = 3.4445, -4.7750, 2.0315
    x = (matrices / (matrices.norm(dim=(-2, -1), keepdim=True) + 1e-7)).to(dtype)
    tall = x.shape[-2] > x.shape[-1]
    x = x.mT if tall else x
    for _ in range(_ITERATIONS):
        gram = x @ x.mT
        x = a * x + (b * gram + c * gram @ gram) @ x
    return (x.mT if tall else x).to(matrices.dtype)


class Muon(torch.optim.Optimizer):
    """Nesterov momentum, made orthogonal, as long as the matrix's shape suggests."""

    def __init__(self, parameters: Iterable[Tensor], rate: float, decay: float, dtype: torch.dtype) -> None:
        super().__init__(parameters, {"lr": rate, "decay": decay})
        self.dtype = dtype

    @torch.no_grad()
    def step(self, closure: None = None) -> None:  # type: ignore[override]
        """Move all parameters that have a gradient, those of one shape together: many small products are
        slow, most of all on several cores."""
        for group in self.param_groups:
            alike: dict[tuple[int, int], list[tuple[Tensor, Tensor]]] = {}
            for parameter in group["params"]:
                if parameter.grad is None:
                    continue
                state = self.state[parameter]
                if not state:
                    state["momentum"] = torch.zeros_like(parameter)
                momentum = state["momentum"].mul_(_MOMENTUM).add_(parameter.grad)
                matrix = parameter.grad.add(momentum, alpha=_MOMENTUM).reshape(len(parameter), -1)
                alike.setdefault((matrix.shape[0], matrix.shape[1]), []).append((parameter, matrix))
            for (rows, columns), members in alike.items():
                longer = max(1.0, rows / columns) ** 0.5
                steps = orthogonal(torch.stack([matrix for _, matrix in members]), self.dtype)
                for (parameter, _), step in zip(members, steps, strict=True):
                    parameter.mul_(1 - group["lr"] * group["decay"])
                    parameter.add_(step.reshape(parameter.shape), alpha=-group["lr"] * longer)
