"""The benchmark of score distillations, on few pixels: it counts calls rightly and tells one object from
several."""

import numpy as np
import pytest

from benchmarks import _distilling, distillation
from benchmarks._distilling import Oracle, Setting, learn, passes
from benchmarks._gradients import METHODS
from benchmarks._ideal import Calls
from benchmarks._mixture_scenes import Scenes, facing, kind_scenes, quarter_turns, sides
from benchmarks._truths import analytic_scenes
from benchmarks._ways import WAYS
from benchmarks.distillation import as_good, interval, rows_of, settings, table
from pipeline.cameras import orbit_camera
from pipeline.training.batch import Batch

SMALL = {
    "samples_per_ray": 24, "grid_levels": 6, "grid_finest": 32, "grid_table_log2": 11,
    "density_bias": -3.0, "sparsity_weight": 0.1, "opacity_weight": 0.0, "emptiness_weight": 1.0,
}  # fmt: skip


def batch_of(count: int, levels: list[float]) -> Batch:
    """Return views round the object, a quarter turn apart."""
    rng = np.random.default_rng(0)
    azimuths = np.arange(count) * np.pi / 2
    cameras = [orbit_camera(a, 1.2, 2.5, 0.7) for a in azimuths]
    noise = rng.standard_normal((count, 4, 4, 4)).astype(np.float32)
    flat = np.zeros((count, 4), np.float32)
    return Batch(cameras, azimuths, np.full(count, 1.2), flat, np.array(levels), noise, 7.5, 0.0)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ["exact", "apart", "faces"])
def test_a_step_asks_as_often_as_is_counted(way: str, name: str) -> None:
    if not WAYS[way].alone and name == "exact":
        pytest.skip("one scene alone says nothing of it")
    if way == "perp-neg" and name != "faces":
        pytest.skip("no side to turn away from")
    ball, _, boxes = analytic_scenes()
    told = {"exact": [ball], "apart": [ball, boxes], "faces": quarter_turns(boxes)}[name]
    calls = Calls()
    setting = Setting(way, name, "ball", 100)
    oracle = Oracle(setting, Scenes(told, [] if name == "exact" else [ball], name == "faces"), calls)
    batch = batch_of(2, [0.7, 0.96])._replace(guidance_scale=WAYS[way].guidance[0])
    seen = oracle.seen(batch, 4)
    METHODS[WAYS[way].gradient](
        oracle.query(seen), oracle.schedule, oracle.step(batch.noise, batch, seen, 0.0)
    )
    # ISM takes fewer steps of inversion where less noise is added: what is counted is the mean.
    assert calls.runs == passes(setting) + (way == "ism" and 2)


def test_variants_differ_and_are_blue() -> None:
    first, second = kind_scenes("cabinet", 2)
    camera, flat = orbit_camera(0.3, 1.2, 2.5, 0.7), np.zeros(4)
    shown = [scene.picture(camera, 16, flat) for scene in (first, second)]
    assert np.abs(shown[0][0] - shown[1][0]).max() > 0.1
    for latents, opacity in shown:
        red, _, blue = latents[:3, opacity > 0.99].mean(1)
        assert blue > red + 0.3


def test_a_turned_scene_shows_from_its_side_what_it_showed_in_front() -> None:
    turns = quarter_turns(kind_scenes("horse", 1)[0])
    azimuths, flat = np.arange(4) * np.pi / 2, np.zeros(4)
    front = turns[0].draw(orbit_camera(0.0, 1.2, 2.5, 0.7), 12, flat)
    for azimuth, turn in zip(azimuths, turns, strict=True):
        shown = turn.draw(orbit_camera(azimuth, 1.2, 2.5, 0.7), 12, flat)
        np.testing.assert_allclose(shown, front, atol=0.02)
    assert facing(azimuths).tolist() == [0, 1, 2, 3]
    likely = sides(azimuths)
    np.testing.assert_allclose(likely.sum(1), 1)
    assert likely[0].tolist() == [1, 0, 0, 0]
    assert likely[2].tolist() == [0.5, 0, 0.5, 0]


