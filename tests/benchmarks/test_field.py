"""The field benchmark: its plain side computes the same as the kernels, and it runs on a small size."""

from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks import _kernels, _plain, field
from benchmarks._plots import write_fronts
from benchmarks._timing import Pace, compared, in_turn
from benchmarks._trials import job_of
from benchmarks._truths import analytic_scenes
from pipeline.nerf.rendering import march, render_rays
from pipeline.nerf.scene import Scene
from pipeline.options.nerf import TrainNerf


@pytest.fixture
def options() -> TrainNerf:
    small = {"samples_per_ray": 24, "grid_levels": 6, "grid_finest": 40, "grid_table_log2": 12, "steps": 3}
    return job_of("draft", **small).train_nerf


@pytest.fixture
def scene(options: TrainNerf) -> Scene:
    return _kernels.foggy(options)


def test_plain_torch_renders_the_same_and_has_the_same_gradients(scene: Scene) -> None:
    rays = _kernels.view_rays(12)
    seen = render_rays(scene, rays)
    for everything in (False, True):
        pixels, dimmed, count = _plain.render(scene, rays, everything)
        torch.testing.assert_close(pixels, seen.latents, rtol=1e-3, atol=1e-4)
        torch.testing.assert_close(dimmed, seen.log_transmittance, rtol=1e-3, atol=1e-4)
        assert count == (144 * 25 if everything else len(seen.density))
    field.our_step(scene, rays)
    ours = {name: p.grad.clone() for name, p in scene.field.named_parameters() if p.grad is not None}
    field.plain_step(scene, rays)
    for name, parameter in scene.field.named_parameters():
        assert parameter.grad is not None
        scale = float(parameter.grad.abs().max())
        torch.testing.assert_close(ours[name], parameter.grad, rtol=1e-2, atol=1e-3 * scale)


def test_plain_torch_marches_the_same(scene: Scene) -> None:
    rays = _kernels.view_rays(16)
    occupied = np.random.default_rng(0).random((8, 8, 8)) < 0.3
    samples = march(rays, occupied, scene.step)
    marched = _plain.march(rays, scene.samples_per_ray, occupied)
    differing = np.abs(np.diff(samples.offsets) - marched.kept.sum(1).numpy())
    assert differing.sum() <= 0.01 * len(samples.distances)  # cells' walls, by a rounding


def test_the_benchmark_runs_and_is_summarised(options: TrainNerf, tmp_path: Path) -> None:
    size = _kernels.Size(
        points=64, side=8, sides=(4, 8), samples=(8, 16), rounds=1, scaling_rounds=1, steps=3
    )
    boxes = [truth for truth in analytic_scenes() if truth.name == "boxes"]
    figures = field.measure(boxes, options, size)
    summary = field.summarise(figures)
    assert all(np.isfinite(summary[key]) for key in ("speedup_encoding", "speedup_step", "speedup_skipping"))
    assert summary["psnr_drop_db"] < 3
    (row,) = figures["skipping"]
    assert row["samples"] <= row["samples_in_box"]
    assert figures["by_threads"][0]["threads"] == 1
    assert len(field.table(figures).splitlines()) == 2 + 5 + 1
    write_fronts(tmp_path / "field.png", field.panels(figures))
    assert (tmp_path / "field.png").stat().st_size > 1000


def test_times_are_taken_in_turn() -> None:
    order: list[str] = []
    paces = in_turn({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 2)
    assert order == ["a", "b", "a", "b", "a", "b"]
    assert set(paces) == {"a", "b"}
    row = compared(Pace(4.0, 6.0), Pace(2.0, 1.5))
    assert (row["speedup"], row["processor_speedup"]) == (2.0, 4.0)
