"""The gradient by pictures, against finite differences and known answers."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.cameras import ring
from pipeline.diffusion.distillation import SdsStep
from pipeline.diffusion.rgb_gradients import (
    encoder_gradient,
    enlarge,
    held_inside,
    image_gradient,
    picture_gradient,
)
from pipeline.diffusion.sessions import vae_decoder, vae_encoder, vae_encoder_vjp
from pipeline.options.distillation import Distillation
from pipeline.training.batch import Batch, make_batch
from tests.tiny_bundle import SCALE, write_tiny_bundle

SIZE, LATENTS = 32, 8
RANDOM = np.random.default_rng(0)
TARGET = RANDOM.normal(size=(2, 4, LATENTS, LATENTS)).astype(np.float32)


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models") / "tiny"
    return write_tiny_bundle(folder, latent_size=LATENTS, encoder_vjp=True)


@pytest.fixture
def batch() -> Batch:
    views = (ring(2, 1.2, 2.0, 0.7), np.zeros(2), np.full(2, 1.2))
    backgrounds = np.array([[0.2, 0.4, 0.6], [1, 1, 0]], np.float32)
    return make_batch(views, backgrounds, Distillation(), 0.0, LATENTS, RANDOM)


def towards_target(latents: np.ndarray, batch: Batch) -> SdsStep:
    """Stand for score distillation: the gradient of half the squared distance from TARGET."""
    return SdsStep(latents - TARGET, TARGET, 0.0)


@pytest.mark.parametrize("size", [16, 32])
def test_the_gradient_through_the_encoder_is_that_of_the_latents(
    bundle: Path, batch: Batch, size: int
) -> None:
    """d/dI of |E(resize(I)) - target|^2 / 2, by differences along random directions, in float64 sums."""
    pictures = RANDOM.uniform(0.2, 0.8, (2, 3, size, size)).astype(np.float32)
    with (
        vae_encoder(bundle / "vae_encoder", SCALE) as encode,
        vae_encoder_vjp(bundle / "vae_encoder_vjp", SCALE) as pull_back,
    ):

        def half_distance(pictures: np.ndarray) -> float:
            large, _ = enlarge(pictures.astype(np.float32), SIZE)
            latents = encode(large.transpose(0, 2, 3, 1))
            return float(0.5 * np.square(latents - TARGET, dtype=np.float64).sum())

        gradient = encoder_gradient(towards_target, encode, pull_back, SIZE)(pictures, batch)
        for _ in range(3):
            direction = RANDOM.normal(size=pictures.shape)
            step = 0.02 * direction
            slope = (half_distance(pictures + step) - half_distance(pictures - step)) / 0.04
            assert (gradient * direction).sum() == pytest.approx(slope, rel=1e-3, abs=1e-2)


def test_both_ways_lead_to_the_picture_of_the_target(bundle: Path, batch: Batch) -> None:
    with (
        vae_encoder(bundle / "vae_encoder", SCALE) as encode,
        vae_decoder(bundle / "vae_decoder", SCALE) as decode,
        vae_encoder_vjp(bundle / "vae_encoder_vjp", SCALE) as pull_back,
    ):
        wanted = encode(decode(TARGET))  # what of the target three channels can hold

        def reachable(latents: np.ndarray, batch: Batch) -> SdsStep:
            return SdsStep(latents - wanted, wanted, 0.0)

        for guidance, rate in (
            (encoder_gradient(reachable, encode, pull_back, SIZE), 0.5),
            (image_gradient(reachable, encode, decode, SIZE), 0.05),
        ):
            pictures = np.full((2, 3, SIZE, SIZE), 0.5, np.float32)
            before = np.abs(encode(pictures.transpose(0, 2, 3, 1)) - wanted).mean()
            for _ in range(60):
                pictures -= rate * guidance(pictures, batch)
            after = np.abs(encode(pictures.clip(0, 1).transpose(0, 2, 3, 1)) - wanted).mean()
            assert after < 0.4 * before


def test_an_image_gradient_is_as_long_as_that_of_the_latents(bundle: Path, batch: Batch) -> None:
    pictures = RANDOM.uniform(0, 1, (2, 3, SIZE, SIZE)).astype(np.float32)
    with (
        vae_encoder(bundle / "vae_encoder", SCALE) as encode,
        vae_decoder(bundle / "vae_decoder", SCALE) as decode,
    ):
        gradient = image_gradient(towards_target, encode, decode, SIZE)(pictures, batch)
        latents = encode(pictures.transpose(0, 2, 3, 1))
    expected = np.sqrt(np.square(latents - TARGET).sum((1, 2, 3)))
    np.testing.assert_allclose(np.sqrt(np.square(gradient).sum((1, 2, 3))), expected, rtol=1e-4)


def test_a_picture_that_is_as_wanted_stays(batch: Batch) -> None:
    wanted = RANDOM.uniform(0, 1, (2, 3, 5, 5)).astype(np.float32)
    opacity = RANDOM.uniform(0, 1, (2, 5, 5)).astype(np.float32)
    guidance = picture_gradient(lambda batch: (wanted, opacity))
    assert batch.backgrounds is not None
    right = opacity[:, None] * wanted + (1 - opacity[:, None]) * batch.backgrounds[:, :, None, None]
    np.testing.assert_allclose(guidance(right, batch), 0, atol=1e-6)
    assert (guidance(right + 0.1, batch) > 0).all()
    learned = batch._replace(backgrounds=None)
    np.testing.assert_array_equal(guidance(wanted, learned), 0)


def test_resizing_and_its_gradient_are_adjoint() -> None:
    for size in (4, 9, 24):
        pictures, cotangent = RANDOM.normal(size=(1, 3, 9, 9)), RANDOM.normal(size=(1, 3, size, size))
        large, shrink = enlarge(pictures.astype(np.float32), size)
        small = shrink(cotangent.astype(np.float32))
        assert (large * cotangent).sum() == pytest.approx((pictures * small).sum(), rel=1e-4)


def test_colours_are_not_pushed_further_out() -> None:
    pictures = np.array([-0.1, -0.1, 0.5, 0.5, 1.2, 1.2], np.float32).reshape(1, 1, 1, 6).repeat(3, 1)
    gradient = np.array([1, -1, 1, -1, 1, -1], np.float32).reshape(1, 1, 1, 6).repeat(3, 1)
    np.testing.assert_array_equal(held_inside(pictures, gradient)[0, 0, 0], [0, -1, 1, -1, 1, 0])
