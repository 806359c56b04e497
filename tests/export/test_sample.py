"""Sampling from a denoiser whose distribution is known."""

import numpy as np
import pytest

from benchmarks._ideal import linear_schedule
from export.everyday_objects.sample import CLAMP, ddim

MEAN, SPREAD = 0.7, 0.25
PLAIN = np.zeros((1, 4), np.float32)


@pytest.mark.parametrize("eta", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("guidance", [1.0, 4.0])
def test_samples_have_the_distribution_that_the_denoiser_knows(eta: float, guidance: float) -> None:
    """Clean latents are N(MEAN, SPREAD^2) with and without text, so guidance changes nothing."""
    schedule = linear_schedule()

    def ideal(x: np.ndarray, t: np.ndarray, text: np.ndarray) -> np.ndarray:
        signal, sigma = schedule.factors(t)
        return np.asarray((x - signal * MEAN) * sigma / (signal**2 * SPREAD**2 + sigma**2), np.float32)

    text = np.zeros((8, 1, 1), np.float32)
    latents = ddim(ideal, schedule, text, text[0], PLAIN, 32, guidance, 200, 0, eta)
    assert latents.shape == (8, 4, 32, 32)
    assert latents.mean() == pytest.approx(MEAN, abs=0.015)
    assert latents.std() == pytest.approx(SPREAD, rel=0.08)
    assert np.array_equal(latents, ddim(ideal, schedule, text, text[0], PLAIN, 32, guidance, 200, 0, eta))


def test_clean_latents_stay_within_the_clamp() -> None:
    schedule = linear_schedule()
    text = np.zeros((1, 1, 1), np.float32)
    latents = ddim(lambda x, t, c: -100 * np.ones_like(x), schedule, text, text[0], PLAIN, 8, 1.0, 20, 0)
    assert np.abs(latents).max() < CLAMP + 0.5
    assert latents.mean() == pytest.approx(CLAMP, abs=0.1)


def test_it_starts_from_a_backdrop_in_as_much_noise_as_the_schedule_ends_with() -> None:
    schedule = linear_schedule()
    met = []

    def watch(x: np.ndarray, t: np.ndarray, text: np.ndarray) -> np.ndarray:
        met.append((x.copy(), t))
        return np.zeros_like(x)

    backdrops = np.array([[300, 0, 0, -300], [0, 500, 0, 0]], np.float32)
    text = np.zeros((16, 1, 1), np.float32)
    ddim(watch, schedule, text, text[0], backdrops, 32, 1.0, 4, 0)
    first, timesteps = met[0]
    assert (timesteps == len(schedule.alphas_cumprod) - 1).all()
    signal, sigma = (float(f[0, 0, 0, 0]) for f in schedule.factors(timesteps[:1]))
    means = first.mean((2, 3)) / signal
    distances = np.abs(means[:, None] - backdrops).max(2)
    assert distances.min(1).max() < 0.2 / signal
    assert set(distances.argmin(1)) == {0, 1}
    flat = backdrops[distances.argmin(1), :, None, None]
    assert (first - signal * flat).std() == pytest.approx(sigma, rel=0.02)
