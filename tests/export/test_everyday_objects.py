"""The default model's data: colours mean what they say, captions match pictures, networks have the right
shapes.
"""

import re

import numpy as np
import pytest
import torch

from export.everyday_objects import captions, procedural
from export.everyday_objects.autoencoder import Decoder, Encoder
from export.everyday_objects.catalogue import RADIUS
from export.everyday_objects.dataset import Source, draw_sample, recolour
from export.everyday_objects.denoiser import Denoiser
from export.everyday_objects.export_bundle import fit_latent_to_rgb
from export.everyday_objects.nouns import NOUNS, noun_of
from export.everyday_objects.render import Light, render
from export.everyday_objects.restore import constants, randomise, transfer
from export.everyday_objects.text_encoder import MAX_TOKENS, WIDTH, TextEncoder
from export.everyday_objects.train_denoiser import (
    TIMESTEPS,
    cumulative_shares,
    draw_timesteps,
    view_harmonics,
    view_loss,
)
from export.graph import export_graph
from pipeline.diffusion.prompts import view_table
from pipeline.scene.cameras import orbit_camera
from pipeline.scene.rasterize import rasterize

BY_WORD = {n.words[0]: n for n in NOUNS}


@pytest.mark.parametrize("name", captions.COLOURS)
def test_drawn_colours_are_named_as_drawn(name):
    rng = np.random.default_rng(0)
    colours = np.stack([captions.draw_colour(rng, name) for _ in range(400)])
    assert (captions.name_colours(colours) == captions.COLOURS.index(name)).mean() >= 0.97


def test_hsv_round_trip():
    rgb = np.random.default_rng(0).uniform(0, 1, (200, 3)).astype(np.float32)
    hsv = captions.rgb_to_hsv(rgb)
    assert np.allclose([captions.hsv_to_rgb(c) for c in hsv], rgb, atol=1e-5)


def test_captions_use_known_words_only_and_name_the_view():
    rng = np.random.default_rng(0)
    known = set(captions.known_words())
    seen = 0
    for _ in range(300):
        noun = NOUNS[rng.integers(len(NOUNS))]
        text = captions.caption(rng, noun, "red", np.pi, 1.3)
        assert set(re.findall(r"\w+", text)) <= known
        seen += "back view" in text
        assert "front" not in text
    assert 240 <= seen <= 295  # nine in ten


@pytest.mark.parametrize("word", procedural.MAKERS)
def test_procedural_objects_are_sound(word):
    rng = np.random.default_rng(1)
    assert word in BY_WORD
    for _ in range(3):
        model = procedural.MAKERS[word](rng)
        assert np.isfinite(model.vertices).all()
        assert np.isclose(np.linalg.norm(model.vertices, axis=1).max(), RADIUS, atol=1e-5)
        assert model.faces.min() >= 0
        assert model.faces.max() < len(model.vertices)
        assert model.material.max() < len(model.colours)


def test_picture_shows_the_silhouette_and_the_background():
    model = procedural.duck(np.random.default_rng(2))
    camera = orbit_camera(0.5, 1.2, 2.5, 0.7)
    wood = np.zeros(len(model.colours), np.float32)
    light = Light(1.0, 0.0, 0.0, np.array([0.0, 1.0, 0.0]))
    background = np.array([0.2, 0.4, 0.6], np.float32)
    picture = render(model, wood, camera, 64, light, background)
    mask = rasterize(camera, model.vertices, model.faces, 64).mask
    empty = np.all(np.isclose(picture.image, background, atol=1e-6), axis=-1)
    assert (empty == mask).mean() < 0.06  # they may agree only along the anti-aliased rim
    assert len(picture.albedo) == pytest.approx(4 * mask.sum(), rel=0.05)


def test_recolouring_gives_the_colour_it_names():
    rng = np.random.default_rng(3)
    agree = 0
    for _ in range(40):
        model, _, word = recolour(rng, procedural.ball(rng))
        assert word == "wooden" or word in captions.COLOURS
        names = captions.name_colours(model.colours[:, :3])
        agree += word == "wooden" or captions.COLOURS.index(word) in names
    assert agree >= 36


def test_samples_repeat_with_their_seed():
    source = Source(BY_WORD["mushroom"], ())
    first, second = (draw_sample(np.random.default_rng([5, 6]), source, 32) for _ in range(2))
    assert np.array_equal(first.image, second.image)
    assert first[1:] == second[1:]


def test_catalogue_names_map_to_one_noun():
    assert noun_of("Winchester armchair") == BY_WORD["armchair"]
    assert noun_of("chair") == BY_WORD["chair"]
    assert noun_of("Clothes horse") is None
    assert noun_of("wheelchair") is None


@torch.no_grad()
def test_network_shapes():
    images = torch.rand(2, 3, 64, 64)
    latents = Encoder().eval()(images)
    assert latents.shape == (2, 4, 16, 16)
    assert Decoder()(latents).shape == images.shape
    text = TextEncoder(600)(torch.zeros(2, MAX_TOKENS, dtype=torch.long))
    assert text.shape == (2, MAX_TOKENS, WIDTH)
    assert Denoiser()(latents, torch.tensor([3, 990]), text).shape == latents.shape


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


def test_nouns_are_drawn_by_their_weights_whatever_was_rendered():
    rows = [{"noun": "chair"}] * 30 + [{"noun": "barrel"}] * 10
    shares = np.diff(cumulative_shares(rows), prepend=0)
    assert np.isclose(shares.sum(), 1)
    assert np.isclose(
        shares[:30].sum() / shares[30:].sum(), BY_WORD["chair"].weight / BY_WORD["barrel"].weight
    )


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


def test_view_words_have_directions_of_their_own():
    front, back = view_harmonics("a red chair, front view"), view_harmonics("a red chair, back view")
    assert np.allclose(front, [0, 0, 1, 1, 0])
    assert np.allclose(back, [0, 0, -1, 1, 0], atol=1e-6)
    assert view_harmonics("a red chair, overhead left side view")[4] == 1
    assert not view_harmonics("a red chair").any()
    assert not view_harmonics("").any()


def test_text_encoder_learns_what_view_words_say():
    torch.manual_seed(0)
    encoder = TextEncoder(40, layers=1)
    texts = [f"a chair, {view}" for view in view_table("eight")] + ["a chair"]
    ids = torch.arange(len(texts))[:, None].repeat(1, MAX_TOKENS)
    optimiser = torch.optim.Adam(encoder.parameters(), 3e-3)
    losses = []
    for _ in range(60):
        loss = view_loss(encoder(ids), texts)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(loss.item())
    assert losses[-1] < 0.02 * losses[0]


def test_timesteps_favour_what_distillation_visits():
    drawn = np.concatenate([draw_timesteps(np.random.default_rng(i), 64) for i in range(200)])
    assert drawn.min() >= 0
    assert drawn.max() < TIMESTEPS
    assert (drawn < 0.2 * TIMESTEPS).mean() == pytest.approx(0.1, abs=0.01)
    assert (drawn >= 0.7 * TIMESTEPS).mean() == pytest.approx(0.5, abs=0.01)