def test_what_a_trial_cost_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_distilling, "shape_error", lambda *_: {"chamfer": 0.5})  # half a minute under test
    row = learn(Setting("4 updates", "exact", "ball", 3, resolution=8), **SMALL)
    assert (row["steps"], row["calls"], row["views"], row["commitment"]) == (3, 3, 12, 1)
    assert row["chamfer"] == 0.5


@pytest.mark.thorough
def test_an_exact_scene_is_learned() -> None:
    row = learn(Setting("sds", "exact", "ball", 16, resolution=8), **SMALL)
    assert row["psnr"] > learn(Setting("sds", "exact", "ball", 2, resolution=8), **SMALL)["psnr"]


@pytest.mark.thorough
@pytest.mark.parametrize("way", ["replay", "fixed cameras", "DreamTime"])
def test_other_schedules_learn_too(way: str) -> None:
    row = learn(Setting(way, "exact", "ball", 16, resolution=8), **SMALL)
    assert (row["calls"], row["views"]) == (16, 64)
    assert row["psnr"] > 8


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["apart", "together", "weak", "few steps", "faces"])
def test_a_mixture_is_trained_by_every_way_of_judging(name: str) -> None:
    row = learn(Setting("csd", name, "sofa", 6, resolution=8), **SMALL)
    assert row["steps"] == 3
    assert 0.25 <= row["commitment"] <= 1


def test_rows_are_means_and_the_fewest_calls_are_found() -> None:
    one = {"psnr": 30.0, "chamfer": 0.01, "normal_error": 9.0, "commitment": 1.0, "seconds": 1.0, "views": 4,
           "steps": 1}  # fmt: skip
    results = {
        Setting("sds", "exact", "ball", 200): one,
        Setting("sds", "exact", "car", 200): {**one, "psnr": 32.0, "chamfer": 0.006},
        Setting("4 updates", "exact", "ball", 100): {**one, "psnr": 30.9, "chamfer": 0.009},
        Setting("8 updates", "exact", "ball", 50): {**one, "psnr": 30.4, "chamfer": 0.008},
        Setting("sds", "exact", "torus", 200): one,
    }
    rows = rows_of(results)
    assert (rows[0]["psnr"], rows[0]["chamfer"], rows[0]["psnr_interval"]) == (31.0, 0.008, None)
    assert rows[-1]["oracle"] == "unseen"
    found = as_good(rows, "exact")
    assert found is not None  # fewer calls err more: one by its surface, one by its views
    assert (found["way"], found["calls"]) == ("sds", 200)
    assert as_good(rows, "unseen") is None
    better = {
        Setting("4 updates", "exact", "ball", 100, s): {**one, "psnr": 31.0 + s, "chamfer": 0.008}
        for s in (0, 1)
    }
    row = as_good(rows_of(results | better), "exact")
    assert row is not None
    assert (row["way"], row["calls"], row["seeds"]) == ("4 updates", 100, 2)
    # two seeds .71 apart from their mean: t of one degree of freedom is 12.706
    assert row["psnr_interval"] == pytest.approx(12.706 * 0.5, abs=0.01)
    assert "| 31.0, 0.0080 |" in table(rows)


def test_an_interval_is_students() -> None:
    # n = 4, deviation 1: t = 3.1824 (a table's value), over sqrt(4)
    assert interval([1.0, 1.0, 1.0, 1.0]) == 0
    values = np.array([-1.0, -1, 1, 1]) * np.sqrt(3) / 2
    assert interval(values.tolist()) == pytest.approx(3.1824 / 2, abs=1e-3)
    assert interval([2.0]) is None


def test_every_way_meets_its_oracles() -> None:
    found = settings(3)
    assert {s.way for s in found} == set(WAYS)
    assert {s.oracle for s in found} == set(distillation.ORACLES)
    assert {s.seed for s in found} == {0, 1, 2}
    assert not [s for s in found if s.oracle == "exact" and not WAYS[s.way].alone]
