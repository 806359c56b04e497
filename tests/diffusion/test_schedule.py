"""The noise schedule against its definitions, and the three kinds of prediction against each other."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.diffusion.schedule import Schedule, load_schedule
from pipeline.errors import InputError
from tests.tiny_bundle import SCHEDULER, alphas_cumprod


def load(folder: Path, **config: Any) -> Schedule:
    (folder / "scheduler_config.json").write_text(json.dumps(config))
    return load_schedule(folder)


def test_scaled_linear_is_stable_diffusions(tmp_path: Path) -> None:
    schedule = load(tmp_path, **SCHEDULER)
    np.testing.assert_allclose(schedule.alphas_cumprod, alphas_cumprod(), rtol=1e-12)
    assert schedule.alphas_cumprod.dtype == np.float64
    # Published for Stable Diffusion 1.x: the signal left at the last step, sqrt(abar) = 0.0683.
    assert np.sqrt(schedule.alphas_cumprod[-1]) == pytest.approx(0.06826, abs=2e-4)


def test_linear_and_the_defaults_are_those_of_ho_et_al(tmp_path: Path) -> None:
    schedule = load(tmp_path)
    assert schedule.prediction_type == "epsilon"
    product = 1.0
    for step in range(1000):
        product *= 1 - (1e-4 + (0.02 - 1e-4) * step / 999)
    assert schedule.alphas_cumprod[-1] == pytest.approx(product, rel=1e-9)


def test_the_cosine_schedule_follows_its_formula_until_the_cap(tmp_path: Path) -> None:
    abar = load(tmp_path, beta_schedule="squaredcos_cap_v2", num_train_timesteps=100).alphas_cumprod
    level = np.cos((np.arange(101) / 100 + 0.008) / 1.008 * np.pi / 2) ** 2
    np.testing.assert_allclose(abar[:99], level[1:100] / level[0], rtol=1e-9)
    assert abar[99] == pytest.approx(abar[98] * 0.001)


def test_trained_betas_are_taken_as_they_are(tmp_path: Path) -> None:
    schedule = load(tmp_path, trained_betas=[0.1, 0.5], num_train_timesteps=2)
    np.testing.assert_allclose(schedule.alphas_cumprod, [0.9, 0.45])


def test_zero_snr_ends_in_pure_noise_and_keeps_the_start(tmp_path: Path) -> None:
    plain = load(tmp_path, **SCHEDULER).alphas_cumprod
    zero = load(tmp_path, **SCHEDULER, rescale_betas_zero_snr=True).alphas_cumprod
    assert zero[-1] == 0
    assert zero[0] == pytest.approx(plain[0])
    assert (np.diff(zero) < 0).all()


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"beta_schedule": "sigmoid"}, "beta_schedule is 'sigmoid', expected one of linear"),
        ({"prediction_type": "flow"}, "prediction_type is 'flow', expected one of epsilon"),
        ({"num_train_timesteps": 0}, "num_train_timesteps is 0"),
        ({"num_train_timesteps": 10.5}, "num_train_timesteps is 10.5"),
        ({"num_train_timesteps": "many"}, "num_train_timesteps is 'many'"),
        ({"beta_start": -1}, "beta_start is -1"),
        ({"beta_end": 2}, "beta_end is 2"),
        ({"trained_betas": [0.1]}, "trained_betas"),
        ({"trained_betas": [{}], "num_train_timesteps": 2}, "trained_betas"),
    ],
)
def test_a_wrong_config_is_one_line(tmp_path: Path, config: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as error:
        load(tmp_path, **config)
    assert str(tmp_path / "scheduler_config.json") in str(error.value)
    assert said in str(error.value)


def test_a_schedule_that_is_none_is_refused() -> None:
    for values in ([0.5, 0.9], [1.0, 0.5], [0.5, -0.1], [np.nan]):
        with pytest.raises(ValueError, match="alphas_cumprod"):
            Schedule(np.array(values), "epsilon")
    with pytest.raises(ValueError, match="prediction_type"):
        Schedule(np.array([0.9, 0.5]), "flow")


# abar from almost 1 to exactly 0: both ends of every schedule in use.
EXTREMES = np.array([1 - 1e-7, 0.99915, 0.5, 0.0047, 1e-8, 0.0])
TIMESTEPS = np.arange(len(EXTREMES))


def truth() -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(0)
    clean, noise = random.normal(size=(2, len(EXTREMES), 4, 5, 6)).astype(np.float32)
    return clean, noise


def raw_output(kind: str, clean: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """What a perfect network gives, in float64, by the definitions."""
    abar = EXTREMES.reshape(-1, 1, 1, 1)
    return {
        "epsilon": noise.astype(np.float64),
        "v_prediction": np.sqrt(abar) * noise - np.sqrt(1 - abar) * clean,
        "sample": clean.astype(np.float64),
    }[kind]


@pytest.mark.parametrize("kind", ["epsilon", "v_prediction", "sample"])
def test_a_perfect_prediction_gives_back_image_and_noise(kind: str) -> None:
    schedule = Schedule(EXTREMES, kind)
    clean, noise = truth()
    noisy = schedule.add_noise(clean, noise, TIMESTEPS)
    assert noisy.dtype == np.float32
    abar = EXTREMES.reshape(-1, 1, 1, 1)
    np.testing.assert_allclose(noisy, np.sqrt(abar) * clean + np.sqrt(1 - abar) * noise, atol=1e-6)
    output = raw_output(kind, clean, noise).astype(np.float32)
    found_clean = schedule.to_clean(output, noisy, TIMESTEPS)
    found_noise = schedule.to_epsilon(output, noisy, TIMESTEPS)
    assert found_clean.dtype == np.float32
    assert found_noise.dtype == np.float32
    assert np.isfinite(found_clean).all()
    assert np.isfinite(found_noise).all()
    # float32 rounding of latents, divided where the formula divides; pure noise does not tell the image.
    with np.errstate(divide="ignore"):
        clean_error = 1e-6 / np.sqrt(abar) if kind == "epsilon" else np.full_like(abar, 1e-6)
        noise_error = 1e-6 / np.sqrt(1 - abar) if kind == "sample" else np.full_like(abar, 1e-6)
    assert (np.abs(found_clean - clean) <= clean_error).all()
    assert (np.abs(found_noise - noise) <= noise_error).all()
