"""One trial of a way of score distillation: the product's own scene, trained by what an oracle answers.

Letters: b views, h x w latent pixels.
"""

import dataclasses
import time
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter

from benchmarks._gradients import METHODS, Step
from benchmarks._ideal import Calls, linear_schedule
from benchmarks._mixture_scenes import QUARTERS, Scenes, facing, scenes_of, sides
from benchmarks._mixtures import Believed, Query, believed, commitment, nearest, query_of, weakened
from benchmarks._trials import RESOLUTION, backgrounds, held_out, job_of, shape_error, views_psnr
from benchmarks._ways import WAYS, Draws, Targets, Way
from benchmarks._weakness import TOTAL, weaken
from pipeline.nerf import train as nerf_train
from pipeline.nerf.rendering import render_views
from pipeline.nerf.step import NerfMetrics, State, draw_batch, initial_state, training_step
from pipeline.options.nerf import TrainNerf
from pipeline.training.batch import Batch, ViewGradient

BAD_BLUR = 2.0
"""Of the picture that NFSD takes for a bad one [latent pixels]."""


class Setting(NamedTuple):
    """One trial."""

    way: str
    oracle: str
    scene: str
    calls: int
    seed: int = 0
    resolution: int = RESOLUTION


def passes(setting: Setting) -> int:
    """Return the runs of the network that a step of a way asks for."""
    way = WAYS[setting.way]
    return way.alone if setting.oracle == "exact" else way.passes


def noise_of_bad(seen: Believed) -> Float[np.ndarray, "b 4 h w"]:
    """Return the blurred mean of all scenes, the opposite of a good picture."""
    return np.stack(
        [gaussian_filter(mean, (0, BAD_BLUR, BAD_BLUR), mode="nearest") for mean in seen.pictures.mean(1)]
    )


class Oracle:
    """A denoiser for the views of a step, and what gradients need besides."""

    def __init__(self, setting: Setting, scenes: Scenes, calls: Calls) -> None:
        self.setting, self.scenes, self.calls = setting, scenes, calls
        self.schedule = linear_schedule()
        self.rng = np.random.default_rng([setting.seed, 9])
        """Of a weak network's errors."""

    def seen(self, batch: Batch, size: int) -> Believed:
        """Return what the scenes show in the views of a step."""
        told, others = ([truth.draw for truth in part] for part in self.scenes[:2])
        likely = sides(batch.azimuths) if self.scenes.turned else None
        return believed(told, others, batch, size, likely)

    def query(self, seen: Believed) -> Query:
        """Return the denoiser."""
        query = query_of(
            seen,
            self.schedule,
            together=self.setting.oracle == "together",
            few_steps=self.setting.oracle == "few steps",
            calls=self.calls,
        )
        if self.setting.oracle != "weak":
            return query

        def weak(clean: np.ndarray, timesteps: np.ndarray) -> np.ndarray:
            return weaken(clean, timesteps, self.rng)

        return weakened(query, self.schedule, weak)

    def step(self, latents: np.ndarray, batch: Batch, seen: Believed, power: float) -> Step:
        """Return what a gradient is asked about the views of a step."""
        levels = batch.noise_levels
        if self.setting.oracle == "together":
            levels = np.full_like(levels, levels[0])
        bad = noise_of_bad(seen)

        def negative(noisy: np.ndarray, timesteps: np.ndarray) -> np.ndarray:
            signal, sigma = self.schedule.factors(timesteps)
            return np.asarray((noisy - signal * bad) / sigma, np.float64)

        def opposed(noisy: np.ndarray, timesteps: np.ndarray) -> np.ndarray:
            fronts = np.eye(QUARTERS)[facing(batch.azimuths)]
            return self.query(seen._replace(likely=fronts))(noisy, timesteps, True)

        return Step(
            latents.astype(np.float64),
            np.clip((levels * TOTAL).astype(np.int64), 1, TOTAL - 1),
            batch.noise.astype(np.float64),
            batch.guidance_scale if self.setting.oracle != "exact" else 1.0,
            power,
            negative,
            opposed if self.scenes.turned else None,
            (facing(batch.azimuths) != 0).astype(np.float64),
        )


