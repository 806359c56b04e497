"""The bundle that ships: whole, small enough, and a model that was really trained."""

import numpy as np
import pytest

from export.everyday_objects.captions import COLOURS, name_colours
from export.everyday_objects.sample import ddim
from pipeline.diffusion import sessions
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.job import DEFAULT_MODEL, MODELS

FOLDER = MODELS / DEFAULT_MODEL
MEGABYTES = 60


def test_it_is_whole_and_small_enough() -> None:
    bundle = open_bundle(FOLDER)  # compares every checksum
    assert bundle.view_prompts == "eight"
    assert sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file()) <= MEGABYTES * 1e6


@pytest.fixture(scope="module")
def pictures() -> dict[str, np.ndarray]:
    """Two views, in 12 steps, of a mushroom in each of three colours: (2, 128, 128, 3) each."""
    names = ("red", "green", "blue")
    tokenizer, schedule = load_tokenizer(FOLDER / "tokenizer"), load_schedule(FOLDER / "scheduler")
    texts = ["", *(f"a {name} mushroom, {view}" for name in names for view in ("front view", "back view"))]
    with sessions.text_encoder(FOLDER / "text_encoder") as encode_text:
        text = encode_text(np.stack([tokenizer.encode(t) for t in texts]))
    with sessions.denoiser(FOLDER / "unet") as denoise:
        latents = ddim(denoise, schedule, text[1:], text[0], 32, guidance=5.0, steps=12, seed=1)
    with sessions.vae_decoder(FOLDER / "vae_decoder") as decode:
        images = decode(latents)
    return {name: images[2 * i : 2 * i + 2] for i, name in enumerate(names)}


def test_it_paints_the_colour_it_was_asked_for(pictures: dict[str, np.ndarray]) -> None:
    """The cap fills the middle; the plain background around it may have any colour."""
    for name, images in pictures.items():
        middle = images[:, 40:76, 44:84].reshape(-1, 3)
        words = name_colours(np.clip(middle, 0, 1))
        shares = {c: float((words == COLOURS.index(c)).mean()) for c in pictures}
        assert max(shares, key=lambda c: shares[c]) == name, shares
        assert shares[name] > 0.4, shares


def test_pictures_are_smooth_not_noise(pictures: dict[str, np.ndarray]) -> None:
    """Neighbouring pixels agree far better than any two pixels: an untrained net's pictures fail this."""
    for images in pictures.values():
        slopes = np.abs(np.diff(images, axis=1)).mean()
        assert slopes < 0.2 * images.std()
