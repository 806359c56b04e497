"""What a kind of object is to the training data: its words, its maker, and which parts have colours of their
own.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from export.everyday_objects.data.shapes import Part

DESIGNS = 4
"""Shapes of a kind that are trained on, the first of them most (`pictures.FIRST_DESIGN`). Of twelve, equally
often, the model knew the mean: its loss was the same on shapes that it had never seen, and faces and windows
were blurs. Telling the design in captions ("style 2") changed nothing in 800 steps."""


class Kind(NamedTuple):
    """One kind of object."""

    words: tuple[str, ...]
    """What a prompt may call it, the main word first."""
    make: Callable[[np.random.Generator], Sequence[Part]]
    """A variant of its shape from a seed."""
    roles: dict[str, tuple[str, ...]]
    """Names of natural colours by role; the first role is what "a red ..." makes red, and what takes
    materials.
    """
    said: Mapping[str, str] = MappingProxyType({})
    """How a caption names a role's own colour: {"roof": "a {} roof", "wheels": "{} wheels"}."""
    variants: int = DESIGNS
    """Seeds 0 to variants - 1 are trained on."""
    weight: float = 1.0
    """Of the kind in the training mixture: more for many shapes and for what people ask for first."""
    front: bool = True
    """Whether its front differs from its back."""
