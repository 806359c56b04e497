"""View-dependent prompts: the words that tell the network which side of the object it sees.

A prompt becomes one text a view ("a red chair, back view"); a camera selects a row of those texts. Two
vocabularies: "paper", the five of Latent-NeRF's public code, for models trained on free text, and
"eight", the captions of the default bundle, eight azimuth sectors of 45 degrees, with or without
"overhead". Angles in radians: azimuth 0 sees the front, a quarter turn the object's left side (camera
at +X); polar is measured from straight above.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from pipeline.errors import InputError

_PAPER = ("front view", "side view", "back view", "overhead view", "bottom view")
_FRONT_HALF_WIDTH, _PAPER_OVERHEAD, _PAPER_BOTTOM = np.radians([35.0, 30.0, 150.0])
_SECTORS = (
    "front",
    "front left",
    "left side",
    "back left",
    "back",
    "back right",
    "right side",
    "front right",
)
_EIGHT = tuple(f"{prefix}{sector} view" for prefix in ("", "overhead ") for sector in _SECTORS)
_EIGHT_OVERHEAD = np.radians(35.0)
_WORDS = {"paper": _PAPER, "eight": _EIGHT}


def view_table(view_prompts: str) -> tuple[str, ...]:
    """Return the view words of a vocabulary in the order of `view_index`.

    Raises InputError for an unknown vocabulary.
    """
    if view_prompts not in _WORDS:
        raise InputError(f"view_prompts is {view_prompts!r}, expected one of {', '.join(_WORDS)}")
    return _WORDS[view_prompts]


def view_texts(prompt: str, view_prompts: str) -> list[str]:
    """Return the prompt of every view, "<prompt>, <view words>", in the order of `view_index`."""
    return [prompt + suffix for suffix in view_suffixes(view_prompts)]


def view_suffixes(view_prompts: str) -> list[str]:
    """Return what each view adds to the prompt: ", front view" and so on."""
    return [f", {words}" for words in view_table(view_prompts)]


def view_words(view_prompts: str, azimuth: float, polar: float) -> str:
    """Return the words of one view, without the comma; angles in radians."""
    return view_table(view_prompts)[int(view_index(view_prompts, np.array([azimuth]), np.array([polar]))[0])]


def view_index(
    view_prompts: str, azimuth: Float[np.ndarray, " b"], polar: Float[np.ndarray, " b"]
) -> Int[np.ndarray, " b"]:
    """Return the row of `view_table` for cameras at these angles [rad]; any azimuth, polar in [0, pi]."""
    size = len(view_table(view_prompts))
    turn = np.mod(azimuth, 2 * np.pi)
    if size == len(_EIGHT):
        sector = np.floor(turn / (np.pi / 4) + 0.5).astype(np.int64) % 8
        return sector + 8 * (polar <= _EIGHT_OVERHEAD)
    from_front = np.minimum(turn, 2 * np.pi - turn)
    around = np.select([from_front <= _FRONT_HALF_WIDTH, np.pi - from_front <= _FRONT_HALF_WIDTH], [0, 2], 1)
    return np.select([polar <= _PAPER_OVERHEAD, polar >= _PAPER_BOTTOM], [3, 4], around).astype(np.int64)


def view_mix(
    view_prompts: str, azimuth: Float[np.ndarray, " b"], polar: Float[np.ndarray, " b"]
) -> tuple[Int[np.ndarray, "b 2"], Float[np.ndarray, " b"]]:
    """Return the two rows of `view_table` between which each camera stands, and the share of the second.

    Linear in the azimuth between the directions that the words name: every 45 degrees ("eight"), every 90
    ("paper": front, side, back, side). Elevation changes the words at once, as in `view_index`; overhead
    and bottom views of "paper" have one row.
    """
    bins = view_index(view_prompts, azimuth, polar)
    turn = np.mod(azimuth, 2 * np.pi)
    if len(view_table(view_prompts)) == len(_EIGHT):
        place = turn / (np.pi / 4)
        first = np.floor(place).astype(np.int64) % 8
        rows = np.stack([first, (first + 1) % 8], axis=1) + (bins - bins % 8)[:, None]
        return rows, place - np.floor(place)
    quarters = np.minimum(turn, 2 * np.pi - turn) / (np.pi / 2)
    first = np.minimum(np.floor(quarters), 1).astype(np.int64)
    alone = bins > 2
    rows = np.where(alone[:, None], bins[:, None], np.stack([first, first + 1], axis=1))
    return rows, np.where(alone, 0.0, quarters - first)


def front_opposed(
    view_prompts: str, azimuth: Float[np.ndarray, " b"], polar: Float[np.ndarray, " b"]
) -> tuple[Int[np.ndarray, " b"], Float[np.ndarray, " b"]]:
    """Return the row of the front view at each camera's elevation, and how far the camera is turned away
    from it, (1 - cos azimuth) / 2: 0 in front, 1 behind; 0 where the words name no side ("paper" overhead).
    """
    bins = view_index(view_prompts, azimuth, polar)
    away = (1 - np.cos(azimuth)) / 2
    if len(view_table(view_prompts)) == len(_EIGHT):
        return bins - bins % 8, away
    return np.zeros_like(bins), np.where(bins > 2, 0.0, away)
