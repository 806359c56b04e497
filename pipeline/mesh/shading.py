"""The light of a model's training pictures, taken out of the texture that the model painted.

Light there is shade = 1 + directional * max(n . towards, 0) + sky * (1 + n_y) / 2, in multiples of the
ambient one, times sRGB colours. A model whose pictures all had one light paints it onto what it makes; lit
once more by a viewer, the object is lit twice. Letters: n texels, s x s texels of the texture.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pipeline.mesh.mesh import Mesh
from pipeline.mesh.texture import paint, surface_texels

STRENGTHS = np.linspace(0, 0.6, 7)
"""That are tried for each of the two lights: up to what the bundled model's pictures had, 0.58 and 0.44. A
blue bus with a dark underside would get 0.9 and 0.9, and its top clipped."""
BINS = 12
"""Of red's and of green's share of a colour."""
SAMPLES = 20_000
"""Texels that are looked at."""
DARK, BRIGHT = 0.04, 0.98
"""Greatest channels beyond which a colour is black or clipped, and tells nothing."""
EXPLAINED = 0.1
"""Share of the deviation that a light has to explain; else nothing is divided out."""


class Light(NamedTuple):
    """The light on an object, as its colours and normals tell it."""

    directional: float
    sky: float
    """In multiples of the ambient light."""
    explained: float
    """Share of the brightness's absolute deviation that goes with it, in [0, 1]."""


def shade(
    normals: Float[np.ndarray, "n 3"], towards: Float[np.ndarray, " 3"], light: Light
) -> Float[np.ndarray, " n"]:
    """Return the light on a surface, in multiples of the ambient one; `towards` is a unit vector."""
    lambert = np.maximum(normals @ towards, 0)
    return 1 + light.directional * lambert + light.sky * (0.5 + 0.5 * normals[:, 1])


def brightest(towards: Float[np.ndarray, " 3"], light: Light) -> float:
    """Return the most light that any direction gets."""
    both = light.directional * np.asarray(towards) + light.sky * np.array([0, 0.5, 0])
    return float(1 + 0.5 * light.sky + np.linalg.norm(both))


def fit_light(
    colours: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], towards: Float[np.ndarray, " 3"]
) -> Light:
    """Return the light that explains most of the brightness of sRGB colours in [0, 1].

    Each bin of chromaticity has a brightness of its own (the median), and absolute deviations of logarithms
    are summed, so that neither paints nor patterns are taken for light.
    """
    most = colours.max(axis=1, initial=0.0)
    clear = (most > DARK) & (most < BRIGHT)
    if not clear.any():
        return Light(0.0, 0.0, 0.0)
    colours, normals = colours[clear].astype(np.float64), normals[clear].astype(np.float64)
    total = colours.sum(axis=1)
    bins = np.minimum((colours[:, :2] / total[:, None] * BINS).astype(np.int64), BINS - 1) @ [BINS, 1]
    order = np.argsort(bins, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(bins[order])) + 1)
    brightness = np.log(total)
    tried = [Light(d, s, 0.0) for d in STRENGTHS.tolist() for s in STRENGTHS.tolist()]
    costs = [_deviation(brightness - np.log(shade(normals, towards, one)), groups) for one in tried]
    best = int(np.argmin(costs))
    if costs[0] < 1e-6 * len(colours):  # one colour, evenly lit
        return tried[0]
    return tried[best]._replace(explained=1 - costs[best] / costs[0])


def _deviation(values: Float[np.ndarray, " n"], groups: list[np.ndarray]) -> float:
    """Return the sum over the groups, rows each, of the distances from the median [the values' unit]."""
    return sum(float(np.abs(values[rows] - np.median(values[rows])).sum()) for rows in groups)


def without_light(
    mesh: Mesh, texture: Float[np.ndarray, "s s 3"], towards: Float[np.ndarray, " 3"], padding: int
) -> tuple[Float[np.ndarray, "s s 3"], Light]:
    """Return an unwrapped mesh's texture (sRGB in [0, 1]) with the light divided out, and the light.

    Where the light was strongest colours stay as they are; elsewhere they get brighter. Where it explains too
    little, the texture is returned as it is.
    """
    texels = surface_texels(mesh, len(texture))
    found = texture.reshape(-1, 3)[texels.place]
    step = max(1, len(found) // SAMPLES)
    light = fit_light(found[::step], texels.normal[::step], towards)
    if light.explained < EXPLAINED:
        return texture, light
    gain = brightest(towards, light) / shade(texels.normal, towards, light)
    gains = paint(np.repeat(gain[:, None], 3, axis=1).astype(np.float32), texels, padding)
    return np.clip(texture * gains, 0, 1), light
