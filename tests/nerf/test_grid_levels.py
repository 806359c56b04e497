"""The hash grid's kernels against a slow float64 reference written from the paper."""

import itertools

import numpy as np
import pytest

from pipeline.kernels import hashgrid as kernels
from pipeline.kernels import parallel
from pipeline.nerf.grid_levels import HashGrid, hash_grid

PRIMES = (1, 2654435761, 805459861)


def reference_encode(grid: HashGrid, table: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Interpolate in float64, a corner at a time."""
    features = np.zeros((len(points), 2 * len(grid.resolutions)))
    for level, resolution in enumerate(grid.resolutions.tolist()):
        entries = table[grid.offsets[level] : grid.offsets[level + 1]].astype(np.float64)
        scaled = np.clip((points.astype(np.float64) + 1) / 2, 0, 1) * resolution
        cell = np.minimum(scaled.astype(np.int64), resolution - 1)
        inside = scaled - cell
        for corner in itertools.product((0, 1), repeat=3):
            x, y, z = (cell + corner).T
            if (resolution + 1) ** 3 <= len(entries):
                index = x + (resolution + 1) * (y + (resolution + 1) * z)
            else:
                hashed = [(c * p) % 2**32 for c, p in zip((x, y, z), PRIMES, strict=True)]
                index = (hashed[0] ^ hashed[1] ^ hashed[2]) % len(entries)
            weight = np.prod(np.where(corner, inside, 1 - inside), axis=1)
            features[:, 2 * level : 2 * level + 2] += weight[:, None] * entries[index]
    return features


def encode(grid: HashGrid, table: np.ndarray, points: np.ndarray) -> np.ndarray:
    features = np.empty((len(points), grid.width), np.float32)
    parallel.run(kernels.encode, len(points), points, table, *grid, features, block=64)
    return features


def gradient(grid: HashGrid, points: np.ndarray, by_features: np.ndarray) -> np.ndarray:
    result = np.zeros((grid.entries, 2), np.float32)
    parallel.run(kernels.encode_backward, len(grid.resolutions), points, by_features, *grid, result)
    return result


@pytest.fixture
def setting() -> tuple[HashGrid, np.ndarray, np.ndarray, np.random.Generator]:
    rng = np.random.default_rng(0)
    grid = hash_grid(levels=8, coarsest=4, finest=128, table_log2=12)
    table = rng.standard_normal((grid.entries, 2)).astype(np.float32)
    points = rng.uniform(-1, 1, (1000, 3)).astype(np.float32)
    points[:4] = np.array([[-1, -1, -1], [1, 1, 1], [0, 0, 0], [1, -1, 0.5]])
    return grid, table, points, rng


def test_layout_grows_geometrically_and_bounds_tables() -> None:
    grid = hash_grid(levels=16, coarsest=16, finest=512, table_log2=16)
    assert grid.resolutions[0] == 16
    assert grid.resolutions[-1] == 512
    ratios = grid.resolutions[1:] / grid.resolutions[:-1]
    np.testing.assert_allclose(ratios, 32 ** (1 / 15), rtol=0.07)
    entries = np.diff(grid.offsets)
    assert entries.max() == 2**16
    assert entries[0] == 17**3


def test_forward_matches_reference(setting) -> None:
    grid, table, points, _ = setting
    dense = (grid.resolutions + 1) ** 3 <= np.diff(grid.offsets)
    assert dense.any()
    assert not dense.all()
    np.testing.assert_allclose(encode(grid, table, points), reference_encode(grid, table, points), atol=1e-4)


def test_gradient_is_the_adjoint_of_encoding(setting) -> None:
    """Encoding is linear in the table: <encode(table), g> = <table, gradient(g)> for all tables and g."""
    grid, table, points, rng = setting
    for _ in range(5):
        g = rng.standard_normal((len(points), grid.width)).astype(np.float32)
        direction = rng.standard_normal(table.shape).astype(np.float32)
        left = np.vdot(reference_encode(grid, direction, points), g.astype(np.float64))
        right = np.vdot(direction.astype(np.float64), gradient(grid, points, g).astype(np.float64))
        assert left == pytest.approx(right, rel=1e-5, abs=1e-3)


def test_gradient_matches_finite_differences(setting) -> None:
    grid, table, points, rng = setting
    g = rng.standard_normal((len(points), grid.width)).astype(np.float32)
    exact = gradient(grid, points, g)
    touched = rng.permutation(np.argwhere(exact))[:20]
    for entry, feature in touched:
        bumped = table.astype(np.float64)
        bumped[entry, feature] += 1e-3
        change = np.vdot(reference_encode(grid, bumped, points) - reference_encode(grid, table, points), g)
        assert change / 1e-3 == pytest.approx(exact[entry, feature], rel=1e-4, abs=1e-5)


def test_gradient_accumulates_and_skips_rows_without_any(setting) -> None:
    grid, _, points, rng = setting
    g = rng.standard_normal((len(points), grid.width)).astype(np.float32)
    g[500:] = 0
    total = gradient(grid, points[:500], g[:500])
    np.testing.assert_array_equal(gradient(grid, points, g), total)
    parallel.run(kernels.encode_backward, len(grid.resolutions), points, g, *grid, total)
    np.testing.assert_allclose(total, 2 * gradient(grid, points, g), rtol=1e-5, atol=1e-6)


def test_threads_do_not_change_a_bit(setting, monkeypatch: pytest.MonkeyPatch) -> None:
    grid, table, points, rng = setting
    g = rng.standard_normal((len(points), grid.width)).astype(np.float32)
    results = []
    for count in (1, 2, 5):
        monkeypatch.setattr(parallel, "threads", lambda count=count: count)
        results.append((encode(grid, table, points), gradient(grid, points, g)))
    for features, by_table in results[1:]:
        np.testing.assert_array_equal(features, results[0][0])
        np.testing.assert_array_equal(by_table, results[0][1])


def test_points_outside_and_nan_stay_inside_the_table(setting) -> None:
    grid, table, _, _ = setting
    wild = np.array([[5, 0, 0], [-1e30, 0, 0], [np.inf, 0, 0], [np.nan, 0, 0]], np.float32)
    tame = np.array([[1, 0, 0], [-1, 0, 0], [1, 0, 0], [-1, 0, 0]], np.float32)
    np.testing.assert_array_equal(encode(grid, table, wild), encode(grid, table, tame))
