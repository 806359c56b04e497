"""What a namer gets: numbered sheets and questions, and the key that tells the numbers' prompts."""

import json
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from benchmarks._results import VIEWS, tiled
from benchmarks.blind.prompts import DRAW, Asked
from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.kinds import KINDS
from export.everyday_objects.data.materials import MATERIALS

TILE = 224
"""Side of a view [pixels]."""
A_SHEET, COLUMNS = 5, 1
"""Results of a sheet, in so many columns: viewers that show 1,500 pixels at most need not shrink it."""
HEADING, GAP = 26, 16
"""Above each result, for its number, and beside it [pixels]."""
PLAIN = "plain"
"""What an answer says of a thing without a material."""
HEADER = "number,name,kind,colour,material,rating"


class Entry(NamedTuple):
    """What a number of the sheets stands for; the first five as in `Asked`."""

    prompt: str
    kind: str
    colour: str
    material: str
    part: str
    seed: int
    job: str
    """The hash at the end of the run's name."""
    fault: str
    """Why there was nothing to show; empty: there was."""


def numbered(prompts: Sequence[Asked], seeds: int) -> list[tuple[Asked, int]]:
    """Return every prompt with each of the seeds 0 to `seeds` - 1, in an order that tells nothing."""
    pairs = [(asked, seed) for asked in prompts for seed in range(seeds)]
    return [pairs[i] for i in np.random.default_rng([DRAW, 1]).permutation(len(pairs))]


def draw_sheet(
    first: int, results: Sequence[UInt8[np.ndarray, "6 p p 3"]], columns: int = COLUMNS
) -> Image.Image:
    """Return the results' views, a strip each, under the numbers `first`, `first` + 1, ..., no more."""
    size = results[0].shape[1]
    width, height = len(VIEWS) * size + GAP, size + HEADING
    rows = -(-len(results) // columns)
    page = Image.new("RGB", (columns * width, rows * height), "white")
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(20)
    for i, views in enumerate(results):
        left, top = i % columns * width, i // columns * height
        draw.text((left + 2, top), str(first + i), fill="black", font=font)
        page.paste(Image.fromarray(tiled(views, len(views))), (left, top + HEADING))
    return page


def draw_sheets(results: Sequence[UInt8[np.ndarray, "6 p p 3"]]) -> dict[str, Image.Image]:
    """Return the sheets of all results, numbered from 1, by the names of their files."""
    starts = range(0, len(results), A_SHEET)
    return {
        f"sheet-{start // A_SHEET + 1:02d}.png": draw_sheet(start + 1, results[start : start + A_SHEET])
        for start in starts
    }


def key_text(entries: Sequence[Entry]) -> str:
    """Return key.json: entries by their numbers, from 1."""
    return json.dumps({i: entry._asdict() for i, entry in enumerate(entries, 1)}, indent=1) + "\n"


def read_key(text: str) -> dict[int, Entry]:
    """Return what `key_text` wrote."""
    return {int(number): Entry(**entry) for number, entry in json.loads(text).items()}


def questions(count: int) -> str:
    """Return what a namer of the results 1 to `count` is asked; it tells nothing about any of them."""
    sheets = -(-count // A_SHEET)
    return f"""# What do you see?

`sheet-01.png` to `sheet-{sheets:02d}.png` show {count} things, {A_SHEET} a sheet, each under its number: six
views of the same thing, from left to right {", ".join(VIEWS)}. Look at nothing
but these sheets, and at `kinds.txt` not before you have named the things. Each thing was made from a text by
a program; some came out badly, and a kind may come more than once. An empty strip is a thing of which nothing
came out.

Write `answers.csv`, with this line first and then one line for every number from 1 to {count}:

    {HEADER}

| column | what to write |
|---|---|
| number | the number above the thing |
| name | what it is, in your own words; `nothing` if you cannot tell |
| kind | which of the kinds in `kinds.txt` it is; your best guess if you cannot tell |
| colour | its main colour, one of: {", ".join(COLOURS)} |
| material | `{PLAIN}`, or what it is made of or covered with, one of: {", ".join(MATERIALS)} |
| rating | 1 scrap, 2 poor, 3 usable at a distance, 4 good, 5 a good asset for a game: a whole number |

What holds a comma stands in double quotes. An example: `0,a small wooden chair,chair,brown,wooden,3`
"""


def kinds_text() -> str:
    """Return kinds.txt: the list that a kind is chosen from, a line each. A file of its own, so that who
    reads the questions has not seen it when naming freely."""
    return "".join(f"{word}\n" for word in sorted((kind.words[0] for kind in KINDS), key=str.lower))
