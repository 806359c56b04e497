"""Which texts a view is judged by."""

from typing import Any

import numpy as np
import pytest

from pipeline.cameras import ring
from pipeline.diffusion.prompts import view_table
from pipeline.diffusion.schedule import Schedule
from pipeline.diffusion.view_gradient import Embeddings, distillation_gradient, view_embeddings
from pipeline.options.distillation import Distillation
from pipeline.training.batch import Batch, make_batch
from tests.tiny_bundle import alphas_cumprod

TEXTS = np.arange(16, dtype=np.float32)[:, None, None] + np.zeros((16, 3, 2), np.float32)
EMBEDDINGS = Embeddings(TEXTS, np.full((3, 2), -1, np.float32), "eight", None)
AZIMUTHS = np.radians([0.0, 100.0, 180.0])


def batch(options: Distillation) -> Batch:
    views = (ring(3, 1.2, 2.0, 0.7), AZIMUTHS, np.full(3, 1.2))
    return make_batch(views, np.zeros((3, 4), np.float32), options, 0.0, 6, np.random.default_rng(0))


def texts_seen(**values: Any) -> np.ndarray:
    """Return the first number of the text of every row that the denoiser was given."""
    options = Distillation(resolution=6, **values)
    seen: list[np.ndarray] = []

    def denoise(sample: np.ndarray, timesteps: np.ndarray, text: np.ndarray) -> np.ndarray:
        seen.append(text[:, 0, 0])
        return np.zeros_like(sample)

    guidance = distillation_gradient(denoise, Schedule(alphas_cumprod(), "epsilon"), EMBEDDINGS, options)
    guidance(np.zeros((3, 4, 6, 6), np.float32), batch(options))
    (rows,) = seen
    return rows


def test_each_view_has_its_own_text() -> None:
    back = view_table("eight").index("back view")
    np.testing.assert_array_equal(texts_seen(), [-1, -1, -1, 0, 2, back])
    np.testing.assert_allclose(texts_seen(view_text="interpolated")[3:], [0, 100 / 45, back], atol=1e-6)
    np.testing.assert_array_equal(texts_seen(guidance_scale=1.0), [0, 2, back])


def test_perp_neg_shows_the_front_to_every_view() -> None:
    np.testing.assert_array_equal(texts_seen(perp_neg=1.0)[6:], [0, 0, 0])


def test_a_mixed_text_is_between_its_neighbours() -> None:
    options = Distillation(view_text="interpolated")
    mixed = view_embeddings(EMBEDDINGS, options, batch(options))
    assert mixed.dtype == np.float32
    assert mixed[:, 0, 0] == pytest.approx([0, 100 / 45, 4], abs=1e-5)
