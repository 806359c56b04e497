"""Answers against the key. Pure functions: texts in, figures and faults out."""

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from benchmarks._tables import markdown
from benchmarks.blind.sheets import HEADER, PLAIN, Entry
from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.materials import MATERIALS

ACCEPTED: dict[str, tuple[str, ...]] = {
    "sofa": ("settee", "loveseat"),
    "desk": ("table",),
    "cabinet": ("cupboard", "closet", "chest of drawers", "sideboard"),
    "bookcase": ("shelf", "shelves"),
    "grand piano": ("piano",),
    "barrel": ("cask", "keg"),
    "sports car": ("car",),
    "race car": ("car",),
    "fire truck": ("truck",),
    "motorbike": ("bike", "moped", "scooter"),
    "airplane": ("aeroplane", "aircraft", "jet"),
    "rowboat": ("boat", "canoe"),
    "sailing ship": ("boat", "sailing boat"),
    "boat": ("ship",),
    "rocket": ("space ship",),
    "German Shepherd": ("dog",),
    "deer": ("reindeer", "elk", "moose"),
    "pig": ("hog", "boar"),
    "cow": ("bull", "ox"),
    "sheep": ("ram",),
    "rabbit": ("hare",),
    "piranha": ("fish",),
    "frog": ("toad",),
    "garden gnome": ("dwarf",),
    "lego man": ("lego person", "lego minifigure"),
    "robot": ("android",),
    "robot hand": ("hand",),
    "person": ("human",),
    "woman": ("lady",),
    "house": ("home", "hut", "cabin"),
    "gothic house": ("house", "cathedral", "chapel"),
    "sandcastle": ("castle",),
    "dog house": ("doghouse",),
    "palm tree": ("tree",),
    "pine tree": ("tree", "pine", "conifer", "spruce"),
    "plant": ("houseplant",),
    "street lamp": ("lamp", "street light", "streetlight", "lamppost", "lantern"),
    "mailbox": ("letterbox", "postbox", "post box"),
    "hamburger": ("cheeseburger",),
    "jack-o-lantern": ("pumpkin",),
    "vase with flowers": ("vase", "flowers", "bouquet"),
    "basket with fruits": ("fruit", "basket"),
    "violin": ("fiddle",),
    "backpack": ("rucksack",),
    "shoe": ("trainer",),
    "football": ("ball",),
    "umbrella": ("parasol",),
}
"""Free words that are right beside a kind's own: other words for it, and what people call it first."""


class Answer(NamedTuple):
    """One line of a namer."""

    name: str
    kind: str
    colour: str
    material: str
    """`PLAIN` or an adjective of `MATERIALS`."""
    rating: int
    """1 to 5."""


class Mark(NamedTuple):
    """What an answer got right."""

    listed: bool
    """The kind out of the list."""
    free: bool
    """The name in free words."""
    colour: bool | None
    material: bool | None
    """None where the prompt asked for none."""
    rating: int


def read_answers(text: str, file: str, numbers: Iterable[int]) -> tuple[dict[int, Answer], list[str]]:
    """Return the answers by number, and every fault of the text in a line that begins with file and line."""
    answers: dict[int, Answer] = {}
    faults, lines = [], csv.reader(text.removeprefix("\ufeff").splitlines())
    wanted = sorted(numbers)
    for cells in lines:
        cells = [cell.strip() for cell in cells]
        if not any(cells) or ",".join(cells).lower() == HEADER:
            continue
        found = read_line(cells)
        number = int(cells[0]) if cells[0].isdecimal() else 0
        if isinstance(found, Answer) and number not in wanted:
            found = f"number {cells[0]!r} is on no sheet, expected 1 to {wanted[-1]}"
        elif number in answers:
            found = f"number {number} has a line already"
        if isinstance(found, Answer):
            answers[number] = found
        else:
            faults.append(f"{file}:{lines.line_num}: {found}")
    missing = [] if faults else [str(number) for number in wanted if number not in answers]
    if missing:
        faults.append(f"{file}:{lines.line_num + 1}: no line for {', '.join(missing)}")
    return answers, faults


