"""The ways of running a denoiser: that they ask for the same, on all views of an object at once."""

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks._cheaper import Told
from benchmarks.denoiser import (
    camera_rows,
    coarse,
    concurrent,
    concurrent_in_turn,
    guided,
    without_unconditional,
)
from export.everyday_objects.networks.denoiser import CAMERA

VIEWS = 4


def denoise(x, t, text, camera):
    """Every row answers to its noise level, its text, its camera, and the mean of the views beside it."""
    assert len(x) == len(t) == len(text) == len(camera)
    together = x.reshape(-1, VIEWS, *x.shape[1:]).mean(1).repeat(VIEWS, 0)
    told = text.mean((1, 2)) * (1 + camera.sum(1)) + t
    return x * told[:, None, None, None] + together * text[:, :1, :1, None]


@pytest.fixture
def told() -> Told:
    rng = np.random.default_rng(0)
    return Told(rng.normal(size=(2 * VIEWS, 3, 5)), rng.normal(size=(VIEWS, len(CAMERA))))


def test_one_run_and_two_give_the_same_difference(told: Told) -> None:
    noisy = np.random.default_rng(1).normal(size=(VIEWS, 4, 8, 8))
    expected = guided(denoise, told)(noisy, 300)
    assert expected.shape == noisy.shape
    np.testing.assert_allclose(concurrent_in_turn(denoise, told)(noisy, 300), expected)
    with ThreadPoolExecutor(2) as pool:
        np.testing.assert_allclose(concurrent(denoise, told, pool)(noisy, 300), expected)
    swapped = Told(np.roll(told.texts, VIEWS, axis=0), told.cameras)
    np.testing.assert_allclose(guided(denoise, swapped)(noisy, 300), -expected)


def test_half_the_resolution_keeps_the_noise_and_the_size() -> None:
    noisy = np.random.default_rng(2).standard_normal((VIEWS, 4, 32, 32))
    seen = []

    def full(x, t):
        seen.append(x)
        return x

    found = coarse(full)(noisy, 7)
    assert found.shape == noisy.shape
    assert seen[0].shape == (VIEWS, 4, 16, 16)
    assert seen[0].std() == pytest.approx(1, abs=0.03)
    np.testing.assert_array_equal(found[:, :, 1::2, ::2], seen[0])


def test_nothing_guides_where_the_unconditional_pass_is_left_out(told: Told) -> None:
    noisy, calls = np.ones((VIEWS, 4, 8, 8)), []

    def counted(x, t, text, camera):
        calls.append(len(x))
        return denoise(x, t, text, camera)

    difference = without_unconditional(counted, told, guided(counted, told), 500)
    assert not difference(noisy, 600).any()
    assert difference(noisy, 400).any()
    assert calls == [VIEWS, 2 * VIEWS]


def test_cameras_stand_around_the_object_and_only_where_the_bundle_wants_them() -> None:
    rows = camera_rows(SimpleNamespace(views=VIEWS, camera=CAMERA))
    assert rows.shape == (VIEWS, len(CAMERA))
    assert np.degrees(rows[:, 1]) == pytest.approx([0, 90, 180, 270])
    assert (rows[:, 0] == 1).all()
    assert not rows[:, 5:].any()
    assert camera_rows(SimpleNamespace(views=1, camera=())).shape == (1, 0)
