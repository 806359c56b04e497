"""Sampling from a denoiser whose distribution is known."""

import numpy as np
import pytest

from benchmarks._ideal import linear_schedule
from export.everyday_objects.train.sample import ddim

MEAN, SPREAD = 0.7, 0.25


@pytest.mark.parametrize("guidance", [1.0, 4.0])
def test_samples_have_the_distribution_that_the_denoiser_knows(guidance: float) -> None:
    """Clean latents are N(MEAN, SPREAD^2) with and without text, so guidance changes nothing."""
    schedule = linear_schedule()

    def ideal(x: np.ndarray, t: np.ndarray, text: np.ndarray) -> np.ndarray:
        signal, sigma = schedule.factors(t)
        return np.asarray((x - signal * MEAN) * sigma / (signal**2 * SPREAD**2 + sigma**2), np.float32)

    text = np.zeros((8, 1, 1), np.float32)
    latents = ddim(ideal, schedule, text, text[0], 32, guidance, 200, 0)
    assert latents.shape == (8, 4, 32, 32)
    assert latents.mean() == pytest.approx(MEAN, abs=0.015)
    assert latents.std() == pytest.approx(SPREAD, rel=0.08)
    assert np.array_equal(latents, ddim(ideal, schedule, text, text[0], 32, guidance, 200, 0))
