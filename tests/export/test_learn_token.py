"""A token from pictures: what is read, and that learning lowers the loss and touches nothing else."""

import copy
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from export.everyday_objects.data.kinds import KINDS
from export.everyday_objects.networks.autoencoder import Decoder, Encoder
from export.everyday_objects.networks.denoiser import CAMERA, Denoiser
from export.everyday_objects.networks.text_encoder import WIDTH, TextEncoder
from export.everyday_objects.train import learn_token
from export.everyday_objects.train.learn_token import (
    Pictures,
    cameras_of,
    captioned,
    denoising_loss,
    flat_latents,
    learn,
    nearest_noun,
    read_pictures,
    save,
    view_of,
)
from pipeline.diffusion.prompts import view_table, view_words
from pipeline.diffusion.token_files import read_token
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.errors import InputError

FOLDER = Path(__file__).parents[2] / "onnx_models" / "everyday-objects"


@pytest.mark.parametrize(
    ("stem", "view"),
    [
        ("front", "front view"),
        ("front-left-3", "front left view"),
        ("Back_Right", "back right view"),
        ("overhead_front left (2)", "overhead front left view"),
        ("IMG_2041", ""),
        ("backpack", ""),
    ],
)
def test_a_files_name_says_the_view(stem: str, view: str) -> None:
    assert view_of(stem) == view


def test_pictures_are_squares_in_the_order_of_their_names(tmp_path: Path) -> None:
    for i, name in enumerate(("b.png", "a.jpg", "front.webp")):
        Image.new("RGB", (300, 200 + i), (i, 100, 200)).save(tmp_path / name)
    (tmp_path / "notes.txt").write_text("x")
    pictures = read_pictures(tmp_path)
    assert pictures.images.shape == (3, 128, 128, 3)
    assert pictures.views == ["", "", "front view"]


def test_plain_and_transparent_backdrops_are_exchanged_and_others_stay(tmp_path: Path) -> None:
    shown = np.zeros((128, 128, 4), np.uint8)
    shown[40:90, 40:90] = (200, 30, 30, 255)
    Image.fromarray(shown).save(tmp_path / "a.png")
    shown[..., 3] = 255
    Image.fromarray(shown).save(tmp_path / "b.png")
    noise = np.random.default_rng(0).integers(0, 255, (128, 128, 3)).astype(np.uint8)
    Image.fromarray(noise).save(tmp_path / "c.png")
    pictures = read_pictures(tmp_path)
    assert [c is None for c in pictures.coverages] == [False, False, True]
    over, backdrops = learn_token.over_backdrops(np.random.default_rng(1), pictures)
    assert over.shape == (learn_token.BACKDROPS, 3, 128, 128, 3)
    assert (over[:, :2, 45:85, 45:85] == (200, 30, 30)).all()
    corners = over[:, :2, 0, 0].reshape(-1, 3)
    assert len(np.unique(corners, axis=0)) > learn_token.BACKDROPS
    assert (over[:, 2] == noise).all()
    np.testing.assert_allclose(over[:, :2, 0, 0], 255 * backdrops[:, :2], atol=0.51)
    assert np.isnan(backdrops[:, 2]).all()


def test_cameras_are_those_that_the_words_name_and_zeros_where_nothing_is_known() -> None:
    views = [*view_table("eight"), ""]
    backdrops = np.arange(4 * len(views), dtype=np.float32).reshape(-1, 4)
    backdrops[2] = np.nan
    rows = cameras_of(views, backdrops).numpy()
    assert rows.dtype == np.float32
    assert rows.shape == (17, len(CAMERA))
    for view, row in zip(views[:-1], rows, strict=False):
        assert view_words("eight", float(row[1]), float(row[2])) == view
    np.testing.assert_allclose(rows[:16, [0, 3]], [[1, 2.5]] * 16)
    np.testing.assert_allclose(rows[:16, 4], np.radians(39.5), rtol=1e-6)
    assert np.degrees(rows[[0, 8], 2]) == pytest.approx([75, 25])
    assert not rows[16, :5].any()
    assert not rows[2, 5:].any()
    np.testing.assert_array_equal(rows[16, 5:], [1, *backdrops[16]])


@torch.no_grad()
def test_a_backdrops_latents_are_those_of_its_pixels() -> None:
    torch.manual_seed(0)
    encoder = Encoder(8, 1).eval()
    colours = np.array([[0.2, 0.5, 0.9], [1, 1, 1]], np.float32)
    latents = encoder(torch.from_numpy(colours)[:, :, None, None].expand(-1, -1, 64, 64)).numpy()
    np.testing.assert_allclose(flat_latents(encoder, colours), latents[:, :, 5, 9], atol=1e-5)


