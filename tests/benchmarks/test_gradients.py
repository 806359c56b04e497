"""Oracles of several scenes and the gradients taken from them: against formulas in float64, and where the
answer is known."""

import itertools

import numpy as np
import pytest

from benchmarks._gradients import (
    METHODS,
    Step,
    add_noise,
    csd,
    ddim,
    guided,
    inverted,
    ism,
    multistep,
    nfsd,
    perp_neg,
    sdi,
    sds,
    sds_within,
    weighted,
)
from benchmarks._ideal import Calls, ideal_guidance, linear_schedule
from benchmarks._mixtures import Believed, clean_mean, commitment, nearest, query_of, weakened, weights
from pipeline.cameras import sphere
from pipeline.training.batch import Batch

SCHEDULE = linear_schedule()
RNG = np.random.default_rng(0)
VIEWS, SIZE, SPREAD = 3, 5, 0.3
SHAPE = (VIEWS, 4, SIZE, SIZE)
PICTURES = RNG.uniform(-1, 1, (VIEWS, 4, *SHAPE[1:]))
TIMESTEPS = np.array([150, 500, 900])
NOISE = RNG.standard_normal(SHAPE)
LATENTS = RNG.uniform(-1, 1, SHAPE)


def query(told=(0, 1), **options):
    return query_of(Believed(PICTURES, np.array(told)), SCHEDULE, spread=SPREAD, **options)


def step_at(latents=LATENTS, scale: float = 7.5, **options) -> Step:
    return Step(latents, TIMESTEPS, NOISE, scale, **options)


def test_weights_are_the_posterior_also_where_likelihoods_underflow() -> None:
    signal, sigma = (np.asarray(f, np.float64).reshape(-1) for f in SCHEDULE.factors(TIMESTEPS))
    noisy = add_noise(SCHEDULE, PICTURES[:, 2], NOISE, TIMESTEPS)
    found = weights(noisy, PICTURES, SCHEDULE.factors(TIMESTEPS), SPREAD, together=False)
    for b in range(VIEWS):
        variance = signal[b] ** 2 * SPREAD**2 + sigma[b] ** 2
        apart = np.array([((noisy[b] - signal[b] * mu) ** 2).sum() for mu in PICTURES[b]])
        likely = np.array([np.longdouble(np.exp(np.longdouble(-a / (2 * variance)))) for a in apart])
        np.testing.assert_allclose(found[b], np.asarray(likely / likely.sum(), float), atol=1e-12)
    large = weights(100 * noisy, PICTURES, SCHEDULE.factors(TIMESTEPS), 1e-3, together=False)
    np.testing.assert_allclose(large.sum(1), 1)
    joint = weights(noisy, PICTURES, SCHEDULE.factors(TIMESTEPS), SPREAD, together=True)
    product = np.prod(found, axis=0)
    np.testing.assert_allclose(joint, np.broadcast_to(product / product.sum(), joint.shape), atol=1e-12)


def test_the_mean_is_that_of_samples() -> None:
    """One pixel, two scenes: the posterior by drawing from the prior and weighing."""
    pictures = np.array([-1.0, 0.5]).reshape(1, 2, 1, 1, 1)
    signal, sigma = SCHEDULE.factors(np.array([600]))
    noisy = np.full((1, 1, 1, 1), 0.2)
    rng = np.random.default_rng(1)
    drawn = pictures.reshape(-1)[rng.integers(2, size=400_000)] + 0.5 * rng.standard_normal(400_000)
    likely = np.exp(-((0.2 - float(signal[0, 0, 0, 0]) * drawn) ** 2) / (2 * float(sigma[0, 0, 0, 0]) ** 2))
    share = weights(noisy, pictures, (signal, sigma), 0.5, together=False)
    mean = clean_mean(noisy, pictures, (signal, sigma), share, 0.5)
    assert mean.item() == pytest.approx((likely * drawn).sum() / likely.sum(), abs=5e-3)


def test_one_scene_is_the_oracle_that_the_product_is_measured_with() -> None:
    cameras = sphere(VIEWS, 2.5, 0.7)
    flat = np.zeros((VIEWS, 4), np.float32)
    levels = (TIMESTEPS + 0.5) / 1000
    batch = Batch(cameras, np.zeros(VIEWS), np.zeros(VIEWS), flat, levels, NOISE.astype(np.float32), 1.0, 0.0)
    known = {id(camera): i for i, camera in enumerate(cameras)}
    single = ideal_guidance(lambda camera, size, background: PICTURES[known[id(camera)], 0], SPREAD, 0.0)
    expected = single(LATENTS.astype(np.float32), batch)
    told = query_of(Believed(PICTURES[:, :1], np.array([0])), SCHEDULE, spread=SPREAD)
    found = sds(told, SCHEDULE, step_at(LATENTS.astype(np.float32), 1.0))
    np.testing.assert_allclose(found, expected, atol=2e-5)


