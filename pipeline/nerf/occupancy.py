"""Which cells of the box may hold something: rendering skips the others.

Letters: g cells a side of the box [-1, 1]^3, indexed [x, y, z]; n points. A cell's density is the largest
of one jittered sample a refresh, older ones fading by a factor, so that a thin part which one sample missed
is remembered.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

CELLS = 64
REFRESH_EVERY = 16
"""Updates of the field between refreshes."""
_DECAY = 0.7
"""Fading a refresh. The paper's code takes .95 over 5000 steps; runs of some hundred need emptied
cells sooner, and the margin of one cell covers what a single sample can miss."""
_REVISITED = 0.25
"""Share of the empty cells looked at in a refresh."""
_NEGLIGIBLE_OPACITY = 0.01
"""A sample that hides less than this of what is behind it is not worth its evaluation."""


class Occupancy(NamedTuple):
    """A grid of remembered densities and the cells that are marched through."""

    density: Float[np.ndarray, "g g g"]
    """Largest density seen [1 / scene unit], fading."""
    occupied: Bool[np.ndarray, "g g g"]
    """Cells above the threshold and their 26 neighbours: the margin lets surfaces grow."""


def everywhere(cells: int = CELLS) -> Occupancy:
    """Return the grid that skips nothing."""
    return Occupancy(np.zeros((cells,) * 3, np.float32), np.ones((cells,) * 3, np.bool_))


def due(step: int, updates: int) -> bool:
    """Return whether the grid is refreshed before a step; `updates`: of the field in every step.

    What was emptied is known by updates, not by steps: of an ideal ball (100 calls of 4 updates) the normals
    are 5.8 degrees off when cells are looked at every 4 steps, 11.7 when every 16.
    """
    return step == 0 or step * updates // REFRESH_EVERY > (step - 1) * updates // REFRESH_EVERY


def refresh(
    occupancy: Occupancy,
    density_at: Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]],
    step: float,
    rng: np.random.Generator,
    kept: Bool[np.ndarray, "g g g"] | None = None,
) -> Occupancy:
    """Sample occupied cells and a quarter of the others, each at a random point, and decide anew.

    A cell is dropped when its density is below the mean of all cells and a sample of length `step` [scene
    units] there would hide less than 1 % (the paper's code: below the mean and 10, which at its step hides
    3 %). The mean keeps the densest cells of a nearly empty scene, so that it can recover. Cells of `kept`
    are occupied whatever their density.
    """
    chosen = occupancy.occupied | (rng.random(occupancy.occupied.shape, np.float32) < _REVISITED)
    density = occupancy.density.copy()
    density[chosen] = np.maximum(density[chosen] * np.float32(_DECAY), _sample(chosen, density_at, rng))
    decided = _decide(density, step)
    return decided if kept is None else Occupancy(density, decided.occupied | kept)


def settle(
    occupied: Bool[np.ndarray, "g g g"],
    density_at: Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]],
    step: float,
    rng: np.random.Generator,
    samples: int = 4,
) -> Occupancy:
    """Return the grid of a field that no longer changes, from `samples` points in every occupied cell. What
    lies in others was never rendered: it is no part of the scene.
    """
    density = np.zeros(occupied.shape, np.float32)
    if occupied.any():
        density[occupied] = np.max([_sample(occupied, density_at, rng) for _ in range(samples)], axis=0)
    return _decide(density, step)


def _sample(
    chosen: Bool[np.ndarray, "g g g"],
    density_at: Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]],
    rng: np.random.Generator,
) -> Float[np.ndarray, " n"]:
    """Return the density at one random point in each chosen cell, in the order of their indices."""
    corners = np.argwhere(chosen).astype(np.float32)
    points = (corners + rng.random(corners.shape, np.float32)) * np.float32(2 / len(chosen)) - 1
    return density_at(points)


def _decide(density: Float[np.ndarray, "g g g"], step: float) -> Occupancy:
    threshold = min(float(density.mean(dtype=np.float64)), -np.log1p(-_NEGLIGIBLE_OPACITY) / step)
    return Occupancy(density, _dilate(density >= threshold))


def _dilate(cells: Bool[np.ndarray, "g g g"]) -> Bool[np.ndarray, "g g g"]:
    """Add the 26 neighbours, one axis after the other."""
    for axis in range(3):
        grown = cells.copy()
        before = tuple(slice(None, -1) if a == axis else slice(None) for a in range(3))
        after = tuple(slice(1, None) if a == axis else slice(None) for a in range(3))
        grown[before] |= cells[after]
        grown[after] |= cells[before]
        cells = grown
    return cells
