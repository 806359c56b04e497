"""The default model's networks: shapes, cameras and rays, views that see each other, weights restored from
graphs.
"""

import numpy as np
import pytest
import torch

from export.everyday_objects.networks.autoencoder import (
    DETAIL,
    Decoder,
    Encoder,
    blur_detail,
    no_colour,
    quieten_detail,
)
from export.everyday_objects.networks.denoiser import CAMERA, Denoiser, camera_features, ray_map
from export.everyday_objects.networks.text_encoder import MAX_TOKENS, WIDTH, TextEncoder
from export.everyday_objects.train import train_autoencoder
from export.everyday_objects.train.export_bundle import fit_latent_to_rgb
from export.everyday_objects.train.restore import constants, randomise, transfer
from export.graph import export_graph
from pipeline.cameras import camera_rays, orbit_camera
from pipeline.diffusion.bundle import CAMERA_COLUMNS

SMALL = {"channels": (16, 24, 32), "heads": (0, 2, 2), "embedding": 32}


def small_denoiser() -> Denoiser:
    """A denoiser whose every layer acts."""
    torch.manual_seed(0)
    denoiser = Denoiser(**SMALL).eval()
    for parameter in denoiser.parameters():
        if not parameter.any():
            torch.nn.init.normal_(parameter, std=0.2)
    return denoiser


