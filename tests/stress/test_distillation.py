"""Score distillation at the ends of its ranges, against its formula in float64."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.diffusion.distillation import Opposed, sds_gradient
from pipeline.diffusion.schedule import Schedule
from pipeline.diffusion.sessions import denoiser
from tests.tiny_bundle import WIDTH, alphas_cumprod, write_unet

SHAPE = (4, 4, 5, 5)
RNG = np.random.default_rng(0)
LATENTS, NOISE, UNCOND, COND = (RNG.standard_normal(SHAPE).astype(np.float32) for _ in range(4))
INFINITY = np.float32(np.inf)
TEXT = np.zeros((4, 1, 1), np.float32)


def schedules() -> dict[str, np.ndarray]:
    """Return abar of Stable Diffusion's schedule, of a cosine that is cut, and of one that ends in noise."""
    usual = alphas_cumprod()
    root = np.sqrt(usual)
    level = np.cos((np.arange(1001) / 1000 + 0.008) / 1.008 * np.pi / 2) ** 2
    return {
        "usual": usual,
        "cosine": np.cumprod(1 - np.minimum(1 - level[1:] / level[:-1], 0.999)),
        "zero-snr": ((root - root[-1]) * root[0] / (root[0] - root[-1])) ** 2,
        "faint": np.cumprod(np.full(1000, 1 - 1e-12)),
    }


def answers(sample: np.ndarray, timesteps: np.ndarray, text: np.ndarray) -> np.ndarray:
    texts = {4: [COND], 8: [UNCOND, COND], 12: [UNCOND, COND, UNCOND]}
    return np.concatenate(texts[len(sample)])


@pytest.mark.parametrize("name", schedules())
@pytest.mark.parametrize("kind", ["epsilon", "v_prediction", "sample"])
@pytest.mark.parametrize("scale", [0.0, 1.0, 100.0, 1000.0])
def test_both_ends_of_the_schedule_at_any_guidance(name: str, kind: str, scale: float) -> None:
    abar = schedules()[name]
    timesteps = np.array([0, 1, 998, 999])
    step = sds_gradient(
        LATENTS, answers, Schedule(abar, kind), timesteps, NOISE, TEXT, TEXT[0], scale, signal_power=0.5
    )
    a = abar[timesteps].reshape(-1, 1, 1, 1)
    noisy = np.sqrt(a) * LATENTS.astype(np.float64) + np.sqrt(1 - a) * NOISE
    told = UNCOND.astype(np.float64) + scale * (COND.astype(np.float64) - UNCOND)
    # w (eps_hat - eps), w = sqrt(abar) (1 - abar); guidance is affine, so it may act on the raw output.
    epsilon = {
        "epsilon": told,
        "v_prediction": np.sqrt(a) * told + np.sqrt(1 - a) * noisy,
        "sample": (noisy - np.sqrt(a) * told) / np.sqrt(1 - a),
    }[kind]
    truth = np.sqrt(a) * (1 - a) * (epsilon - NOISE)
    assert np.isfinite(step.gradient).all()
    assert np.isfinite(step.predicted_clean).all()
    assert np.isfinite(step.gradient_norm)
    for view in range(4):
        # What the latents weigh in the gradient sets the rounding: sqrt(abar)^2 sqrt(1 - abar).
        atol = 4e-6 * np.abs(truth[view]).max() + 1e-6 * float((a * np.sqrt(1 - a))[view].max())
        np.testing.assert_allclose(step.gradient[view], truth[view], atol=atol, rtol=0)


@pytest.mark.parametrize("size", [1e-30, 1e-12, 1.0, 1e6])
def test_latents_and_outputs_of_any_size_stay_finite(size: float) -> None:
    """Up to what a network may answer (1e6), at the most guidance, with all options on."""
    for kind in ("epsilon", "v_prediction", "sample"):
        for name, abar in schedules().items():
            step = sds_gradient(
                LATENTS * np.float32(size), lambda *feeds: answers(*feeds) * np.float32(size),
                Schedule(abar, kind), np.array([0, 1, 998, 999]), NOISE, TEXT, TEXT[0], 1000.0,
                opposed=Opposed(TEXT, np.full(4, 10.0)), rescale=0.7,
            )  # fmt: skip
            assert np.isfinite(step.gradient).all(), (kind, name)
            assert np.isfinite(step.predicted_clean).all(), (kind, name)


