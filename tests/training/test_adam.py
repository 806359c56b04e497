"""The optimiser against torch's own, and what it does without."""

import subprocess
import sys

import pytest
import torch
from torch import nn

from pipeline.training.adam import BETAS, EPSILON, Adam, rate_share


def parameters() -> list[nn.Parameter]:
    generator = torch.Generator().manual_seed(0)
    return [nn.Parameter(torch.randn(size, generator=generator)) for size in ((300, 2), (7, 5), (3,))]


def test_steps_are_those_of_torch_in_float64() -> None:
    ours, theirs = parameters(), [nn.Parameter(p.detach().double()) for p in parameters()]
    adam = Adam([(ours[:1], 1e-2), (ours[1:], 1e-3), ([], 1.0)])
    groups = [{"params": theirs[:1], "lr": 1e-2}, {"params": theirs[1:], "lr": 1e-3}]
    reference = torch.optim.Adam(groups, betas=BETAS, eps=EPSILON)
    generator = torch.Generator().manual_seed(1)
    for step in range(50):
        share = 1 - step / 100
        for group, rate in zip(reference.param_groups, (1e-2, 1e-3), strict=True):
            group["lr"] = share * rate
        for i, (p, q) in enumerate(zip(ours, theirs, strict=True)):
            # The last one has a gradient now and then only: the others' steps do not count for it.
            missing = i == 2 and step % 3
            drawn = torch.randn(p.shape, generator=generator) * 10.0 ** (step % 7 - 3)
            p.grad = None if missing else drawn
            q.grad = None if missing else drawn.double()
        adam.step(share)
        reference.step()
    for p, q in zip(ours, theirs, strict=True):
        torch.testing.assert_close(p, q, rtol=1e-5, atol=1e-6, check_dtype=False)
        for name in ("step", "exp_avg", "exp_avg_sq"):
            ours_now, theirs_now = adam.state[p][name], reference.state[q][name]
            torch.testing.assert_close(ours_now, theirs_now, rtol=1e-4, atol=1e-6, check_dtype=False)
    adam.clear_gradients()
    before = [p.detach().clone() for p in ours]
    adam.step()
    assert all(torch.equal(p, b) for p, b in zip(ours, before, strict=True)), "without gradients all rests"


def test_a_step_does_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    moved = []
    for count in (1, 3):
        monkeypatch.setattr("pipeline.kernels.parallel.threads", lambda count=count: count)
        parameter = nn.Parameter(torch.linspace(-1, 1, 100_000).reshape(-1, 2))
        adam = Adam([([parameter], 1e-2)])
        for _ in range(3):
            parameter.grad = parameter.detach().sin()
            adam.step()
        moved.append(parameter.detach().clone())
    assert torch.equal(*moved)


def test_nothing_moves_without_a_gradient_of_its_own() -> None:
    """A hash table's entries that no sample met: zero gradients, zero moments."""
    parameter = nn.Parameter(torch.ones(1000))
    adam = Adam([([parameter], 1e-2)])
    parameter.grad = torch.zeros(1000)
    parameter.grad[7] = 1e-30
    adam.step()
    assert torch.isfinite(parameter).all()
    assert (parameter.detach() != 1).sum() <= 1


def test_a_training_does_not_import_torchs_compiler() -> None:
    """Its import is most of the start of a short run."""
    program = (
        "import sys, numpy as np\n"
        "from pipeline.options.nerf import TrainNerf\n"
        "from pipeline.nerf.step import initial_state, training_step\n"
        "options = TrainNerf(steps=2, samples_per_ray=8, grid_levels=2, grid_finest=32, cameras_per_step=1)\n"
        "state = initial_state(options, np.zeros((1, 4), np.float32), 0)\n"
        "training_step(state, options, 4, lambda latents, batch: latents)\n"
        "print('torch._dynamo' in sys.modules)\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "False"


def test_the_rate_falls_to_a_tenth_over_the_last_share() -> None:
    assert [rate_share(0.5, p) for p in (0, 0.5, 0.75, 1)] == pytest.approx([1, 1, 0.55, 0.1])
    assert [rate_share(1.0, p) for p in (0, 0.5, 1)] == pytest.approx([1, 0.55, 0.1])
    assert [rate_share(0.0, p) for p in (0, 0.5, 1)] == [1, 1, 1]
    assert rate_share(0.01, 0.9) == 1
    assert rate_share(0.5, 1.2) == pytest.approx(0.1), "steps beyond the last do not climb again"
