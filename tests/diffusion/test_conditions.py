"""What a denoiser is told of the views besides the text, and which views it sees together."""

from typing import Any

import numpy as np
import pytest

from pipeline.cameras import sample_cameras
from pipeline.diffusion.bundle import CAMERA_COLUMNS
from pipeline.diffusion.conditions import Conditions, camera_rows, together
from pipeline.diffusion.distillation import SdsStep
from pipeline.diffusion.schedule import Schedule
from pipeline.diffusion.view_gradient import Embeddings, distil
from pipeline.options.distillation import Distillation
from pipeline.training.batch import Batch, make_batch
from tests.tiny_bundle import alphas_cumprod

COLUMNS = (*CAMERA_COLUMNS, "backdrop", "backdrop", "backdrop")
COLOURS = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1]], np.float32)
LATENTS = np.arange(12, dtype=np.float32).reshape(3, 4)
EMBEDDINGS = Embeddings(
    np.zeros((16, 3, 2), np.float32), np.ones((3, 2), np.float32), "eight", LATENTS, COLOURS
)
OPTIONS = Distillation(resolution=6, guidance_scale=5.0)


def batch_of(count: int, backgrounds: np.ndarray | None) -> Batch:
    rng = np.random.default_rng(0)
    views = sample_cameras(rng, count, (2.0, 3.0), (0.6, 0.7), (0.7, 1.8))
    return make_batch(views, backgrounds, OPTIONS, 0.0, 6, rng)


def run(count: int, conditions: Conditions, backgrounds: np.ndarray | None) -> tuple[SdsStep, dict[str, Any]]:
    """Distil with a denoiser that answers the timestep, and return what it was given."""
    seen: dict[str, Any] = {}

    def denoise(
        sample: np.ndarray, timesteps: np.ndarray, text: np.ndarray, *camera: np.ndarray
    ) -> np.ndarray:
        seen.update(sample=sample, timesteps=timesteps, camera=camera[0] if camera else None)
        return sample * (timesteps / 1000).astype(np.float32)[:, None, None, None]

    batch = batch_of(count, backgrounds)
    latents = np.random.default_rng(1).standard_normal((count, 4, 6, 6), np.float32)
    step = distil(
        latents, batch, denoise, Schedule(alphas_cumprod(), "v_prediction"), EMBEDDINGS, OPTIONS, conditions
    )
    return step, seen | {"batch": batch}


def test_rows_say_where_a_view_stands_and_what_is_behind() -> None:
    batch = batch_of(4, LATENTS[[0, 1, 2, 0]])
    rows = camera_rows(COLUMNS, batch, batch.backgrounds)
    assert rows.dtype == np.float32
    np.testing.assert_allclose(rows[:, 1], batch.azimuths, rtol=1e-6)
    np.testing.assert_allclose(rows[:, 2], batch.polars, rtol=1e-6)
    assert ((rows[:, 3] > 2) & (rows[:, 3] < 3)).all()
    np.testing.assert_allclose(rows[:, 4], [c.fov for c in batch.cameras], rtol=1e-6)
    np.testing.assert_array_equal(rows[:, [0, 5]], 1)
    np.testing.assert_array_equal(rows[:, 6:], batch.backgrounds)
    unknown = camera_rows(COLUMNS, batch, None)
    np.testing.assert_array_equal(unknown[:, 5:], 0)
    np.testing.assert_array_equal(unknown[:, :5], rows[:, :5])


@pytest.mark.parametrize(("count", "views"), [(4, 4), (8, 4), (6, 4), (1, 4), (3, 1), (12, 4)])
def test_views_that_go_together_lie_apart(count: int, views: int) -> None:
    rows = together(count, views)
    assert len(rows) % views == 0
    assert set(rows) == set(range(count))
    if count % views == 0:
        apart = np.diff(rows.reshape(-1, views), axis=1)
        assert (apart == count // views).all()
    if views == 1:
        np.testing.assert_array_equal(rows, np.arange(count))


def test_both_branches_are_told_the_camera_in_pictures_too() -> None:
    _, seen = run(4, Conditions(COLUMNS, 4), LATENTS[[0, 1, 2, 0]])
    np.testing.assert_array_equal(seen["camera"][:4], seen["camera"][4:])
    np.testing.assert_array_equal(seen["camera"][:4, 6:], LATENTS[[0, 1, 2, 0]])
    # an RGB scene stands before colours: their latents are known
    _, seen = run(4, Conditions(COLUMNS, 4), COLOURS[[2, 1, 0, 0]] + np.float32(0.01))
    np.testing.assert_array_equal(seen["camera"][:4, 6:], LATENTS[[2, 1, 0, 0]])
    _, seen = run(4, Conditions(COLUMNS, 4), None)
    np.testing.assert_array_equal(seen["camera"][:, 5:], 0)


def test_views_together_share_a_noise_level_and_come_back_in_their_order() -> None:
    backgrounds = np.zeros((6, 4), np.float32)
    step, seen = run(6, Conditions(COLUMNS, 4), backgrounds)
    levels = seen["timesteps"].reshape(-1, 4)
    assert (levels == levels[:, :1]).all()
    assert step.gradient.shape == (6, 4, 6, 6)
    for i in range(6):  # each view as if it had been alone at its level
        place = int(np.flatnonzero(together(6, 4) == i)[0])
        own = seen["batch"]._replace(noise_levels=np.full(6, (levels.ravel()[place] + 0.5) / 1000))
        alone = distil(
            np.random.default_rng(1).standard_normal((6, 4, 6, 6), np.float32), own,
            lambda x, t, text: x * (t / 1000).astype(np.float32)[:, None, None, None],
            Schedule(alphas_cumprod(), "v_prediction"), EMBEDDINGS, OPTIONS,
        )  # fmt: skip
        np.testing.assert_allclose(step.gradient[i], alone.gradient[i], rtol=1e-5, atol=1e-6)


def test_a_bundle_that_declares_nothing_is_asked_as_before() -> None:
    plain, seen = run(3, Conditions(), np.zeros((3, 4), np.float32))
    assert seen["camera"] is None
    np.testing.assert_array_equal(
        seen["timesteps"][:3], (seen["batch"].noise_levels * 1000).astype(np.int64).clip(max=999)
    )
    assert plain.gradient.shape == (3, 4, 6, 6)
