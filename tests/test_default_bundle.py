"""The bundle that ships: whole, small enough, and a model that was really trained."""

import numpy as np
import pytest

from export.everyday_objects.data.kinds import KINDS
from export.everyday_objects.train.sample import of_bundle, paint
from pipeline.diffusion.bundle import open_bundle
from pipeline.options.models import DEFAULT_MODEL, MODELS

FOLDER = MODELS / DEFAULT_MODEL
MEGABYTES = 60


def test_it_is_whole_and_small_enough() -> None:
    bundle = open_bundle(FOLDER)  # compares every checksum
    assert bundle.view_prompts == "eight"
    assert bundle.views == 4
    assert {"azimuth", "polar", "distance", "fov", "backdrop"} <= set(bundle.camera)
    assert bundle.known_words is not None
    assert {w for k in KINDS for w in k.words[0].lower().split() if w.isalpha()} <= bundle.known_words
    assert sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file()) <= MEGABYTES * 1e6


@pytest.fixture(scope="module")
def pictures() -> dict[str, np.ndarray]:
    """Four views, in 12 steps, of a mushroom in each of three colours: (4, 128, 128, 3) each."""
    names = ("red", "green", "blue")
    with of_bundle(FOLDER) as painter:
        images = paint(painter, [f"a {name} mushroom" for name in names], guidance=3.0, steps=12, seed=1)
    return dict(zip(names, images, strict=True))


def test_it_paints_the_colour_it_was_asked_for(pictures: dict[str, np.ndarray]) -> None:
    """The cap fills the middle; of its pixels with any colour most are of that one."""
    for i, (name, images) in enumerate(pictures.items()):
        middle = images[:, 40:76, 44:84].reshape(-1, 3)
        coloured = middle[np.ptp(middle, axis=1) > 0.25]
        assert len(coloured) > 0.3 * len(middle), name
        assert (coloured.argmax(axis=1) == i).mean() > 0.8, name


def test_pictures_are_smooth_not_noise(pictures: dict[str, np.ndarray]) -> None:
    """Neighbouring pixels agree far better than any two pixels: an untrained net's pictures fail this."""
    for images in pictures.values():
        slopes = np.abs(np.diff(images, axis=1)).mean()
        assert slopes < 0.2 * images.std()


def test_its_views_differ(pictures: dict[str, np.ndarray]) -> None:
    """The camera acts: four sides of one object, before one backdrop, are not one picture."""
    with of_bundle(FOLDER) as painter:
        (car,) = paint(painter, ["a car"], guidance=3.0, steps=12)
    assert np.abs(car[0] - car[1]).mean() > 0.02
    np.testing.assert_allclose(car[:, :6, :6].mean((1, 2)), 0.8, atol=0.1)
