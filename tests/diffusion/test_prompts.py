"""Which words go with which camera."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.diffusion.prompts import (
    front_opposed,
    view_index,
    view_mix,
    view_table,
    view_texts,
    view_words,
)
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


def mixed(name: str, azimuth: float, polar: float = 80) -> dict[str, float]:
    """Return the words that a camera is between, with their shares; degrees."""
    (rows,), (share,) = view_mix(name, np.radians([azimuth]), np.radians([polar]))
    words = view_table(name)
    shares = {words[rows[0]]: 1 - share}
    shares[words[rows[1]]] = shares.get(words[rows[1]], 0) + share
    return {word: round(float(value), 3) for word, value in shares.items() if value > 1e-9}


def test_a_mix_is_linear_between_the_named_directions() -> None:
    assert mixed("eight", 0) == {"front view": 1}
    assert mixed("eight", 9) == {"front view": 0.8, "front left view": 0.2}
    assert mixed("eight", -9) == {"front right view": 0.2, "front view": 0.8}
    assert mixed("eight", 180) == {"back view": 1}
    assert mixed("eight", 9, 20) == {"overhead front view": 0.8, "overhead front left view": 0.2}
    assert mixed("paper", 0) == {"front view": 1}
    assert mixed("paper", 45) == mixed("paper", -45) == {"front view": 0.5, "side view": 0.5}
    assert mixed("paper", 90) == mixed("paper", 270) == {"side view": 1}
    assert mixed("paper", 171) == {"side view": 0.1, "back view": 0.9}
    assert mixed("paper", 180) == {"back view": 1}
    assert mixed("paper", 45, 10) == {"overhead view": 1}
    assert mixed("paper", 45, 170) == {"bottom view": 1}


@pytest.mark.parametrize("name", ["paper", "eight"])
@given(azimuth=st.floats(-100, 100), polar=st.floats(0, np.pi))
def test_the_mix_changes_continuously_and_sums_to_one(name: str, azimuth: float, polar: float) -> None:
    def weights(turn: float) -> np.ndarray:
        rows, share = view_mix(name, np.array([turn]), np.array([polar]))
        found = np.zeros(len(view_table(name)))
        np.add.at(found, rows[0], [1 - share[0], share[0]])
        return found

    assert weights(azimuth).sum() == pytest.approx(1)
    assert (weights(azimuth) >= 0).all()
    assert np.abs(weights(azimuth) - weights(azimuth + 1e-4)).max() < 1e-3


def test_the_front_is_opposed_from_behind() -> None:
    azimuth = np.radians([0, 90, 180, 270, 180])
    rows, away = front_opposed("eight", azimuth, np.radians([80, 80, 80, 80, 10]))
    assert [view_table("eight")[r] for r in rows] == ["front view"] * 4 + ["overhead front view"]
    np.testing.assert_allclose(away, [0, 0.5, 1, 0.5, 1], atol=1e-12)
    rows, away = front_opposed("paper", azimuth, np.radians([80, 80, 80, 80, 10]))
    assert not rows.any()
    np.testing.assert_allclose(away, [0, 0.5, 1, 0.5, 0], atol=1e-12)
