"""Occupied cells: nothing dense is ever dropped, and what is empty is."""

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.nerf import occupancy

STEP = 0.05


def blobs(rng: np.random.Generator) -> Callable[[np.ndarray], np.ndarray]:
    """Return a random sum of Gaussians, densities up to some hundred."""
    centres = rng.uniform(-0.8, 0.8, (6, 3))
    widths = rng.uniform(0.03, 0.2, 6)
    heights = np.exp(rng.uniform(0, 6, 6))

    def density(points: np.ndarray) -> np.ndarray:
        squared = ((points[:, None] - centres) ** 2).sum(-1)
        return (heights * np.exp(-squared / (2 * widths**2))).sum(-1).astype(np.float32)

    return density


def cell_of(points: np.ndarray, cells: int) -> tuple[np.ndarray, ...]:
    return tuple(np.minimum(((points + 1) / 2 * cells).astype(int), cells - 1).T)


@pytest.mark.parametrize("updates", [1, 2, 3, 6, 16, 40])
def test_it_is_due_by_updates_of_the_field(updates: int) -> None:
    due = [step for step in range(200) if occupancy.due(step, updates)]
    assert due[0] == 0
    since = np.diff(due) * updates
    assert since.mean() == pytest.approx(max(occupancy.REFRESH_EVERY, updates), rel=0.05)
    assert (since < occupancy.REFRESH_EVERY + updates).all()


@pytest.mark.parametrize("seed", range(4))
def test_dense_places_are_never_dropped(seed: int) -> None:
    rng = np.random.default_rng(seed)
    density = blobs(rng)
    grid = occupancy.everywhere(32)
    points = rng.uniform(-1, 1, (100_000, 3)).astype(np.float32)
    opacity = -np.expm1(-density(points) * STEP)
    for _ in range(12):
        grid = occupancy.refresh(grid, density, STEP, rng)
        assert grid.occupied[cell_of(points, 32)][opacity > 0.02].all()
    assert grid.occupied.mean() < 0.5
    settled = occupancy.settle(grid.occupied, density, STEP, rng)
    assert settled.occupied[cell_of(points, 32)][opacity > 0.02].all()
    # What was never rendered does not appear in the end.
    half = grid.occupied.copy()
    half[16:] = False
    assert not occupancy.settle(half, density, STEP, rng).occupied[18:].any()


def test_emptied_places_are_forgotten_but_not_at_once() -> None:
    rng = np.random.default_rng(0)
    grid = occupancy.refresh(occupancy.everywhere(16), blobs(rng), STEP, rng)
    before = grid.occupied.mean()
    assert before > 0.05

    def nothing_but_a_corner(points: np.ndarray) -> np.ndarray:
        return np.where((points > 0.8).all(axis=1), 50, 0).astype(np.float32)

    grid = occupancy.refresh(grid, nothing_but_a_corner, STEP, rng)
    assert grid.occupied.mean() > 0.5 * before
    for _ in range(40):
        grid = occupancy.refresh(grid, nothing_but_a_corner, STEP, rng)
    assert grid.occupied[-1, -1, -1]
    assert grid.occupied.mean() < 0.02


def test_a_nearly_empty_scene_keeps_its_densest_cells() -> None:
    """Were they dropped, no sample would be taken anywhere and nothing could ever grow back."""
    rng = np.random.default_rng(0)
    faint = blobs(rng)
    grid = occupancy.everywhere(16)
    for _ in range(5):
        grid = occupancy.refresh(grid, lambda x: faint(x) * np.float32(1e-9), STEP, rng)
    assert grid.occupied.any()
    assert grid.occupied.mean() < 0.6
    uniform = occupancy.refresh(occupancy.everywhere(8), lambda x: np.zeros(len(x), np.float32), STEP, rng)
    assert uniform.occupied.all()


def test_margin_is_one_cell_in_every_direction() -> None:
    def point(points: np.ndarray) -> np.ndarray:
        return np.where((np.abs(points - 1 / 16) < 1 / 16).all(axis=1), 100, 0).astype(np.float32)

    grid = occupancy.refresh(occupancy.everywhere(16), point, STEP, np.random.default_rng(0))
    expected = np.zeros((16, 16, 16), np.bool_)
    expected[7:10, 7:10, 7:10] = True
    np.testing.assert_array_equal(grid.occupied, expected)