def test_bounds_hold_whatever_comes() -> None:
    huge = np.float32(1e30)
    for clamp, clip in ((1e-6, 0.0), (3.0, 0.0), (0.0, 1e-6), (1000.0, 1000.0)):
        step = sds_gradient(
            LATENTS * huge, lambda *feeds: answers(*feeds) * huge, Schedule(alphas_cumprod(), "epsilon"),
            np.array([0, 1, 998, 999]), NOISE, TEXT, TEXT[0], 1000.0, clean_clamp=clamp, gradient_clip=clip,
        )  # fmt: skip
        assert np.isfinite(step.gradient).all()
        if clamp:
            assert np.abs(step.predicted_clean).max() <= np.float32(clamp)
        if clip:
            assert np.abs(step.gradient).max() <= np.float32(clip)


@pytest.mark.parametrize("scale", [1.0, 100.0])
def test_an_infinity_is_not_made_a_number_by_a_bound(scale: float) -> None:
    with pytest.raises(FloatingPointError, match=r"denoiser output holds \d+ NaN or infinite"):
        sds_gradient(
            LATENTS, lambda *feeds: answers(*feeds) * INFINITY, Schedule(alphas_cumprod(), "epsilon"),
            np.array([0, 1, 998, 999]), NOISE, TEXT, TEXT[0], scale, clean_clamp=3.0,
        )  # fmt: skip


def test_texts_that_say_the_same_need_no_direction() -> None:
    """Perp-Neg and rescaling divide by lengths and spreads: both are zero here."""
    flat = np.ones(SHAPE, np.float32)
    step = sds_gradient(
        flat, lambda sample, t, text: np.ones_like(sample), Schedule(alphas_cumprod(), "sample"),
        np.array([0, 1, 998, 999]), 0 * NOISE, TEXT, TEXT[0], 1000.0,
        opposed=Opposed(TEXT, np.full(4, 10.0)), rescale=1.0,
    )  # fmt: skip
    assert np.isfinite(step.gradient).all()


HALF = "float16[batch, 4, height, width]"


def test_half_precision_inputs_give_the_gradient_to_half_precision(tmp_path: Path) -> None:
    """At guidance 100 the difference of two texts is what matters: it must survive 11 bits."""
    text = 0.3 * np.random.default_rng(1).standard_normal((4, 6, WIDTH)).astype(np.float32)
    gradients = []
    for kind in (HALF, HALF.replace("16", "")):
        write_unet(tmp_path / kind[:7], sample=kind)
        with denoiser(tmp_path / kind[:7]) as denoise:
            gradients.append(
                sds_gradient(
                    LATENTS, denoise, Schedule(alphas_cumprod(), "v_prediction"),
                    np.array([20, 300, 700, 979]), NOISE, text, text[0] * 0, 100.0,
                ).gradient
            )  # fmt: skip
    error = np.linalg.norm((gradients[0] - gradients[1]).reshape(4, -1), axis=1)
    assert (error < 0.03 * np.linalg.norm(gradients[1].reshape(4, -1), axis=1)).all()


@pytest.mark.parametrize(
    ("size", "fits"), [(1e-30, True), (1e-7, True), (1e3, True), (65504.0, True), (7e4, False)]
)
def test_what_half_precision_cannot_hold_is_not_blamed_on_the_network(
    size: float, fits: bool, tmp_path: Path
) -> None:
    write_unet(tmp_path, sample=HALF)
    sample, text = np.full((1, 4, 4, 4), size, np.float32), np.zeros((1, 2, WIDTH), np.float32)
    with denoiser(tmp_path) as denoise:
        if fits:
            assert np.isfinite(denoise(sample, np.array([999]), text)).all()
        else:
            with pytest.raises(FloatingPointError, match=r"input sample holds .* more than its .*float16"):
                denoise(sample, np.array([999]), text)
