"""The benchmark of score distillations, on few pixels: it counts calls rightly and tells one object from
several."""

import numpy as np
import pytest

from benchmarks import distillation
from benchmarks._gradients import METHODS, Step
from benchmarks._ideal import Calls, linear_schedule
from benchmarks._mixtures import Believed
from benchmarks.distillation import (
    Setting,
    best,
    calls_a_step,
    kind_scenes,
    learn,
    rows_of,
    settings,
    todays_calls,
)
from pipeline.cameras import orbit_camera

SMALL = {
    "samples_per_ray": 24, "grid_levels": 6, "grid_finest": 32, "grid_table_log2": 11,
    "density_bias": -3.0, "sparsity_weight": 0.1, "opacity_weight": 0.0, "emptiness_weight": 1.0,
}  # fmt: skip


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["exact", "apart"])
def test_a_step_asks_as_often_as_is_counted(method: str, name: str) -> None:
    if name == "exact" and method in ("csd", "nfsd"):
        pytest.skip("not measured on one scene")
    rng, calls = np.random.default_rng(0), Calls()
    seen = Believed(rng.uniform(-1, 1, (2, 3, 4, 4, 4)), np.arange(2))
    setting = Setting(method, name, "car", 100)
    scale = 1.0 if name == "exact" else distillation.SCALES[method]
    latents, noise = rng.standard_normal((2, 2, 4, 4, 4))
    step = Step(latents, np.array([700, 960]), noise, scale, 0.0, distillation.bad_pictures(seen))
    METHODS[method](distillation.oracle(setting, seen, calls), linear_schedule(), step)
    # ISM takes fewer steps of inversion where less noise is added: what is counted is the mean.
    assert calls.runs == calls_a_step(setting) + (method == "ism" and 2)


def test_variants_differ_and_are_blue() -> None:
    first, second = kind_scenes("sofa", 2)
    camera, flat = orbit_camera(0.3, 1.2, 2.5, 0.7), np.zeros(4)
    shown = [scene.picture(camera, 16, flat) for scene in (first, second)]
    assert np.abs(shown[0][0] - shown[1][0]).max() > 0.1
    latents, opacity = shown[0]
    red, _, blue = latents[:3, opacity > 0.99]
    assert (blue > red).mean() > 0.8


def test_an_exact_scene_is_learned_and_what_it_cost_is_said() -> None:
    row = learn(Setting("sds", "exact", "ball", 16, resolution=8), **SMALL)
    assert (row["steps"], row["calls"], row["views"]) == (16, 16, 64)
    assert row["commitment"] == 1
    assert row["psnr"] > learn(Setting("sds", "exact", "ball", 2, resolution=8), **SMALL)["psnr"]


@pytest.mark.thorough
def test_a_mixture_is_trained_by_every_way_of_judging() -> None:
    for name in ("apart", "together", "weak", "few steps"):
        row = learn(Setting("csd", name, "sofa", 6, resolution=8), **SMALL)
        assert row["steps"] == 3
        assert 0.25 <= row["commitment"] <= 1


def test_rows_are_means_and_the_fewest_calls_are_found() -> None:
    one = {"psnr": 30.0, "chamfer": 0.01, "normal_error": 9.0, "commitment": 1.0, "seconds": 1.0, "views": 4,
           "steps": 1}  # fmt: skip
    results = {
        Setting("sds", "exact", "ball", 100): one,
        Setting("sds", "exact", "car", 100): {**one, "psnr": 32.0, "chamfer": 0.006},
        Setting("sds", "exact", "ball", 50): one,
    }
    rows = rows_of(results)
    assert (rows[0]["psnr"], rows[0]["chamfer"], rows[0]["psnr_spread"]) == (31.0, 0.008, 1.0)
    assert todays_calls(rows) == 100
    assert todays_calls(rows[1:]) is None
    better = {Setting("4 steps", "exact", "ball", 100): {**one, "psnr": 33.0}}
    assert [best(rows), best(rows_of(results | better))] == ["sds", "4 steps"]


def test_every_method_meets_every_oracle() -> None:
    found = settings(2)
    assert {s.method for s in found} == set(METHODS)
    assert {(s.oracle, s.seed) for s in found} == {(o, s) for o in distillation.ORACLES for s in (0, 1)}
    assert len(set(found)) == len(found)
