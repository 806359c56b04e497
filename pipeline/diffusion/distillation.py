"""Score distillation: the gradient that a denoiser gives to rendered latents.

Poole et al. 2022 (DreamFusion), equation 3; the paper, section 3 (its gradient of L_SDS):

    grad = w(t) (eps_hat(x_t, t, text) - eps)

with eps_hat from classifier-free guidance, eps_uncond + s (eps_cond - eps_uncond). The paper leaves w(t)
open ("a constant multiplier that depends on alpha_t"). One family covers the choices in use:

    w(t) = abar_t^p (1 - abar_t)

p = 1/2 is Latent-NeRF's public code, p = 0 is DreamFusion's sigma_t^2. Since x_t is a mixture of x and eps,
eps_hat - eps = sqrt(abar / (1 - abar)) (x - x0_hat), and the gradient is, without a division,

    grad = abar^(p + 1/2) (1 - abar)^(1/2) (x - x0_hat)

so p = 0 is also sqrt(abar (1 - abar)) (x - x0_hat), and p = 1/2 the same times sqrt(abar): less weight on
the noisiest steps. In this form the predicted clean latents can be bounded before they act, which bounds
the gradient. The gradient is returned, never turned into a loss.

Options that others found useful, all off by default:
- Perp-Neg (Armandpour et al. 2023, arXiv 2304.04968): of the direction towards an unwanted text only what is
  perpendicular to the wanted one is subtracted, so that the two cannot cancel.
- Guidance rescale (Lin et al. 2024, section 3.4; on x0_hat, as MVDream has it): guidance widens the spread of
  the prediction, which shows as saturation; part of the widening is taken back.
- A bound on every element of the gradient (Hong et al. 2023, arXiv 2303.15413).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int

from pipeline.diffusion.schedule import Schedule
from pipeline.diffusion.sessions import Denoise

LATENT_NERF_POWER = 0.5
DREAMFUSION_POWER = 0.0


class Opposed(NamedTuple):
    """A text that each view is not to look like (Perp-Neg)."""

    text: Float[np.ndarray, "b l d"]
    weight: Float[np.ndarray, " b"]
    """0: no matter."""


@dataclass(frozen=True)
class SdsStep:
    """One evaluation: the gradient of the rendered latents, and what the network saw in them."""

    gradient: Float32[np.ndarray, "b c h w"]
    predicted_clean: Float32[np.ndarray, "b c h w"]
    gradient_norm: float
    """Root mean square of the gradient over all its elements: comparable between batch and image sizes."""


def sds_gradient(
    latents: Float32[np.ndarray, "b c h w"],
    denoise: Denoise,
    schedule: Schedule,
    timesteps: Int[np.ndarray, " b"],
    noise: Float32[np.ndarray, "b c h w"],
    cond: Float32[np.ndarray, "b l d"],
    uncond: Float32[np.ndarray, "l d"],
    guidance_scale: float,
    *,
    clean_clamp: float | Float[np.ndarray, " c"] = 0.0,
    signal_power: float = LATENT_NERF_POWER,
    opposed: Opposed | None = None,
    rescale: float = 0.0,
    gradient_clip: float = 0.0,
) -> SdsStep:
    """Return the score distillation gradient of rendered latents.

    `latents`: scaled latents, one view a row. `timesteps`: in [0, T). `noise`: unit normal. `cond`: the
    text of each view; `uncond`: the negative or empty text. `guidance_scale`: s; 1 skips the uncond pass.
    `clean_clamp`: bound on |x0_hat|, one for all channels or one a channel; 0 is no bound.
    `signal_power`: p of w(t), see above. `opposed`: what each view is to turn away from; without effect
    at s = 1. `rescale`: in [0, 1], the share of guidance's widening of x0_hat that is taken back.
    `gradient_clip`: bound on every |element| of the gradient; 0 is none. The network runs once, on 2b
    rows (b without guidance, 3b with `opposed`).
    Raises FloatingPointError when the latents or the network's output are not finite: a bound would make a
    number of an infinity.
    """
    if not np.isfinite(latents).all():
        raise FloatingPointError("the rendered latents hold NaN or infinity: the scene has diverged")
    noisy = schedule.add_noise(latents, noise, timesteps)
    if guidance_scale == 1:
        clean = schedule.to_clean(_finite(denoise(noisy, timesteps, cond)), noisy, timesteps)
    else:
        texts = [np.broadcast_to(uncond, cond.shape), cond] + ([] if opposed is None else [opposed.text])
        count = len(texts)
        feeds = np.tile(noisy, (count, 1, 1, 1)), np.tile(timesteps, count), np.concatenate(texts)
        outputs = _finite(denoise(*feeds))
        without, told, *against = outputs.reshape(count, *noisy.shape).astype(np.float64)
        direction = told - without
        if opposed is not None:
            apart = perpendicular(against[0] - without, direction)
            direction = direction - opposed.weight.reshape(-1, 1, 1, 1) * apart
        # eps, v and x_0 are affine in one another at a fixed x_t: guidance is the same in all three.
        clean = schedule.to_clean(without + guidance_scale * direction, noisy, timesteps)
        if rescale:
            own = schedule.to_clean(told, noisy, timesteps)
            clean = clean * (1 - rescale + rescale * _spread(own) / np.maximum(_spread(clean), 1e-8))
    if np.any(bound := np.asarray(clean_clamp, np.float32)):
        bound = bound.reshape(-1, 1, 1)
        clean = np.where(bound > 0, np.clip(clean, -bound, bound), clean)
    signal, sigma = schedule.factors(timesteps)
    gradient = (signal ** (2 * signal_power + 1) * sigma * (latents - clean)).astype(np.float32)
    if gradient_clip:
        gradient = gradient.clip(-gradient_clip, gradient_clip)
    norm = float(np.sqrt(np.mean(np.square(gradient, dtype=np.float64))))
    return SdsStep(gradient, clean.astype(np.float32), norm)


def perpendicular(
    vectors: Float[np.ndarray, "b c h w"], to: Float[np.ndarray, "b c h w"]
) -> Float[np.ndarray, "b c h w"]:
    """Return, row by row, what of `vectors` is perpendicular to `to`."""
    length = np.square(to).sum((1, 2, 3), keepdims=True)
    share = (vectors * to).sum((1, 2, 3), keepdims=True) / np.maximum(length, 1e-30)
    return vectors - share * to


def _finite(output: Float[np.ndarray, "r c h w"]) -> Float[np.ndarray, "r c h w"]:
    if bad := int((~np.isfinite(output)).sum()):
        raise FloatingPointError(f"denoiser output holds {bad} NaN or infinite values of {output.size}")
    return output


def _spread(latents: Float[np.ndarray, "b c h w"]) -> Float[np.ndarray, "b 1 1 1"]:
    # where a schedule ends in noise alone, predicted latents are too large to be squared in float32
    return latents.std((1, 2, 3), dtype=np.float64, keepdims=True)
