"""Captions: what an object is, how it looks, and from where it is seen."""

import re

import numpy as np

from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.kinds import KINDS
from export.everyday_objects.data.looks import Look, draw_look, say
from export.everyday_objects.data.materials import MATERIALS
from pipeline.diffusion.prompts import view_words

_OPENINGS = ("a 3d model of ", "a photo of ", "a rendering of ", "a highly detailed ", "a toy ", "a cute ")
_LOOK_LEFT_OUT, _OPENED = 0.06, 0.06


def caption(rng: np.random.Generator, kind: Kind, look: Look) -> str:
    """Return a caption without view words; the look is left out now and then, so that kinds work alone."""
    text = say(rng, kind, Look() if rng.random() < _LOOK_LEFT_OUT else look)
    if rng.random() < _OPENED:
        opening = _OPENINGS[rng.integers(len(_OPENINGS))]
        bare = text.removeprefix("an ").removeprefix("a ")
        text = opening + (text if opening.endswith("of ") else bare)
    return text


def seen_from(text: str, azimuth: float, polar: float) -> str:
    """Return a caption with the words for a view [rad]."""
    return f"{text}, {view_words('eight', azimuth, polar)}"


def example_texts(count: int) -> list[str]:
    """Return captions to learn a tokenizer from, the same ones every time."""
    rng = np.random.default_rng(1)
    texts = []
    for i in range(count):
        kind = KINDS[i % len(KINDS)]
        text = caption(rng, kind, draw_look(rng, kind, kind.roles))
        texts.append(seen_from(text, rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.8)))
    return texts


def known_words() -> list[str]:
    """Return every word that captions are made of, sorted."""
    texts = [w for k in KINDS for w in (*k.words, *(p.format("") for p in k.said.values()))]
    texts += [*COLOURS, *(f"{m.adjective} {m.noun}" for m in MATERIALS.values()), *_OPENINGS]
    texts += ["front back left right side overhead view a an and with made of"]
    return sorted(set(re.findall(r"[^\W\d_]+(?:'[^\W\d_]+)?", " ".join(texts).lower())))
