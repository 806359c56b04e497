"""Score distillation against its definition in float64, and against a model whose answer is known."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.diffusion.distillation import (
    DREAMFUSION_POWER,
    LATENT_NERF_POWER,
    Opposed,
    SdsStep,
    perpendicular,
    sds_gradient,
)
from pipeline.diffusion.schedule import Schedule
from pipeline.diffusion.sessions import denoiser
from tests.tiny_bundle import DISC, WIDTH, alphas_cumprod, disc, write_unet

SHAPE = (3, 4, 6, 6)
TIMESTEPS = np.array([25, 400, 999])
RANDOM = np.random.default_rng(0)
LATENTS, NOISE, OUTPUT_COND, OUTPUT_UNCOND = RANDOM.normal(size=(4, *SHAPE)).astype(np.float32)
OUTPUT_OPPOSED = np.random.default_rng(7).normal(size=SHAPE).astype(np.float32)
OPPOSED = np.full((3, 5, 7), 9, np.float32)
COND = RANDOM.normal(size=(3, 5, 7)).astype(np.float32)
UNCOND = np.zeros((5, 7), np.float32)


class FakeDenoiser:
    """Fixed outputs; rows whose text is UNCOND get the unconditional one. Remembers its calls."""

    def __init__(self) -> None:
        self.batches: list[int] = []

    def __call__(self, sample: np.ndarray, timesteps: np.ndarray, text: np.ndarray) -> np.ndarray:
        self.batches.append(len(sample))
        assert len(sample) == len(timesteps) == len(text)
        told = (text != 0).any((1, 2))
        rows = np.arange(len(sample)) % 3
        assert np.array_equal(timesteps, TIMESTEPS[rows])
        result = np.where(told[:, None, None, None], OUTPUT_COND[rows], OUTPUT_UNCOND[rows])
        away = (text == 9).all((1, 2))
        result[away] = OUTPUT_OPPOSED[rows[away]]
        return result


def run(kind: str = "epsilon", scale: float = 7.5, **options: Any) -> tuple[SdsStep, FakeDenoiser]:
    fake = FakeDenoiser()
    schedule = Schedule(alphas_cumprod(), kind)
    return sds_gradient(LATENTS, fake, schedule, TIMESTEPS, NOISE, COND, UNCOND, scale, **options), fake


def reference_epsilon(kind: str, scale: float) -> np.ndarray:
    """Guided eps_hat in float64, guidance done on eps."""
    abar = alphas_cumprod()[TIMESTEPS].reshape(-1, 1, 1, 1)
    noisy = np.sqrt(abar) * LATENTS.astype(np.float64) + np.sqrt(1 - abar) * NOISE

    def to_eps(output: np.ndarray) -> np.ndarray:
        return {
            "epsilon": output.astype(np.float64),
            "v_prediction": np.sqrt(abar) * output + np.sqrt(1 - abar) * noisy,
            "sample": (noisy - np.sqrt(abar) * output) / np.sqrt(1 - abar),
        }[kind]

    without, told = to_eps(OUTPUT_UNCOND), to_eps(OUTPUT_COND)
    return without + scale * (told - without)


@pytest.mark.parametrize("kind", ["epsilon", "v_prediction", "sample"])
@pytest.mark.parametrize("scale", [1.0, 7.5, 100.0])
@pytest.mark.parametrize("power", [LATENT_NERF_POWER, DREAMFUSION_POWER])
def test_the_gradient_is_w_times_the_noise_residual(kind: str, scale: float, power: float) -> None:
    step, _ = run(kind, scale, signal_power=power)
    abar = alphas_cumprod()[TIMESTEPS].reshape(-1, 1, 1, 1)
    weight = abar**power * (1 - abar)
    expected = weight * (reference_epsilon(kind, scale) - NOISE)
    assert step.gradient.dtype == np.float32
    np.testing.assert_allclose(step.gradient, expected, atol=1e-5 * np.abs(expected).max())
    assert step.gradient_norm == pytest.approx(np.sqrt((expected**2).mean()), rel=1e-5)


def test_the_public_codes_weight_is_the_default() -> None:
    abar = alphas_cumprod()[TIMESTEPS].reshape(-1, 1, 1, 1)
    expected = np.sqrt(abar) * (1 - abar) * (reference_epsilon("epsilon", 7.5) - NOISE)
    np.testing.assert_allclose(run()[0].gradient, expected, atol=1e-4)


def test_one_call_for_both_texts_and_none_wasted_without_guidance() -> None:
    assert run(scale=7.5)[1].batches == [6]
    assert run(scale=1.0)[1].batches == [3]


def test_the_clamp_bounds_the_predicted_image_and_so_the_gradient() -> None:
    free, _ = run(scale=100.0)
    assert np.abs(free.predicted_clean).max() > 50
    bounded, _ = run(scale=100.0, clean_clamp=3.5)
    assert np.array_equal(bounded.predicted_clean, np.clip(free.predicted_clean, -3.5, 3.5))
    abar = alphas_cumprod()[TIMESTEPS].reshape(-1, 1, 1, 1)
    expected = abar * np.sqrt(1 - abar) * (LATENTS - bounded.predicted_clean)
    np.testing.assert_allclose(bounded.gradient, expected, atol=1e-6)


def test_the_clamp_may_differ_by_channel() -> None:
    free, _ = run(scale=100.0)
    bounded, _ = run(scale=100.0, clean_clamp=np.array([1.0, 0.0, 3.0, 1e9], np.float32))
    assert np.abs(bounded.predicted_clean[:, 0]).max() == 1
    assert np.array_equal(bounded.predicted_clean[:, 1], free.predicted_clean[:, 1])  # 0: no bound
    assert np.abs(bounded.predicted_clean[:, 2]).max() == 3
    assert np.array_equal(bounded.predicted_clean[:, 3], free.predicted_clean[:, 3])


def test_it_is_finite_at_both_ends_of_a_zero_snr_schedule() -> None:
    schedule = Schedule(np.array([1 - 1e-9, 0.0]), "v_prediction")
    shape = (2, 4, 6, 6)
    step = sds_gradient(
        LATENTS[:2], lambda x, t, c: np.ones(shape, np.float32), schedule, np.array([0, 1]), NOISE[:2],
        COND[:2], UNCOND, 1.0,
    )  # fmt: skip
    assert np.isfinite(step.gradient).all()
    np.testing.assert_array_equal(step.gradient[1], 0)  # pure noise says nothing about the image


def test_diverged_latents_are_named() -> None:
    latents = LATENTS.copy()
    latents[0, 0, 0, 0] = np.nan
    schedule = Schedule(alphas_cumprod(), "epsilon")
    with pytest.raises(FloatingPointError, match="scene has diverged"):
        sds_gradient(latents, FakeDenoiser(), schedule, TIMESTEPS, NOISE, COND, UNCOND, 7.5)


@pytest.mark.parametrize("kind", ["epsilon", "v_prediction"])
@pytest.mark.parametrize("power", [LATENT_NERF_POWER, DREAMFUSION_POWER])
def test_descent_on_the_ideal_denoiser_of_a_gaussian_ends_at_its_mean(
    tmp_path: Path, kind: str, power: float
) -> None:
    """x* of N(mu, s^2 I): the expected gradient vanishes at mu alone, whatever the weight."""
    write_unet(tmp_path, prediction=kind)
    schedule = Schedule(alphas_cumprod(), kind)
    random = np.random.default_rng(3)
    latents = random.normal(size=(2, 4, 16, 16)).astype(np.float32)
    text = np.zeros((2, 4, WIDTH), np.float32)
    with denoiser(tmp_path) as denoise:
        average = np.zeros_like(latents)
        for index in range(400):
            step = sds_gradient(
                latents, denoise, schedule, random.integers(20, 700, 2),
                random.normal(size=latents.shape).astype(np.float32), text, text[0], 5.0, signal_power=power,
            )  # fmt: skip
            latents -= 0.2 * step.gradient
            if index >= 200:
                average += latents / 200
    mean = DISC[:, None, None] * disc(64).reshape(16, 4, 16, 4).mean((1, 3))
    np.testing.assert_allclose(average, np.broadcast_to(mean, average.shape), atol=0.06)


def test_a_mix_of_two_vectors_has_no_part_along_the_other() -> None:
    apart = perpendicular(OUTPUT_OPPOSED.astype(np.float64), OUTPUT_COND.astype(np.float64))
    np.testing.assert_allclose((apart * OUTPUT_COND).sum((1, 2, 3)), 0, atol=1e-4)
    along = OUTPUT_OPPOSED - apart
    np.testing.assert_allclose(perpendicular(along, OUTPUT_COND.astype(np.float64)), 0, atol=1e-6)
    assert np.array_equal(perpendicular(OUTPUT_COND, np.zeros_like(OUTPUT_COND)), OUTPUT_COND)


@pytest.mark.parametrize("kind", ["epsilon", "v_prediction", "sample"])
def test_perp_neg_is_its_definition_whatever_the_network_predicts(kind: str) -> None:
    """Equation 11 of the paper, done on eps in float64."""
    weight = np.array([0.0, 0.5, 2.0])
    step, fake = run(kind, 7.5, opposed=Opposed(OPPOSED, weight))
    assert fake.batches == [9]
    abar = alphas_cumprod()[TIMESTEPS].reshape(-1, 1, 1, 1)
    noisy = np.sqrt(abar) * LATENTS.astype(np.float64) + np.sqrt(1 - abar) * NOISE
    to_eps = {
        "epsilon": lambda v: v.astype(np.float64),
        "v_prediction": lambda v: np.sqrt(abar) * v + np.sqrt(1 - abar) * noisy,
        "sample": lambda v: (noisy - np.sqrt(abar) * v) / np.sqrt(1 - abar),
    }[kind]
    without, told, against = (to_eps(v) for v in (OUTPUT_UNCOND, OUTPUT_COND, OUTPUT_OPPOSED))
    positive, negative = (v.reshape(3, -1) for v in (told - without, against - without))
    share = (positive * negative).sum(1) / (positive**2).sum(1)
    apart = (negative - share[:, None] * positive).reshape(SHAPE)
    guided = without + 7.5 * (told - without - weight.reshape(-1, 1, 1, 1) * apart)
    expected = np.sqrt(abar) * (1 - abar) * (guided - NOISE)
    np.testing.assert_allclose(step.gradient, expected, atol=1e-5 * np.abs(expected).max())
    np.testing.assert_array_equal(step.gradient[0], run(kind, 7.5)[0].gradient[0])


def test_rescaling_takes_the_spread_back_to_that_of_the_text_alone() -> None:
    alone, guided = run(scale=1.0)[0].predicted_clean, run(scale=20.0)[0].predicted_clean
    full = run(scale=20.0, rescale=1.0)[0].predicted_clean
    half = run(scale=20.0, rescale=0.5)[0].predicted_clean
    assert (guided.std((1, 2, 3)) > 2 * alone.std((1, 2, 3))).all()
    np.testing.assert_allclose(full.std((1, 2, 3)), alone.std((1, 2, 3)), rtol=1e-5)
    np.testing.assert_allclose(half, (full + guided) / 2, rtol=1e-4, atol=1e-4)


def test_the_gradient_is_bounded_where_it_is_asked_to_be() -> None:
    free, clipped = run()[0].gradient, run(gradient_clip=0.2)[0]
    assert np.abs(free).max() > 1
    np.testing.assert_allclose(clipped.gradient, free.clip(-0.2, 0.2), atol=0)
    assert clipped.gradient_norm <= 0.2