def inputs(rows: int) -> dict[str, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    return {
        "sample": torch.randn(rows, 4, 16, 16, generator=generator),
        "timestep": torch.full((rows,), 500),
        "encoder_hidden_states": torch.randn(rows, 5, WIDTH, generator=generator),
        "camera": torch.rand(rows, len(CAMERA), generator=generator),
    }


@torch.no_grad()
def test_network_shapes():
    images = torch.rand(2, 3, 64, 64)
    latents = Encoder().eval()(images)
    assert latents.shape == (2, 4, 16, 16)
    assert Decoder()(latents).shape == images.shape
    text = TextEncoder(600)(torch.zeros(2, MAX_TOKENS, dtype=torch.long))
    assert text.shape == (2, MAX_TOKENS, WIDTH)
    assert small_denoiser()(**inputs(4)).shape == (4, 4, 16, 16)


@torch.no_grad()
def test_detail_is_blurred_and_the_linear_picture_stays():
    torch.manual_seed(0)
    decoder, latents = Decoder(), torch.randn(32, 4, 8, 8)
    change = blur_detail(decoder, latents) - latents
    nothing = decoder.linear(torch.zeros_like(change))
    assert (decoder.linear(change) - nothing).abs().max() < 1e-5
    moved = change.flatten(1).abs().amax(1)
    assert 0.5 < float((moved > 0).float().mean()) < 1
    assert float(moved.max()) > 1


@torch.no_grad()
def test_quietened_detail_leaves_pictures_and_colours_as_they_are():
    torch.manual_seed(0)
    encoder, decoder, images = Encoder(), Decoder(), torch.rand(8, 3, 64, 64)
    encoder.whiten.momentum = None  # the mean over what it has seen
    for _ in range(3):
        encoder(images)
    latents = encoder.eval()(images)
    pictures, direction = decoder(latents), no_colour(decoder)
    quieten_detail(encoder, decoder, images)
    quiet = encoder(images)
    assert float(torch.einsum("c,bchw->bhw", direction, quiet).std()) == pytest.approx(DETAIL, rel=1e-3)
    assert torch.allclose(decoder.linear(quiet), decoder.linear(latents), atol=1e-4)
    assert torch.allclose(decoder(quiet), pictures, atol=1e-3)


def test_the_decoder_alone_is_trained_and_latents_stay(tmp_path):
    torch.manual_seed(0)
    before = {"encoder": Encoder().state_dict(), "decoder": Decoder().state_dict()}
    torch.save(before, tmp_path / "autoencoder.pt")
    pictures = np.random.default_rng(0).integers(0, 255, (8, 256, 256, 3), np.uint8)
    np.save(tmp_path / "autoencoder_pictures.npy", pictures)
    encoder, decoder = train_autoencoder.train(tmp_path, 2, batch=2, decoder_alone=True)
    assert all(torch.equal(value, before["encoder"][name]) for name, value in encoder.state_dict().items())
    assert any(
        not torch.equal(value, before["decoder"][name]) for name, value in decoder.state_dict().items()
    )
    both, _ = train_autoencoder.train(tmp_path, 2, batch=2)
    assert any(not torch.equal(value, before["encoder"][name]) for name, value in both.state_dict().items())


def test_rays_are_those_of_the_pipelines_cameras():
    camera = orbit_camera(0.7, 1.1, 2.5, 0.66)
    origin, directions = camera_rays(camera, 8)
    rays = ray_map(torch.tensor([[1, 0.7, 1.1, 2.5, 0.66, 0, 0, 0, 0, 0]]), 8, 8)[0].flatten(1).T.numpy()
    np.testing.assert_allclose(rays[:, :3], directions, atol=1e-5)
    np.testing.assert_allclose(rays[:, 3:], np.cross(origin[None], directions), atol=1e-5)


def test_a_row_of_zeros_tells_nothing():
    untold = torch.tensor([[0, 0.7, 1.1, 2.5, 0.66, 0, 0.3, 0.3, 0.3, 0.3]])
    assert not ray_map(untold, 4, 4).any()
    assert not camera_features(untold).any()
    assert set(CAMERA) == set(CAMERA_COLUMNS)


@torch.no_grad()
def test_views_of_an_object_see_each_other_and_no_others():
    denoiser, given = small_denoiser(), inputs(8)
    before = denoiser(**given)
    given["sample"][5] += 1
    moved = (denoiser(**given) - before).abs().amax((1, 2, 3))
    assert (moved[:4] == 0).all()
    assert (moved[4:] > 1e-6).all()
    alone = denoiser(**given, views=1)
    given["sample"][5] -= 1
    moved = (denoiser(**given, views=1) - alone).abs().amax((1, 2, 3))
    assert moved[[0, 1, 2, 3, 4, 6, 7]].max() == 0


@torch.no_grad()
@pytest.mark.parametrize("name", ["camera", "encoder_hidden_states"])
def test_every_condition_acts(name):
    denoiser, given = small_denoiser(), inputs(4)
    before = denoiser(**given)
    given[name] = given[name] + 0.5
    assert (denoiser(**given) - before).abs().max() > 1e-3


def test_latent_to_rgb_recovers_a_linear_map():
    rng = np.random.default_rng(0)
    latents = rng.uniform(-1, 1, (3, 4, 8, 8)).astype(np.float32)
    matrix, bias = rng.normal(size=(3, 4)) * 0.2, np.array([0.1, -0.1, 0.0])
    rgb = np.einsum("kc,nchw->nhwk", matrix, latents) + bias
    images = np.repeat(np.repeat((rgb + 1) * 127.5, 4, 1), 4, 2).round().astype(np.uint8)
    found, offset, r2 = fit_latent_to_rgb(latents, images)
    assert np.abs(found - matrix).max() < 0.01
    assert np.abs(offset - bias).max() < 0.01
    assert r2 > 0.999


def test_weights_are_restored_from_a_graph(tmp_path):
    torch.manual_seed(0)
    networks = {name: TextEncoder(520, layers=1) for name in ("trained", "probe")}
    for name, network in networks.items():
        randomise(network)
        ids = {"input_ids": torch.arange(2 * MAX_TOKENS).reshape(2, MAX_TOKENS)}
        export_graph(network, ids, ["last_hidden_state"], tmp_path / name, half_weights=True)
    transfer(networks["probe"], constants(tmp_path / "probe"), constants(tmp_path / "trained"))
    for found, expected in zip(networks["probe"].parameters(), networks["trained"].parameters(), strict=True):
        assert torch.equal(found, expected.half().float())
    with pytest.raises(ValueError, match=r"architecture has changed"):
        transfer(TextEncoder(520, layers=1), constants(tmp_path / "probe"), constants(tmp_path / "trained"))