def view_gradient(way: Way, oracle: Oracle, options: TrainNerf, draws: Draws) -> ViewGradient:
    """Return a way's gradient from an oracle, as a training takes it."""
    method, targets = METHODS[way.gradient], Targets()
    power = options.signal_power

    def gradient(latents: Float[np.ndarray, "b 4 h w"], batch: Batch) -> Float[np.ndarray, "b 4 h w"]:
        began = time.process_time()
        fresh = len(latents) - len(draws.replayed)
        now = first_views(batch, fresh)
        seen = oracle.seen(now, latents.shape[-1])
        step = oracle.step(latents[:fresh], now, seen, power)
        found = method(oracle.query(seen), oracle.schedule, step)
        if way.draw == "replay":
            signal, sigma = oracle.schedule.factors(step.timesteps)
            weight = (signal ** (2 * power + 1) * sigma).reshape(-1)
            old = [targets.gradient(latents[fresh:], draws.replayed)] if draws.replayed else []
            targets.remember(latents[:fresh], found, weight)
            found = np.concatenate([found, *old])
        oracle.calls.seconds += time.process_time() - began
        return np.ascontiguousarray(found, np.float32)

    return gradient


def first_views(batch: Batch, count: int) -> Batch:
    """Return a batch without the views of earlier steps that come behind its own."""
    assert batch.backgrounds is not None
    return batch._replace(
        cameras=batch.cameras[:count],
        azimuths=batch.azimuths[:count],
        polars=batch.polars[:count],
        backgrounds=batch.backgrounds[:count],
        noise_levels=batch.noise_levels[:count],
        noise=batch.noise[:count],
    )


def learn(setting: Setting, **small: Any) -> dict[str, Any]:
    """Train a scene by a setting; return its errors against the scene that it is nearest to. `small`: other
    options of train_nerf."""
    way = WAYS[setting.way]
    steps = max(2, setting.calls // passes(setting))
    scale, end = way.guidance
    job = job_of(
        "standard",
        steps=steps,
        checkpoint_every=100_000,
        preview_every=100_000,
        guidance_scale=scale,
        guidance_scale_end=end,
        **{**small, **way.options},
    )
    job = dataclasses.replace(job, seed=setting.seed)
    options, calls = job.train_nerf, Calls()
    scenes = scenes_of(setting.oracle, setting.scene)
    state = initial_state(options, backgrounds(), setting.seed)
    draws = Draws(way.draw, setting.seed)
    gradient = view_gradient(way, Oracle(setting, scenes, calls), options, draws)

    def draw(step: int) -> Batch:
        progress = step / max(steps - 1, 1)
        return draws(
            draw_batch(options, progress, setting.resolution, state.scene, state.rng), step, progress
        )

    def take(state: State) -> NerfMetrics:
        return training_step(state, options, setting.resolution, gradient, draw=draw)

    began = time.process_time()
    nerf_train.finish("distillation", state, [], options, take)
    spent = time.process_time() - began - calls.seconds
    cameras, flat = held_out(options), backgrounds()[0]
    views = render_views(state.scene, cameras, setting.resolution, flat).latents
    choices = nearest(views, pictures_of(scenes, cameras, setting.resolution, flat))
    truth = scenes.told[int(np.bincount(choices).argmax())]
    return {
        "steps": steps,
        "calls": calls.runs,
        "views": calls.views,
        "seconds": round(spent, 2),
        "commitment": round(commitment(choices), 3),
        "psnr": round(views_psnr(state.scene, truth, cameras, setting.resolution), 3),
        **shape_error(state.scene, truth, job),
    }


def pictures_of(scenes: Scenes, cameras: Any, size: int, flat: np.ndarray) -> Float[np.ndarray, "b k 4 h w"]:
    """Return what the scenes of the text show to cameras."""
    return np.stack(
        [np.stack([truth.draw(camera, size, flat) for truth in scenes.told]) for camera in cameras]
    )