def test_views_settle_on_their_own_scenes_or_on_one() -> None:
    mixed = PICTURES[np.arange(VIEWS), [0, 1, 0]]
    assert nearest(mixed, PICTURES).tolist() == [0, 1, 0]
    assert commitment(nearest(mixed, PICTURES)) == pytest.approx(2 / 3)
    noisy = add_noise(SCHEDULE, mixed, np.zeros(SHAPE), np.full(VIEWS, 300))
    levels = np.full(VIEWS, 300)
    alone = query((0, 1))(noisy, levels, True)
    joint = query((0, 1), together=True)(noisy, levels, True)
    signal, sigma = SCHEDULE.factors(levels)
    clean = [(noisy - sigma * epsilon) / signal for epsilon in (alone, joint)]
    assert nearest(clean[0], PICTURES).tolist() == [0, 1, 0]
    assert commitment(nearest(clean[1], PICTURES)) == 1


def test_few_steps_answer_with_one_scene_and_calls_are_counted() -> None:
    calls = Calls()
    noisy = add_noise(SCHEDULE, LATENTS, NOISE, TIMESTEPS)
    epsilon = query((0, 1, 2), few_steps=True, calls=calls)(noisy, TIMESTEPS, True)
    signal, sigma = SCHEDULE.factors(TIMESTEPS)
    clean = (noisy - sigma * epsilon) / signal
    gain = signal * SPREAD**2 / (signal**2 * SPREAD**2 + sigma**2)
    residual = (clean - gain * noisy) / (1 - gain * signal)
    assert min(np.abs(residual[0] - mu).max() for mu in PICTURES[0, :3]) < 1e-5
    assert (calls.runs, calls.views) == (1, VIEWS)


def test_a_weak_network_predicts_weakened_pictures() -> None:
    weak = weakened(query(), SCHEDULE, lambda clean, timesteps: 0.5 * clean)
    noisy = add_noise(SCHEDULE, LATENTS, NOISE, TIMESTEPS)
    signal, sigma = SCHEDULE.factors(TIMESTEPS)
    strong, found = ((noisy - sigma * q(noisy, TIMESTEPS, True)) / signal for q in (query(), weak))
    np.testing.assert_allclose(found, 0.5 * strong, atol=1e-5)


def test_gradients_are_their_formulas() -> None:
    signal, sigma = (np.asarray(f, np.float64) for f in SCHEDULE.factors(TIMESTEPS))
    asked = query()
    step = step_at(signal_power=0.5, negative=lambda noisy, timesteps: 0.1 * noisy)
    noisy = signal * LATENTS + sigma * NOISE
    told, without = (asked(noisy, TIMESTEPS, flag) for flag in (True, False))
    weight = signal * sigma**2
    direction = told - without
    expected = {
        "sds": weight * (without + 7.5 * direction - NOISE),
        "csd": weight * direction,
        "nfsd": weight * (without - np.array([0, 1, 1]).reshape(-1, 1, 1, 1) * 0.1 * noisy + 7.5 * direction),
    }
    for name, value in expected.items():
        np.testing.assert_allclose(METHODS[name](asked, SCHEDULE, step), value, atol=1e-10, err_msg=name)
    # One step of DDIM to no noise is the guided clean prediction.
    clean = (noisy - sigma * (without + 7.5 * direction)) / signal
    np.testing.assert_allclose(multistep(1)(asked, SCHEDULE, step), LATENTS - clean, atol=1e-10)


def test_what_a_text_does_not_change_is_left_alone() -> None:
    every = query((0, 1, 2, 3))
    np.testing.assert_allclose(csd(every, SCHEDULE, step_at()), 0, atol=1e-12)
    noisy = add_noise(SCHEDULE, LATENTS, NOISE, TIMESTEPS)
    np.testing.assert_allclose(guided(every, noisy, TIMESTEPS, 20.0), every(noisy, TIMESTEPS, True))