def read_line(cells: Sequence[str]) -> Answer | str:
    """Return what the six cells of a line say, or what is wrong with them; letters' case does not matter."""
    if len(cells) != len(HEADER.split(",")):
        return f"{len(cells)} columns, expected {HEADER}"
    _, name, kind, colour, material, rating = cells
    by_lower = {word.lower(): word for word in BY_WORD}
    if not name:
        return "name is empty, expected words of your own"
    if kind.lower() not in by_lower:
        return f"kind {kind!r} is none of the list in kinds.txt"
    if colour.lower() not in COLOURS:
        return f"colour {colour!r} is none of {', '.join(COLOURS)}"
    if material.lower() not in (PLAIN, *MATERIALS):
        return f"material {material!r} is none of {', '.join((PLAIN, *MATERIALS))}"
    if rating not in ("1", "2", "3", "4", "5"):
        return f"rating {rating!r} is no whole number from 1 to 5"
    return Answer(name, by_lower[kind.lower()], colour.lower(), material.lower(), int(rating))


def plain_words(text: str) -> list[str]:
    """Return the words of a text in lower case, without a plural's s: "Two T-Rexes" is two, t, rexe."""
    found = re.findall(r"[^\W\d_]+", text.lower())
    return [w[:-1] if len(w) > 3 and w.endswith("s") and not w.endswith("ss") else w for w in found]


def names_kind(name: str, kind: str) -> bool:
    """Whether free words name a kind: they are, or hold as whole words, one of its words or of `ACCEPTED`."""
    said = f" {' '.join(plain_words(name))} "
    words = (*BY_WORD[kind].words, *ACCEPTED.get(kind, ()))
    return any(f" {' '.join(plain_words(word))} " in said for word in words)


def mark(entry: Entry, answer: Answer) -> Mark:
    """Compare an answer with what its number stands for."""
    return Mark(
        listed=answer.kind == entry.kind,
        free=names_kind(answer.name, entry.kind),
        colour=answer.colour == entry.colour if entry.colour else None,
        material=answer.material == entry.material if entry.material else None,
        rating=answer.rating,
    )


def figures(marks: Sequence[Mark]) -> dict[str, float | int | None]:
    """Return shares in [0, 1] and the mean rating; None where nothing was asked."""
    ratings = [m.rating for m in marks]
    return {
        "answers": len(marks),
        "kind_listed": mean([m.listed for m in marks]),
        "kind_free": mean([m.free for m in marks]),
        "colour": mean([m.colour for m in marks if m.colour is not None]),
        "material": mean([m.material for m in marks if m.material is not None]),
        "rating": mean(ratings),
        "rated_3_or_more": mean([r >= 3 for r in ratings]),
    }


def mean(values: Sequence[float]) -> float | None:
    """Return the mean with four digits behind the point, None of nothing."""
    return round(sum(values) / len(values), 4) if values else None


def score(
    key: Mapping[int, Entry], namers: Mapping[str, Mapping[int, Answer]]
) -> dict[str, dict[str, dict[str, float | int | None]]]:
    """Return the figures of all answers together ("all"), of every namer, and of every kind of the key.

    All namers have answered all numbers, so that means over answers are means over namers.
    """
    marks = {
        namer: {number: mark(key[number], answer) for number, answer in answers.items()}
        for namer, answers in namers.items()
    }
    kinds = sorted({entry.kind for entry in key.values()}, key=str.lower)
    return {
        "summary": {"all": figures([m for one in marks.values() for m in one.values()])},
        "namers": {namer: figures(list(one.values())) for namer, one in marks.items()},
        "kinds": {
            kind: figures([m for one in marks.values() for n, m in one.items() if key[n].kind == kind])
            for kind in kinds
        },
    }


def score_table(scores: Mapping[str, Mapping[str, Mapping[str, float | int | None]]]) -> str:
    """Return all figures as one Markdown table: everything, then the namers, then the kinds."""
    rows = [(name, row) for part in ("summary", "namers", "kinds") for name, row in scores[part].items()]
    heads = list(rows[0][1])
    lines = [(name, *("" if row[head] is None else row[head] for head in heads)) for name, row in rows]
    return markdown(("", *heads), lines)
