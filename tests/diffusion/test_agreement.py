"""The score of a scene: a denoiser that knows what a text means gains by being told it, if it is true."""

import numpy as np
import pytest

from pipeline.cameras import ring
from pipeline.diffusion.agreement import agreement
from pipeline.diffusion.schedule import Schedule
from pipeline.diffusion.view_gradient import Embeddings
from pipeline.options.nerf import TrainNerf
from pipeline.training.batch import Batch
from tests.tiny_bundle import alphas_cumprod

COUNT, SIZE = 4, 8
SCHEDULE = Schedule(alphas_cumprod(), "epsilon")
EMBEDDINGS = Embeddings(np.ones((5, 2, 3), np.float32), np.zeros((2, 3), np.float32), "paper", None)


def batch() -> Batch:
    azimuths = np.arange(COUNT) * np.pi / 2
    zeros = np.zeros((COUNT, 4, 1, 1), np.float32)
    flat = np.zeros((COUNT, 4), np.float32)
    cameras = ring(COUNT, 1.3, 2.0, 1.0)
    return Batch(cameras, azimuths, np.full(COUNT, 1.3), flat, np.zeros(COUNT), zeros, 1.0, 0.0)


def denoise(sample: np.ndarray, timesteps: np.ndarray, text: np.ndarray) -> np.ndarray:
    """The ideal denoiser of N(text's mean, 0.3^2): told, of latents of ones; untold, of zeros."""
    signal, sigma = SCHEDULE.factors(timesteps)
    mean = text.mean((1, 2)).reshape(-1, 1, 1, 1)
    return np.asarray((sample - signal * mean) * sigma / (signal**2 * 0.09 + sigma**2), np.float32)


@pytest.mark.parametrize("prediction", ["epsilon", "v_prediction"])
def test_what_the_text_says_scores_and_what_it_does_not_loses(prediction: str) -> None:
    schedule = Schedule(alphas_cumprod(), prediction)

    def network(sample, timesteps, text):
        guess = denoise(sample, timesteps, text)
        if prediction == "epsilon":
            return guess
        signal, sigma = schedule.factors(timesteps)
        clean = (sample - sigma * guess) / signal
        return (signal * guess - sigma * clean).astype(np.float32)

    scores = {}
    for value in (1.0, 0.5, 0.0):
        latents = np.full((COUNT, 4, SIZE, SIZE), value, np.float32)
        scores[value] = agreement(latents, batch(), network, schedule, EMBEDDINGS, TrainNerf())
    assert scores[1.0].score > 0.3
    assert scores[0.0].score < -0.3
    assert scores[1.0].score > scores[0.5].score > scores[0.0].score
    assert scores[1.0].loss_told < scores[1.0].loss_untold
    again = agreement(
        np.ones((COUNT, 4, SIZE, SIZE), np.float32), batch(), network, schedule, EMBEDDINGS, TrainNerf()
    )
    assert again == scores[1.0], "the same noise every time"
