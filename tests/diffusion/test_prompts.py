"""Which words go with which camera."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.diffusion.prompts import view_index, view_table, view_texts, view_words
from pipeline.errors import InputError


@pytest.mark.parametrize(
    ("azimuth", "polar", "words"),
    [
        (0, 90, "front view"),
        (22, 90, "front view"),
        (23, 90, "front left view"),
        (45, 60, "front left view"),
        (90, 150, "left side view"),
        (135, 90, "back left view"),
        (180, 90, "back view"),
        (225, 90, "back right view"),
        (270, 90, "right side view"),
        (315, 90, "front right view"),
        (-45, 90, "front right view"),
        (338, 90, "front view"),
        (359.9, 36, "front view"),
        (0, 34, "overhead front view"),
        (270, 0, "overhead right side view"),
    ],
)
def test_eight_sectors(azimuth: float, polar: float, words: str) -> None:
    assert view_words("eight", np.radians(azimuth), np.radians(polar)) == words


@pytest.mark.parametrize(
    ("azimuth", "polar", "words"),
    [
        (0, 90, "front view"),
        (34, 90, "front view"),
        (36, 90, "side view"),
        (-34, 90, "front view"),
        (144, 90, "side view"),
        (146, 90, "back view"),
        (214, 90, "back view"),
        (270, 90, "side view"),
        (0, 29, "overhead view"),
        (200, 0, "overhead view"),
        (0, 31, "front view"),
        (90, 151, "bottom view"),
    ],
)
def test_the_papers_five(azimuth: float, polar: float, words: str) -> None:
    assert view_words("paper", np.radians(azimuth), np.radians(polar)) == words


@given(st.floats(-100, 100), st.floats(0, np.pi), st.integers(-3, 3))
def test_a_whole_turn_changes_nothing(azimuth: float, polar: float, turns: int) -> None:
    for name in ("paper", "eight"):
        index = view_index(name, np.array([azimuth]), np.array([polar]))
        assert 0 <= index[0] < len(view_table(name))
        near = azimuth + 1e-9 * np.array([-1, 1]) + 2 * np.pi * turns
        assert index[0] in view_index(name, near, np.array([polar, polar]))


def test_many_cameras_at_once_and_every_word_is_used() -> None:
    azimuth, polar = np.meshgrid(np.linspace(0, 2 * np.pi, 97), np.linspace(0, np.pi, 33))
    for name in ("paper", "eight"):
        rows = view_index(name, azimuth.ravel(), polar.ravel())
        assert np.issubdtype(rows.dtype, np.integer)
        assert set(rows.tolist()) == set(range(len(view_table(name))))


def test_texts() -> None:
    texts = view_texts("a red chair", "eight")
    assert len(texts) == 16
    assert texts[0] == "a red chair, front view"
    assert texts[8] == "a red chair, overhead front view"
    assert view_texts("{x}", "paper")[4] == "{x}, bottom view"


def test_an_unknown_vocabulary_is_named() -> None:
    with pytest.raises(InputError, match="seven"):
        view_texts("a chair", "seven")
