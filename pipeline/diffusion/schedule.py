"""The noise schedule of a diffusion model, from diffusers' scheduler_config.json.

Letters: x_0 clean latents, eps unit noise, abar_t the cumulative product of 1 - beta; a noisy latent is
x_t = sqrt(abar_t) x_0 + sqrt(1 - abar_t) eps (Ho et al. 2020, equation 4). What the network gives is
eps, v = sqrt(abar_t) eps - sqrt(1 - abar_t) x_0 (Salimans and Ho 2022, appendix D) or x_0. Factors are
float64, latents go in and come out as float32.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from pipeline.diffusion.bundle import read_json
from pipeline.errors import InputError

BETA_SCHEDULES = ("linear", "scaled_linear", "squaredcos_cap_v2")
PREDICTIONS = ("epsilon", "v_prediction", "sample")
Factor = Float64[np.ndarray, "b 1 1 1"]
Latents = Float[np.ndarray, "b c h w"]


@dataclass(frozen=True)
class Schedule:
    """abar of every training timestep, (T,) float64 falling within [0, 1], and what the network predicts."""

    alphas_cumprod: Float64[np.ndarray, " T"]
    prediction_type: str

    def __post_init__(self) -> None:
        abar = self.alphas_cumprod
        if not ((abar >= 0) & (abar < 1)).all() or not (np.diff(abar) <= 0).all():
            raise ValueError("alphas_cumprod must fall within [0, 1)")
        if self.prediction_type not in PREDICTIONS:
            raise ValueError(f"prediction_type is {self.prediction_type!r}, expected one of {PREDICTIONS}")

    def factors(self, timesteps: Int[np.ndarray, " b"]) -> tuple[Factor, Factor]:
        """Return (sqrt(abar_t), sqrt(1 - abar_t)) of timesteps in [0, T), each (b, 1, 1, 1)."""
        abar = self.alphas_cumprod[timesteps].reshape(-1, 1, 1, 1)
        return np.sqrt(abar), np.sqrt(1.0 - abar)

    def add_noise(
        self, clean: Latents, noise: Latents, timesteps: Int[np.ndarray, " b"]
    ) -> Float32[np.ndarray, "b c h w"]:
        """Return x_t of clean latents and unit noise."""
        signal, sigma = self.factors(timesteps)
        return (signal * clean + sigma * noise).astype(np.float32)

    def to_clean(
        self, output: Latents, noisy: Latents, timesteps: Int[np.ndarray, " b"]
    ) -> Float32[np.ndarray, "b c h w"]:
        """Return the x_0 that the network's raw output stands for.

        Where abar_t is 0 (a zero-SNR last step) noise says nothing of x_0: the "epsilon" case divides by
        the square root of the smallest float32 instead and stays finite.
        """
        signal, sigma = self.factors(timesteps)
        if self.prediction_type == "sample":
            return output.astype(np.float32)
        if self.prediction_type == "v_prediction":
            return (signal * noisy - sigma * output).astype(np.float32)
        return ((noisy - sigma * output) / np.maximum(signal, _SMALLEST)).astype(np.float32)

    def to_epsilon(
        self, output: Latents, noisy: Latents, timesteps: Int[np.ndarray, " b"]
    ) -> Float32[np.ndarray, "b c h w"]:
        """Return the noise that the network's raw output stands for; finite at every timestep."""
        signal, sigma = self.factors(timesteps)
        if self.prediction_type == "epsilon":
            return output.astype(np.float32)
        if self.prediction_type == "v_prediction":
            return (signal * output + sigma * noisy).astype(np.float32)
        return ((noisy - signal * output) / np.maximum(sigma, _SMALLEST)).astype(np.float32)


_SMALLEST = math.sqrt(float(np.finfo(np.float32).tiny))


def load_schedule(folder: Path) -> Schedule:
    """Return the schedule in `folder/scheduler_config.json`; diffusers' names and defaults.

    Raises InputError when the file is missing or garbage, or names a schedule that is not implemented.
    """
    path = folder / "scheduler_config.json"
    config = read_json(path)
    steps = _number(path, config, "num_train_timesteps", 1000, 2, 100_000)
    if not float(steps).is_integer():
        raise InputError(f"{path}: num_train_timesteps is {steps}, expected a whole number")
    prediction = config.get("prediction_type", "epsilon")
    if prediction not in PREDICTIONS:
        raise InputError(
            f"{path}: prediction_type is {prediction!r}, expected one of {', '.join(PREDICTIONS)}"
        )
    betas = _betas(path, config, int(steps))
    abar = np.cumprod(1.0 - betas)
    if config.get("rescale_betas_zero_snr"):
        abar = _zero_terminal_snr(abar)
    return Schedule(abar, prediction)


def _betas(path: Path, config: dict[str, Any], steps: int) -> Float64[np.ndarray, " T"]:
    if (trained := config.get("trained_betas")) is not None:
        try:
            betas = np.array(trained, np.float64)
        except (TypeError, ValueError):
            betas = np.zeros(0)
        if betas.shape != (steps,) or not ((betas > 0) & (betas < 1)).all():
            raise InputError(f"{path}: trained_betas, expected {steps} numbers between 0 and 1")
        return betas
    kind = config.get("beta_schedule", "linear")
    if kind not in BETA_SCHEDULES:
        raise InputError(f"{path}: beta_schedule is {kind!r}, expected one of {', '.join(BETA_SCHEDULES)}")
    if kind == "squaredcos_cap_v2":  # Nichol and Dhariwal 2021, equation 17
        level = np.cos((np.arange(steps + 1) / steps + 0.008) / 1.008 * np.pi / 2) ** 2
        return np.minimum(1.0 - level[1:] / level[:-1], 0.999)
    first = _number(path, config, "beta_start", 0.0001, 1e-12, 1 - 1e-12)
    last = _number(path, config, "beta_end", 0.02, 1e-12, 1 - 1e-12)
    if kind == "scaled_linear":
        return np.linspace(math.sqrt(first), math.sqrt(last), steps) ** 2
    return np.linspace(first, last, steps)


def _number(path: Path, config: dict[str, Any], key: str, default: float, low: float, high: float) -> float:
    value = config.get(key, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise InputError(f"{path}: {key} is {value!r}, expected a number from {low:g} to {high:g}")
    return float(value)


def _zero_terminal_snr(abar: Float64[np.ndarray, " T"]) -> Float64[np.ndarray, " T"]:
    """Shift and scale sqrt(abar) so that the last step is pure noise (Lin et al. 2024, algorithm 1)."""
    root = np.sqrt(abar)
    return ((root - root[-1]) * root[0] / (root[0] - root[-1])) ** 2
