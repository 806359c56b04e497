"""Every published gradient of score distillation that needs no training of its prior, on one interface.

Rendered latents z, a denoiser and the step's noise level and noise in; the gradient by z out. With
x_t = a z + sigma e, all of them are w(t) times a difference of predicted noises, and all are given the same
w(t) = a^(2p) sigma^2 (`Step.signal_power` p), so that they differ in what they say and not in how loudly.
Guided noise is e_u + s (e_c - e_u), c with the text and u without.

- sds: guided - e. Poole et al. 2023 (DreamFusion), equation 3; p = 1/2 is Metzer et al. 2023.
- csd: e_c - e_u. Yu et al. 2024 (Text-to-3D with Classifier Score Distillation), equation 9.
- nfsd: delta_D + s (e_c - e_u); delta_D = e_u where little noise is left, else e_u - e_negative. Katzir et
  al. 2024 (Noise-free Score Distillation).
- ism: guided(x_t) - e_u(x_s), both by DDIM inversion without a text. Liang et al. 2024 (LucidDreamer).
- sdi: guided(x_t) - k, k the noise that DDIM inversion with the text finds in z. Lukoianov et al. 2024.
- multistep: z - what steps of DDIM from x_t make, at weight 1; as in DreamFlow and MicroDreamer.
- sds_within: sds, guided at middling noise levels alone. Kynkaanniemi et al. 2024 (Applying Guidance in a
  Limited Interval).
- perp_neg: sds with e_u + s (d - v p), d = e_c - e_u and p what of e_opposed - e_u is perpendicular to d,
  e_opposed with the text of another side and v its weight for the view. Armandpour et al. 2023, equation 8.

VSD (ProlificDreamer) and others that train the prior beside the scene are left out.

Letters: b views, h x w latent pixels.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from benchmarks._mixtures import Query
from pipeline.diffusion.distillation import perpendicular
from pipeline.diffusion.schedule import Schedule

Latents = Float[np.ndarray, "b 4 h w"]
LITTLE_NOISE = 0.2
"""Share of the schedule below which NFSD takes what is left of a prediction for the image's own."""
INVERSION_STEP, INTERVAL = 0.2, 0.05
"""Of the schedule: a step of ISM's inversion, and its interval (200 and 50 of 1000 there)."""


class Step(NamedTuple):
    """What a gradient is asked about."""

    latents: Latents
    timesteps: Int[np.ndarray, " b"]
    noise: Latents
    guidance_scale: float
    signal_power: float = 0.0
    negative: Callable[[Latents, Int[np.ndarray, " b"]], Latents] | None = None
    """The noise that a bad picture would leave in noisy latents (NFSD's negative text)."""
    opposed: Callable[[Latents, Int[np.ndarray, " b"]], Latents] | None = None
    """The noise in noisy latents by a text that the views are not to fit (Perp-Neg)."""
    away: Float[np.ndarray, " b"] | None = None
    """The weight of that text for each view."""


Gradient = Callable[[Query, Schedule, Step], Latents]


def weighted(schedule: Schedule, step: Step, difference: Latents) -> Latents:
    """Return the gradient of a difference of noises: times a^(2p) sigma^2."""
    signal, sigma = schedule.factors(step.timesteps)
    return np.asarray(signal ** (2 * step.signal_power) * sigma**2 * difference, np.float64)


def guided(query: Query, noisy: Latents, timesteps: Int[np.ndarray, " b"], scale: float) -> Latents:
    """Return the guided noise; at scale 1 the text's own, without asking what it is without one."""
    told = query(noisy, timesteps, True)
    if scale == 1:
        return told
    without = query(noisy, timesteps, False)
    return without + scale * (told - without)


def add_noise(schedule: Schedule, latents: Latents, noise: Latents, timesteps: np.ndarray) -> Latents:
    """Return a z + sigma e, float64."""
    signal, sigma = schedule.factors(timesteps)
    return np.asarray(signal * latents + sigma * noise, np.float64)


def ddim(
    schedule: Schedule, noisy: Latents, epsilon: Latents, now: np.ndarray, then: np.ndarray | None
) -> Latents:
    """Return latents moved from timestep `now` to `then` along a predicted noise (None: to no noise at all),
    deterministically (Song et al. 2021); the same step goes both ways."""
    signal, sigma = schedule.factors(now)
    clean = (noisy - sigma * epsilon) / signal
    return clean if then is None else add_noise(schedule, clean, epsilon, then)


def inverted(
    query: Query, schedule: Schedule, latents: Latents, to: Int[np.ndarray, " b"], steps: int, told: bool
) -> Latents:
    """Return the noisy latents at timesteps `to` from which DDIM would come back to `latents`: so many steps
    of it backwards, each by the noise predicted where it sets out."""
    path = np.maximum(np.round(np.linspace(0, 1, steps + 1)[:, None] * to).astype(np.int64), 1)
    # At the lowest level there is hardly any noise to be predicted; where it sets out, there is none.
    noisy = add_noise(schedule, latents, np.zeros_like(latents), path[0])
    for now, then in itertools.pairwise(path):
        noisy = ddim(schedule, noisy, query(noisy, now, told), now, then)
    return noisy


