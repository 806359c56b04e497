"""How an object looks: which colours and materials its parts have, and how a caption says so."""

from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from export.everyday_objects.data.colours import COLOURS, draw_colour
from export.everyday_objects.data.kind import Kind
from export.everyday_objects.data.materials import MATERIALS, Material
from export.everyday_objects.data.render import Looks
from export.everyday_objects.data.shapes import Shape

FIRST_COLOUR = 0.9
"""Share of parts whose colour nothing says that have the first of their natural ones. Where all were equally
likely, the model's samples were confetti there, and what score distillation made of it was grey."""


class Look(NamedTuple):
    """What is said of an object's colours; what is not said is natural."""

    colour: str = ""
    """Of the first role; "" where the natural colour or the material's own is meant."""
    second: str = ""
    """Of the second role, said as "red and white"."""
    parts: Mapping[str, str] = MappingProxyType({})
    """Colours of further roles by name."""
    material: Material | None = None
    """Of the first role."""


def draw_look(rng: np.random.Generator, kind: Kind, roles: Collection[str]) -> Look:
    """Draw a look of a shape that has these roles: a colour word mostly, now and then natural, two colours, a
    part of its own colour, a material."""

    def colour() -> str:
        return COLOURS[rng.integers(len(COLOURS))]

    what = rng.random()
    said, others = [r for r in kind.said if r in roles], [r for r in kind.roles if r in roles][1:]
    if what < 0.15:
        return Look()
    if what < 0.55:
        return Look(colour())
    if what < 0.7 and others[:1] == list(kind.roles)[1:2] != []:
        first = colour()
        return Look(first, str(rng.choice([c for c in COLOURS if c != first])))
    if what < 0.82 and said:
        part = said[rng.integers(len(said))]
        return Look("" if rng.random() < 0.3 else colour(), parts={part: colour()})
    material = list(MATERIALS.values())[rng.integers(len(MATERIALS))]
    if material.colour is not None:
        return Look(material=material)
    first = colour()
    second = str(rng.choice([c for c in COLOURS if c != first])) if rng.random() < 0.4 else ""
    return Look(first, second, material=material)


def dress(rng: np.random.Generator, kind: Kind, shape: Shape, look: Look) -> Looks:
    """Return the colours of a shape's paints."""
    first, *others = kind.roles
    names = {
        role: choices[0 if rng.random() < FIRST_COLOUR else rng.integers(len(choices))]
        for role, choices in kind.roles.items()
    }
    names[first] = look.colour or names[first]
    patterned = look.material is not None and look.material.colour is None
    if look.second and others and not patterned:
        names[others[0]] = look.second
    names.update(look.parts)
    chosen = {role: draw_colour(rng, name) for role, name in names.items()}
    second = np.zeros(3, np.float32)
    if look.material is not None:
        if look.material.colour is not None:
            chosen[first] = np.array(look.material.colour, np.float32)
        second = np.array(look.material.other, np.float32)
        if patterned and look.second:
            second = draw_colour(rng, look.second)
        elif patterned and names[first] in ("white", "beige"):
            second = draw_colour(rng, "black")
    colours, seconds = np.zeros((2, len(shape.paints), 3), np.float32)
    codes = np.zeros(len(shape.paints), np.int32)
    for i, paint in enumerate(shape.paints):
        if not paint.role:
            colours[i] = paint.rgb
            continue
        colours[i] = np.clip(chosen[paint.role] * paint.shade, 0, 1)
        if paint.role == first and look.material is not None:
            codes[i] = look.material.code
            seconds[i] = np.clip(second * paint.shade, 0, 1)
    return Looks(colours, seconds, codes)


def say(rng: np.random.Generator, kind: Kind, look: Look) -> str:
    """Return words for an object: "a red and white striped sofa", "a house made of lego", "a car with black
    wheels".
    """
    word = kind.words[0] if rng.random() < 0.75 else kind.words[rng.integers(len(kind.words))]
    before, after = [], ""
    if look.colour:
        before.append(f"{look.colour} and {look.second}" if look.second else look.colour)
    if look.material is not None:
        if look.material.noun and rng.random() < 0.4:
            after = f" made of {look.material.noun}"
        else:
            before.append(look.material.adjective)
    for part, colour in look.parts.items():
        after += f" with {kind.said[part].format(colour)}"
    text = " ".join([*before, word]) + after
    if rng.random() < 0.85:
        text = f"{'an' if text[0] in 'aeiou' else 'a'} {text}"
    return text