def test_the_denoiser_is_told_the_cameras_and_sees_every_picture_alone() -> None:
    seen = []

    def denoiser(noised, timesteps, text, cameras, views):
        seen.append((cameras, views))
        return torch.zeros_like(noised)

    cameras = torch.rand(3, len(CAMERA))
    clean = torch.zeros(3, 4, 8, 8)
    loss = denoising_loss(denoiser, clean, torch.zeros(3, 5, WIDTH), cameras, np.random.default_rng(0))
    assert loss.shape == (3,)
    assert seen == [(cameras, 1)]


def test_captions_have_the_article_that_they_were_trained_with() -> None:
    assert captioned("owl", "back view") == "an owl, back view"
    assert captioned("*", "") == "a *"


def test_what_is_wrong_with_pictures_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="0 pictures"):
        read_pictures(tmp_path / "absent")
    (tmp_path / "a.png").write_bytes(b"<html>")
    with pytest.raises(InputError, match=r"a\.png is no picture"):
        read_pictures(tmp_path)


@pytest.mark.parametrize("given", [{}, {"NAME": "a b"}, {"NAME": "x"}, {"NAME": "x", "IMAGES": "nowhere"}])
def test_the_command_names_what_is_missing(
    given: dict[str, str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("NAME", "IMAGES"):
        monkeypatch.setenv(name, given.get(name, ""))
    monkeypatch.setattr("sys.argv", ["learn_token"])
    assert learn_token.main() == 2
    assert capsys.readouterr().err.startswith("error: ")


def test_a_token_that_is_there_is_not_overwritten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tokens").mkdir()
    (tmp_path / "tokens" / "mine.safetensors").write_bytes(b"dear")
    monkeypatch.setenv("NAME", "mine")
    monkeypatch.setenv("IMAGES", str(tmp_path))
    monkeypatch.setattr("sys.argv", ["learn_token"])
    assert learn_token.main() == 2
    assert "mine.safetensors exists" in capsys.readouterr().err
    assert (tmp_path / "tokens" / "mine.safetensors").read_bytes() == b"dear"


def test_a_token_learns_what_its_words_say_and_the_weights_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A small denoiser that answers to the text: the loss of the token falls below that of its start."""
    monkeypatch.setattr(learn_token, "KINDS", KINDS[:2])
    torch.manual_seed(0)
    tokenizer = load_tokenizer(FOLDER / "tokenizer")
    text_encoder = TextEncoder(tokenizer.engine.get_vocab_size(), layers=1)
    networks = (Encoder(8, 1).eval(), Decoder().eval(), Denoiser((16, 32, 64), (0, 2, 2)), text_encoder)
    for parameter in networks[2].parameters():
        if not parameter.any():  # new layers add nothing: neither would the text
            torch.nn.init.normal_(parameter, std=0.05)
    before = copy.deepcopy(networks[2].state_dict())
    images = np.random.default_rng(0).integers(0, 255, (2, 128, 128, 3)).astype(np.uint8)
    pictures = Pictures(images, ["front view", ""], [np.zeros((128, 128), np.float32), None])
    embeddings, noun = learn(pictures, networks, tokenizer, steps=3, vectors=2)
    assert noun in (KINDS[0].words[0], KINDS[1].words[0])
    assert embeddings.shape == (2, WIDTH)
    assert torch.isfinite(embeddings).all()
    words = text_encoder.tokens.weight.norm(dim=1)
    assert embeddings.norm(dim=1).max() <= words.max() * 1.0001
    again, _ = learn(pictures, networks, tokenizer, steps=3, vectors=2)
    torch.testing.assert_close(embeddings, again)
    for name, value in networks[2].state_dict().items():
        assert torch.equal(value, before[name])
    started, _ = learn(pictures, networks, tokenizer, steps=0, vectors=2)
    assert (embeddings - started).abs().max() > 0.005
    save(tmp_path / "tokens" / "mine.safetensors", "mine", embeddings)
    token = read_token(tmp_path / "tokens" / "mine.safetensors")
    assert token.names == ("<mine>", "mine")
    np.testing.assert_array_equal(token.vectors, embeddings.numpy())


def test_the_nearest_noun_is_the_one_with_the_least_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    tokenizer = load_tokenizer(FOLDER / "tokenizer")
    words = [kind.words[0] for kind in KINDS[:4]]
    monkeypatch.setattr(learn_token, "KINDS", KINDS[:4])
    wanted = torch.from_numpy(tokenizer.encode(f"a {words[2]}")).float()

    def loss(denoiser, clean, text, cameras, rng):
        return (text[:, :, 0] - wanted).abs().sum(1)

    monkeypatch.setattr(learn_token, "denoising_loss", loss)
    found = nearest_noun(
        (None, lambda ids: ids.float()[..., None]),
        tokenizer,
        torch.zeros(2, 4, 8, 8),
        ["", ""],
        torch.zeros(2, len(CAMERA)),
    )
    assert found == words[2]