def sds(query: Query, schedule: Schedule, step: Step) -> Latents:
    """Score distillation sampling."""
    noisy = add_noise(schedule, step.latents, step.noise, step.timesteps)
    difference = guided(query, noisy, step.timesteps, step.guidance_scale) - step.noise
    return weighted(schedule, step, difference)


def csd(query: Query, schedule: Schedule, step: Step) -> Latents:
    """Classifier score distillation: only what the text adds."""
    noisy = add_noise(schedule, step.latents, step.noise, step.timesteps)
    difference = query(noisy, step.timesteps, True) - query(noisy, step.timesteps, False)
    return weighted(schedule, step, difference)


def nfsd(query: Query, schedule: Schedule, step: Step) -> Latents:
    """Noise-free score distillation."""
    assert step.negative is not None
    noisy = add_noise(schedule, step.latents, step.noise, step.timesteps)
    told, without = (query(noisy, step.timesteps, with_text) for with_text in (True, False))
    little = (step.timesteps < LITTLE_NOISE * len(schedule.alphas_cumprod)).reshape(-1, 1, 1, 1)
    domain = without - np.where(little, 0.0, step.negative(noisy, step.timesteps))
    return weighted(schedule, step, domain + step.guidance_scale * (told - without))


def ism(query: Query, schedule: Schedule, step: Step) -> Latents:
    """Interval score matching."""
    total = len(schedule.alphas_cumprod)
    start = np.maximum(step.timesteps - int(INTERVAL * total), 1)
    steps = max(1, round(float(start.max()) / (INVERSION_STEP * total)))
    at_start = inverted(query, schedule, step.latents, start, steps, told=False)
    own = query(at_start, start, False)
    noisy = ddim(schedule, at_start, own, start, step.timesteps)
    difference = guided(query, noisy, step.timesteps, step.guidance_scale) - own
    return weighted(schedule, step, difference)


def sds_within(low: float, high: float) -> Gradient:
    """Return score distillation that is guided between these shares of the schedule alone."""

    def gradient(query: Query, schedule: Schedule, step: Step) -> Latents:
        noisy = add_noise(schedule, step.latents, step.noise, step.timesteps)
        told, without = (query(noisy, step.timesteps, with_text) for with_text in (True, False))
        level = (step.timesteps / len(schedule.alphas_cumprod)).reshape(-1, 1, 1, 1)
        more = np.where((level >= low) & (level <= high), step.guidance_scale - 1, 0.0)
        return weighted(schedule, step, told + more * (told - without) - step.noise)

    return gradient


def perp_neg(query: Query, schedule: Schedule, step: Step) -> Latents:
    """Score distillation that turns away from the text of another side."""
    assert step.opposed is not None
    assert step.away is not None
    noisy = add_noise(schedule, step.latents, step.noise, step.timesteps)
    told, without = (query(noisy, step.timesteps, with_text) for with_text in (True, False))
    direction = told - without
    apart = perpendicular(step.opposed(noisy, step.timesteps) - without, direction)
    direction = direction - step.away.reshape(-1, 1, 1, 1) * apart
    return weighted(schedule, step, without + step.guidance_scale * direction - step.noise)


def sdi(steps: int = 10) -> Gradient:
    """Return score distillation via inversion by so many steps."""

    def gradient(query: Query, schedule: Schedule, step: Step) -> Latents:
        noisy = inverted(query, schedule, step.latents, step.timesteps, steps, told=True)
        signal, sigma = schedule.factors(step.timesteps)
        own = (noisy - signal * step.latents) / sigma
        difference = guided(query, noisy, step.timesteps, step.guidance_scale) - own
        return weighted(schedule, step, difference)

    return gradient


def multistep(steps: int) -> Gradient:
    """Return the way to a target: the latents that so many steps of guided DDIM make of noisy ones."""

    def gradient(query: Query, schedule: Schedule, step: Step) -> Latents:
        noisy = add_noise(schedule, step.latents, step.noise, step.timesteps)
        path = np.round(np.linspace(1, 0, steps + 1)[:, None] * step.timesteps).astype(np.int64)
        for i in range(steps):
            epsilon = guided(query, noisy, path[i], step.guidance_scale)
            noisy = ddim(schedule, noisy, epsilon, path[i], path[i + 1] if i + 1 < steps else None)
        return step.latents - noisy

    return gradient


METHODS: dict[str, Gradient] = {
    "sds": sds,
    "csd": csd,
    "nfsd": nfsd,
    "ism": ism,
    "sdi": sdi(),
    "4 steps": multistep(4),
    "perp-neg": perp_neg,
    "interval": sds_within(0.2, 0.8),
}
