"""Schedules of score distillation, and what earlier views were told to become."""

import itertools

import numpy as np
import pytest

from benchmarks._ways import CAMERA_SETS, WAYS, Draws, Targets, dream_time
from pipeline.cameras import orbit_camera
from pipeline.training.batch import Batch


def batch_of(step: int) -> Batch:
    rng = np.random.default_rng(step)
    azimuths, polars = rng.uniform(0, 6, 2), rng.uniform(1, 2, 2)
    cameras = [orbit_camera(a, p, 2.5, 0.7) for a, p in zip(azimuths, polars, strict=True)]
    noise = rng.standard_normal((2, 4, 3, 3)).astype(np.float32)
    flat = rng.uniform(-1, 1, (2, 4)).astype(np.float32)
    return Batch(cameras, azimuths, polars, flat, rng.uniform(0.1, 0.9, 2), noise, 7.5, 0.0)


def test_dream_times_levels_never_rise_and_follow_its_weight() -> None:
    levels = [dream_time(p) for p in np.linspace(0, 1, 201)]
    assert levels[0] == pytest.approx(0.98, abs=0.01)
    assert all(a >= b for a, b in itertools.pairwise(levels))
    # between 500 and 800 the weight is 1: equal shares of the run go through equal numbers of levels
    t = np.arange(20, 981)
    weight = np.where(t > 800, np.exp(-((t - 800) ** 2) / 180000), 1.0)
    weight = np.where(t < 500, np.exp(-((t - 500) ** 2) / 20000), weight)
    share = weight[(t >= 500) & (t <= 800)].sum() / weight.sum()
    assert np.mean([(0.5 <= level <= 0.8) for level in levels]) == pytest.approx(share, abs=0.02)


def test_what_is_fixed_comes_again_and_the_rest_does_not() -> None:
    for kind, noise, cameras in (("noise", True, False), ("cameras", False, True)):
        draws = Draws(f"fixed {kind}", 0)
        first = [draws(batch_of(i), i, 0.0) for i in range(CAMERA_SETS)]
        later = draws(batch_of(99), CAMERA_SETS, 0.5)
        assert np.array_equal(later.noise, first[0].noise) == noise
        assert np.array_equal(later.azimuths, first[0].azimuths) == cameras
        assert (later.cameras[0] is first[0].cameras[0]) == cameras
        assert not np.array_equal(later.noise_levels, first[0].noise_levels)
        assert np.array_equal(first[0].azimuths, first[1].azimuths) is False


def test_earlier_views_come_behind_the_new_ones() -> None:
    draws = Draws("replay", 0)
    assert len(draws(batch_of(0), 0, 0.0).cameras) == 2
    batch = draws(batch_of(1), 1, 0.0)
    assert sorted(draws.replayed) == [0, 1]
    assert len(batch.cameras) == len(batch.noise) == len(batch.backgrounds) == 4
    assert batch.cameras[2] is draws.remembered[draws.replayed[0]].cameras[0]
    np.testing.assert_array_equal(batch.azimuths[:2], batch_of(1).azimuths)


def test_a_target_is_where_the_gradient_led() -> None:
    rng = np.random.default_rng(0)
    latents, clean, later = rng.standard_normal((3, 2, 4, 3, 3))
    weight = np.array([0.3, 0.7])
    targets = Targets()
    targets.remember(latents, weight.reshape(-1, 1, 1, 1) * (latents - clean), weight)
    np.testing.assert_allclose(targets.gradient(later[:1], [1]), 0.7 * (later[:1] - clean[1:]))


def test_a_way_differs_from_todays_in_one_thing() -> None:
    plain = WAYS["sds"]._replace(alone=0, passes=0)
    for name, way in WAYS.items():
        own = way._replace(alone=0, passes=0)
        if way.passes > 3:  # as many updates a call as the chosen way takes
            assert way.options["updates_per_call"] == 2 * way.passes
            own = own._replace(options=plain.options)
        changed = [key for key in plain._fields if getattr(own, key) != getattr(plain, key)]
        assert len(changed) == (name != "sds"), name
