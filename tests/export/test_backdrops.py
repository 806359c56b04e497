"""Where the object is in a picture on a plain backdrop."""

import numpy as np
import pytest

from export.everyday_objects.train.backdrops import coverage

Y, X = np.mgrid[:64, :64]


def disc(radius: float, y: float = 32, x: float = 32) -> np.ndarray:
    return (Y - y) ** 2 + (X - x) ** 2 < radius**2


@pytest.mark.parametrize("backdrop", [0, 200, 255])
def test_the_object_is_found_and_not_what_looks_alike_inside(backdrop: int) -> None:
    rng = np.random.default_rng(0)
    image = np.full((64, 64, 3), backdrop, np.int16)
    image[disc(20)] = (120, 40, 60)
    image[disc(6)] = backdrop  # a part of the object in the backdrop's colour
    image = np.clip(image + rng.integers(-5, 6, image.shape), 0, 255).astype(np.uint8)
    found = coverage(image)
    assert found is not None
    assert found.dtype == np.float32
    assert set(np.unique(found)) == {0, 1}
    assert (found[disc(18)] == 1).all()
    assert (found[~disc(20.5)] == 0).all()


def test_an_object_may_stand_on_the_border() -> None:
    image = np.full((64, 64, 3), 230, np.uint8)
    image[30:, 28:36] = (20, 90, 40)
    found = coverage(image)
    assert found is not None
    assert (found[32:, 30:34] == 1).all()
    assert found[:28].max() == 0


def test_a_photograph_has_no_plain_backdrop() -> None:
    image = np.stack([4 * X, 4 * Y, 2 * (X + Y)], axis=-1).clip(0, 255).astype(np.uint8)
    assert coverage(image) is None
    assert coverage(np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8)) is None


def test_a_picture_of_nothing_shows_nothing() -> None:
    assert np.array_equal(coverage(np.full((8, 8, 3), 90, np.uint8)), np.zeros((8, 8)))