def test_at_the_truth_inversion_asks_for_nothing_and_fresh_noise_does() -> None:
    """One Gaussian, latents at its mean: the noise that is found in them is 0."""
    single = query_of(Believed(PICTURES[:, :1], np.array([0])), SCHEDULE, spread=SPREAD)
    step = step_at(PICTURES[:, 0], 1.0)
    for name, gradient in (("ism", ism), ("sdi", sdi())):
        np.testing.assert_allclose(gradient(single, SCHEDULE, step), 0, atol=1e-6, err_msg=name)
    signal, sigma = (np.asarray(f, np.float64) for f in SCHEDULE.factors(TIMESTEPS))
    share = (signal * SPREAD) ** 2 / ((signal * SPREAD) ** 2 + sigma**2)
    np.testing.assert_allclose(
        sds(single, SCHEDULE, step), weighted(SCHEDULE, step, -share * NOISE), atol=1e-6
    )


def test_off_the_truth_all_lead_back() -> None:
    single = query_of(Believed(PICTURES[:, :1], np.array([0])), SCHEDULE, spread=1e-3)
    away = PICTURES[:, 0] + 0.3
    for name in ("sds", "ism", "sdi", "4 steps"):
        gradient = METHODS[name](single, SCHEDULE, step_at(away, 1.0))
        assert (gradient.mean((1, 2, 3)) > 0).all(), name


def test_inversion_comes_back() -> None:
    """DDIM forwards from where DDIM backwards ended, with steps fine enough."""
    asked, to = query(), np.full(VIEWS, 600)
    likely = PICTURES[:, 1] + SPREAD * NOISE
    noisy = inverted(asked, SCHEDULE, likely, to, 300, told=True)
    path = np.round(np.linspace(1, 0, 301)[:, None] * to).astype(np.int64)
    for now, then in itertools.pairwise(path):
        noisy = ddim(SCHEDULE, noisy, asked(noisy, now, True), now, then)
    np.testing.assert_allclose(noisy, likely, atol=0.05)


def test_guidance_within_an_interval_is_none_outside() -> None:
    asked = query()
    narrow = sds_within(0.4, 0.6)(asked, SCHEDULE, step_at())
    alone, guided_there = (sds(asked, SCHEDULE, step_at(scale=scale)) for scale in (1.0, 7.5))
    for row, expected in enumerate((alone, guided_there, alone)):
        np.testing.assert_allclose(narrow[row], expected[row], atol=1e-10)


def test_perp_neg_is_its_formula_and_leaves_alone_what_does_not_oppose() -> None:
    asked, against = query(), query((2,))
    away = np.array([0.0, 0.5, 1.0])
    step = step_at(opposed=lambda noisy, timesteps: against(noisy, timesteps, True), away=away)
    signal, sigma = (np.asarray(f, np.float64) for f in SCHEDULE.factors(TIMESTEPS))
    noisy = signal * LATENTS + sigma * NOISE
    told, without, other = (
        asked(noisy, TIMESTEPS, True),
        asked(noisy, TIMESTEPS, False),
        against(noisy, TIMESTEPS, True),
    )
    found = perp_neg(asked, SCHEDULE, step)
    for b in range(VIEWS):
        d, n = told[b] - without[b], other[b] - without[b]
        across = n - (n * d).sum() / (d * d).sum() * d
        assert abs((across * d).sum()) < 1e-9
        expected = sigma[b] ** 2 * (without[b] + 7.5 * (d - away[b] * across) - NOISE[b])
        np.testing.assert_allclose(found[b], expected, atol=1e-10)
    same = step_at(opposed=lambda noisy, timesteps: asked(noisy, timesteps, True), away=away)
    np.testing.assert_allclose(perp_neg(asked, SCHEDULE, same), sds(asked, SCHEDULE, step_at()), atol=1e-9)


def test_what_a_text_makes_likely_weighs_as_much_as_what_is_seen() -> None:
    likely = np.array([[0.9, 0.1], [0.5, 0.5], [1.0, 0.0]])
    factors = SCHEDULE.factors(TIMESTEPS)
    noisy = add_noise(SCHEDULE, LATENTS, NOISE, TIMESTEPS)
    plain = weights(noisy, PICTURES[:, :2], factors, SPREAD, together=False)
    found = weights(noisy, PICTURES[:, :2], factors, SPREAD, together=False, likely=likely)
    expected = plain * likely
    np.testing.assert_allclose(found, expected / expected.sum(1, keepdims=True), atol=1e-12)
    told = query_of(Believed(PICTURES, np.array([0, 1]), likely), SCHEDULE, spread=SPREAD)
    certain = query_of(Believed(PICTURES, np.array([0])), SCHEDULE, spread=SPREAD)
    one, other = (q(noisy, TIMESTEPS, True) for q in (told, certain))
    np.testing.assert_allclose(one[2], other[2], atol=1e-10)


def test_nfsd_needs_to_know_what_is_bad() -> None:
    with pytest.raises(AssertionError):
        nfsd(query(), SCHEDULE, step_at())
