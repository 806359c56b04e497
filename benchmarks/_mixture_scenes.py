"""The scenes that ideal denoisers believe in: variants of kinds of the default model's data, in flat light.

A kind with a front is also believed in four quarter turns of itself: a text that names the side which is seen
leaves half a doubt that it is the front, as models do that have mostly seen fronts (`sides`).

Letters: b views, h x w pixels, f paints.
"""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from benchmarks._truths import Truth, analytic_scenes, catalogue_scenes
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.looks import Look, dress
from export.everyday_objects.data.shapes import assemble
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.rasterize import Fragments

BELIEVED = 4
KINDS = ("sofa", "horse")
"""Told; without a text any of them and of `OTHERS` may be it."""
OTHERS = ("airplane", "house")
QUARTERS = 4
FRONT_BIAS = 0.5
"""How likely a text that names another side than the front still is a front."""


class Scenes(NamedTuple):
    """What may be meant."""

    told: list[Truth]
    """With the text."""
    others: list[Truth]
    """Besides, without one."""
    turned: bool = False
    """Whether those of the text are quarter turns of one another."""


def painted(colours: Float[np.ndarray, "f 3"], seen: Fragments) -> Float[np.ndarray, "h w 3"]:
    """Return the colour of the face that every pixel sees."""
    return colours[seen.triangle]


def kind_scenes(word: str, count: int) -> list[Truth]:
    """Return variants of a kind, blue."""
    kind = BY_WORD[word]
    found = []
    for seed in range(count):
        shape = assemble(kind.make(np.random.default_rng(seed)))
        colours = dress(np.random.default_rng(0), kind, shape, Look("blue")).colours
        mesh = Mesh(shape.vertices, shape.faces)
        found.append(Truth(f"{word} {seed}", mesh, functools.partial(painted, colours[shape.paint])))
    return found


def quarter_turns(truth: Truth) -> list[Truth]:
    """Return a scene turned by 0, 90, 180 and 270 degrees, its front then at these azimuths."""
    found = []
    for quarter in range(QUARTERS):
        sin, cos = (float(np.round(f(quarter * np.pi / 2))) for f in (np.sin, np.cos))
        turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]], np.float32)
        mesh = Mesh(truth.mesh.vertices @ turn.T, truth.mesh.faces)
        found.append(Truth(f"{truth.name}, {90 * quarter} degrees", mesh, truth.colour))
    return found


def facing(azimuths: Float[np.ndarray, " b"]) -> Int[np.ndarray, " b"]:
    """Return which quarter turn shows its front to each view."""
    return np.round(azimuths / (np.pi / 2)).astype(np.int64) % QUARTERS


def sides(azimuths: Float[np.ndarray, " b"]) -> Float[np.ndarray, "b 4"]:
    """Return how likely each quarter turn is by a text that names the side which is seen of the first."""
    likely = np.zeros((len(azimuths), QUARTERS))
    likely[:, 0] = 1 - FRONT_BIAS
    likely[np.arange(len(azimuths)), facing(azimuths)] += FRONT_BIAS
    return likely


def scenes_of(oracle: str, name: str) -> Scenes:
    """Return what an oracle believes in: scene `name` alone ("exact"), its quarter turns ("faces"), or it and
    its like."""
    if oracle == "exact":
        models = catalogue_scenes([name]) if name in ("piano", "car", "horse") else []
        return Scenes([truth for truth in (*analytic_scenes(), *models) if truth.name == name], [])
    others = [scene for word in (*KINDS, *OTHERS) if word != name for scene in kind_scenes(word, 2)]
    if oracle == "faces":
        return Scenes(quarter_turns(kind_scenes(name, 1)[0]), others, turned=True)
    return Scenes(kind_scenes(name, BELIEVED), others)
