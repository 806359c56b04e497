"""Adam (Kingma and Ba 2015), the optimiser of every scene, by a kernel of one pass.

`torch.optim.Adam` imports torch's compiler when it is made, which nothing here uses: 3 seconds before the
first step of a run that takes 40. Steps are that class's to rounding.
"""

from collections.abc import Iterable

import numpy as np
import torch
from torch import Tensor, nn

from pipeline.kernels import adam as kernel
from pipeline.kernels import parallel

BETAS, EPSILON = (0.9, 0.99), 1e-15  # as the paper's code has them
_BLOCK = 16_384
"""Elements moved together, at least."""
_COLDEST = 0.1
"""Share of the learning rates that is left at the end of a cooling."""


class Adam:
    """Parameters in groups with a learning rate each, and the moments of their gradients."""

    def __init__(self, groups: Iterable[tuple[list[nn.Parameter], float]]) -> None:
        self.groups = [(parameters, rate) for parameters, rate in groups if parameters]
        self.state: dict[nn.Parameter, dict[str, Tensor]] = {}
        """`step`, `exp_avg` and `exp_avg_sq` of each parameter that was moved."""

    @property
    def parameters(self) -> list[nn.Parameter]:
        """All parameters, group after group."""
        return [p for parameters, _ in self.groups for p in parameters]

    def clear_gradients(self) -> None:
        """Forget all gradients."""
        for parameter in self.parameters:
            parameter.grad = None

    def step(self, share: float = 1.0) -> None:
        """Move every parameter that has a gradient, at that share of its rate."""
        for parameters, rate in self.groups:
            for parameter in parameters:
                if parameter.grad is not None:
                    self._move(parameter, parameter.grad, share * rate)

    def _move(self, parameter: nn.Parameter, gradient: Tensor, rate: float) -> None:
        if parameter not in self.state:
            zeros = {name: torch.zeros_like(parameter.detach()) for name in ("exp_avg", "exp_avg_sq")}
            self.state[parameter] = {"step": torch.zeros(()), **zeros}
        state = self.state[parameter]
        state["step"] += 1
        first, second = (1 - beta ** float(state["step"]) for beta in BETAS)
        factors = (1 - BETAS[0], 1 - BETAS[1], rate / first, second**0.5, EPSILON)
        arrays = (parameter.detach(), gradient.contiguous(), state["exp_avg"], state["exp_avg_sq"])
        parallel.run(
            kernel.step,
            parameter.numel(),
            *(tensor.view(-1).numpy() for tensor in arrays),
            np.array(factors, np.float32),
            block=_BLOCK,
        )


def rate_share(cooling: float, progress: float) -> float:
    """Return the share of the learning rates at `progress` in [0, 1] of a run: 1 until its last share
    `cooling`, over which it falls linearly to a tenth.

    Noise and views are drawn anew each step, so at a constant rate what is learned keeps a noise around
    what it has come to; the more so, the longer it has had for it.
    """
    cooled = (progress - (1 - cooling)) / cooling if cooling else 0.0
    return 1 - (1 - _COLDEST) * min(max(cooled, 0.0), 1.0)
