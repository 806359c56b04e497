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
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from pipeline.diffusion.schedule import Schedule
from pipeline.diffusion.sessions import Denoise

LATENT_NERF_POWER = 0.5
DREAMFUSION_POWER = 0.0


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
    clean_clamp: float | Float[np.ndarray, " c"] = 0.0,
    signal_power: float = LATENT_NERF_POWER,
) -> SdsStep:
    """Return the score distillation gradient of rendered latents.

    `latents`: scaled latents, one view a row. `timesteps`: in [0, T). `noise`: unit normal. `cond`: the
    text of each view; `uncond`: the negative or empty text. `guidance_scale`: s; 1 skips the uncond pass.
    `clean_clamp`: bound on |x0_hat|, one for all channels or one a channel; 0 is no bound.
    `signal_power`: p of w(t), see above. The network runs once, on 2b rows (b without guidance).
    Raises FloatingPointError when the latents are not finite; the denoiser raises for its own output.
    """
    if not np.isfinite(latents).all():
        raise FloatingPointError("the rendered latents hold NaN or infinity: the scene has diverged")
    noisy = schedule.add_noise(latents, noise, timesteps)
    if guidance_scale == 1:
        output = denoise(noisy, timesteps, cond)
    else:
        texts = np.concatenate([np.broadcast_to(uncond, cond.shape), cond])
        both = denoise(np.concatenate([noisy, noisy]), np.concatenate([timesteps, timesteps]), texts)
        without, told = both[: len(noisy)].astype(np.float64), both[len(noisy) :]
        # eps, v and x_0 are affine in one another at a fixed x_t: guidance is the same in all three.
        output = without + guidance_scale * (told - without)
    clean = schedule.to_clean(output, noisy, timesteps)
    if np.any(bound := np.asarray(clean_clamp, np.float32)):
        bound = bound.reshape(-1, 1, 1)
        clean = np.where(bound > 0, np.clip(clean, -bound, bound), clean)
    signal, sigma = schedule.factors(timesteps)
    gradient = (signal ** (2 * signal_power + 1) * sigma * (latents - clean)).astype(np.float32)
    norm = float(np.sqrt(np.mean(np.square(gradient, dtype=np.float64))))
    return SdsStep(gradient, clean, norm)
