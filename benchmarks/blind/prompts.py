"""Which prompts: every kind of object, in colours and materials that are drawn, the same ones every time."""

import re
import zlib
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.kinds import KINDS
from export.everyday_objects.data.materials import MATERIALS

DRAW = 2027
"""Seed of all that is drawn; no training has it."""
AS_IT_IS, COLOURED, WITH_PART = 0.15, 0.4, 0.25
"""Shares of prompts that name no look, a colour, a colour and a part's; the rest name a material."""
MADE_OF = 0.4
"""Share of "a house made of lego" in place of "a lego house"."""
PLURAL = ("pancakes",)
"""Main words that take no article."""


class Asked(NamedTuple):
    """A prompt and what it asks for; empty where it does not."""

    prompt: str
    kind: str
    """Main word of the kind."""
    colour: str = ""
    """Of the first role."""
    material: str = ""
    """Adjective of the material."""
    part: str = ""
    """As in "a blue roof", with the caption's article."""


def draw_prompts(count: int, kinds: Sequence[Kind] = KINDS) -> list[Asked]:
    """Return `count` different prompts, or one a kind where there are more kinds; none is twice as frequent.

    The n-th prompt of a kind depends on its words alone: other kinds come and go without changing it.
    """
    streams = {kind.words[0]: different(kind) for kind in kinds}
    order = [kinds[i].words[0] for i in np.random.default_rng(DRAW).permutation(len(kinds))]
    total = max(count, len(order))
    return [next(streams[order[i % len(order)]]) for i in range(total)]


def different(kind: Kind) -> Iterator[Asked]:
    """Give prompts of a kind without end, none twice."""
    rng = np.random.default_rng([DRAW, zlib.crc32(kind.words[0].encode())])
    given = set()
    while True:
        asked = draw_asked(rng, kind)
        if asked.prompt not in given:
            given.add(asked.prompt)
            yield asked


def draw_asked(rng: np.random.Generator, kind: Kind) -> Asked:
    """Draw how the kind shall look."""
    what, colour = rng.random(), COLOURS[rng.integers(len(COLOURS))]
    if what < AS_IT_IS:
        return ask(kind)
    if what < AS_IT_IS + COLOURED or (what < AS_IT_IS + COLOURED + WITH_PART and not kind.said):
        return ask(kind, colour)
    if what < AS_IT_IS + COLOURED + WITH_PART:
        words = list(kind.said.values())[rng.integers(len(kind.said))]
        other = str(rng.choice([name for name in COLOURS if name != colour]))
        return ask(kind, colour, part=words.format(other))
    material = list(MATERIALS)[rng.integers(len(MATERIALS))]
    has_own = MATERIALS[material].colour is not None
    return ask(kind, "" if has_own else colour, material, made_of=bool(rng.random() < MADE_OF))


def ask(kind: Kind, colour: str = "", material: str = "", part: str = "", made_of: bool = False) -> Asked:
    """Put a prompt into words; `made_of`: "a house made of lego", where the material has such a word."""
    word, noun = kind.words[0], MATERIALS[material].noun if material and made_of else ""
    text = " ".join(filter(None, (colour, "" if noun else material, word)))
    text += f" made of {noun}" if noun else ""
    text += f" with {part}" if part else ""
    text = re.sub(r"\ba (?=[aeiou])", "an ", text if word in PLURAL else f"a {text}")
    return Asked(text, word, colour, material, part)
