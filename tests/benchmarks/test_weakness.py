"""How a model errs: fitted where it is known."""

import numpy as np

from benchmarks._weakness import LEVELS, MEASURED, blurred, fit, weaken, weakness_at


def test_a_known_weakness_is_found() -> None:
    rng = np.random.default_rng(0)
    clean = rng.uniform(-1, 1, (6, 4, 32, 32))
    found = fit(clean, 0.9 * blurred(clean, 0.7) + 0.15 * rng.standard_normal(clean.shape))
    np.testing.assert_allclose(found, (0.7, 0.9, 0.15), atol=0.01)
    np.testing.assert_allclose(fit(clean, clean), (0, 1, 0), atol=1e-9)


def test_it_is_linear_between_the_levels_measured() -> None:
    assert weakness_at(LEVELS[1]) == MEASURED[LEVELS[1]]
    middle = weakness_at((LEVELS[0] + LEVELS[1]) // 2)
    np.testing.assert_allclose(middle, np.mean([MEASURED[LEVELS[0]], MEASURED[LEVELS[1]]], axis=0))
    assert weakness_at(999) == MEASURED[LEVELS[-1]]


def test_weakened_pictures_err_as_fitted() -> None:
    rng = np.random.default_rng(0)
    clean = rng.uniform(-1, 1, (8, 4, 32, 32))
    found = fit(clean, weaken(clean, np.full(8, 500), rng))
    np.testing.assert_allclose(found, MEASURED[500], atol=0.01)
