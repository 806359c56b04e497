"""Adam (Kingma and Ba 2015), the optimiser of every scene: torch's own fused step without torch's own class.

`torch.optim.Adam` imports torch's compiler when it is made, which nothing here uses: 3 seconds before the
first step of a run that takes 40. Steps and state are that class's, bit for bit.
"""

from collections.abc import Iterable

import torch
from torch import Tensor, nn

BETAS, EPSILON = (0.9, 0.99), 1e-15  # as the paper's code has them
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
            pairs = [(p, p.grad) for p in parameters if p.grad is not None]
            if not pairs:
                continue
            moved: list[Tensor] = [p for p, _ in pairs]
            for p, _ in pairs:
                if p not in self.state:
                    zeros = {name: torch.zeros_like(p.detach()) for name in ("exp_avg", "exp_avg_sq")}
                    self.state[p] = {"step": torch.zeros(()), **zeros}
            steps, first, second = (
                [self.state[p][name] for p, _ in pairs] for name in ("step", "exp_avg", "exp_avg_sq")
            )
            torch._foreach_add_(steps, 1)
            with torch.no_grad():
                torch._fused_adam_(
                    moved,
                    [gradient for _, gradient in pairs],
                    first,
                    second,
                    [],
                    steps,
                    lr=share * rate,
                    beta1=BETAS[0],
                    beta2=BETAS[1],
                    weight_decay=0.0,
                    eps=EPSILON,
                    amsgrad=False,
                    maximize=False,
                )


def rate_share(cooling: float, progress: float) -> float:
    """Return the share of the learning rates at `progress` in [0, 1] of a run: 1 until its last share
    `cooling`, over which it falls linearly to a tenth.

    Noise and views are drawn anew each step, so at a constant rate what is learned trembles around what it
    has come to; the more so, the longer it has had for it.
    """
    cooled = (progress - (1 - cooling)) / cooling if cooling else 0.0
    return 1 - (1 - _COLDEST) * min(max(cooled, 0.0), 1.0)
