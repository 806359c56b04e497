"""Score distillation of pictures: in what direction should rendered RGB change?

Three answers, each the gradient by the pictures, summed over pixels:
- `encoder_gradient`: encode, distil in latents, and pull the gradient back through the encoder (the paper's
  RGB refinement, and how RGB fields are distilled from latent models);
- `image_gradient`: encode, denoise, decode, and compare in pixels: no gradient of the encoder is needed;
- `picture_gradient`: become a given picture; no denoiser.

Letters: b views, h x w pixels of a rendered view, s pixels along a side of the encoder's pictures.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float
from torch.nn import functional

from pipeline.diffusion.distillation import SdsStep
from pipeline.diffusion.sessions import Decode, Encode, PullBack
from pipeline.training.backward import inner_product
from pipeline.training.batch import Batch, ViewGradient

Distil = Callable[[Float[np.ndarray, "b 4 h w"], Batch], SdsStep]
Target = Callable[[Batch], tuple[Float[np.ndarray, "b 3 h w"], Float[np.ndarray, "b h w"]]]
"""Pictures that a batch's cameras should see, and the opacity of what is in them."""

LATENT_TO_RGB = ((0.298, 0.187, -0.158, -0.184), (0.207, 0.286, 0.189, -0.271), (0.208, 0.173, 0.264, -0.473))
"""The paper's equation of latents and colours (Stable Diffusion's): RGB in [-1, 1]."""
_FIT_WEIGHT = 4.0
"""Against the regularisers: a colour that is off by 0.1 pulls about as much as score distillation does."""


def encoder_gradient(distil: Distil, encode: Encode, pull_back: PullBack, size: int) -> ViewGradient:
    """Return score distillation through the encoder, whose pictures have `size` x `size` pixels."""

    def view_gradient(pictures: Float[np.ndarray, "b 3 h w"], batch: Batch) -> Float[np.ndarray, "b 3 h w"]:
        large, shrink = enlarge(pictures, size)
        shown = _channels_last(large.clip(0, 1))
        step = distil(encode(shown), batch)
        return shrink(held_inside(large, _channels_first(pull_back(shown, step.gradient))))

    return view_gradient


def image_gradient(distil: Distil, encode: Encode, decode: Decode, size: int) -> ViewGradient:
    """Return the pull towards the picture that the denoised latents decode to.

    Its length is that of the gradient by the latents, so that both ways weigh alike against regularisers.
    """

    def view_gradient(pictures: Float[np.ndarray, "b 3 h w"], batch: Batch) -> Float[np.ndarray, "b 3 h w"]:
        large, shrink = enlarge(pictures, size)
        step = distil(encode(_channels_last(large.clip(0, 1))), batch)
        pull = shrink(large - _channels_first(decode(step.predicted_clean)))
        return np.asarray(pull * _norms(step.gradient) / np.maximum(_norms(pull), 1e-12), np.float32)

    return view_gradient


def picture_gradient(target: Target) -> ViewGradient:
    """Return the pull towards given pictures of the object, over whatever background a view has."""

    def view_gradient(pictures: Float[np.ndarray, "b 3 h w"], batch: Batch) -> Float[np.ndarray, "b 3 h w"]:
        wanted, opacity = target(batch)
        difference = opacity[:, None] * (pictures - wanted)
        if batch.backgrounds is not None:
            back = batch.backgrounds[:, :, None, None]
            difference = difference + (1 - opacity[:, None]) * (pictures - back)
        return np.asarray(_FIT_WEIGHT * difference, np.float32)

    return view_gradient


def enlarge(
    pictures: Float[np.ndarray, "b 3 h w"], size: int
) -> tuple[
    Float[np.ndarray, "b 3 s s"], Callable[[Float[np.ndarray, "b 3 s s"]], Float[np.ndarray, "b 3 h w"]]
]:
    """Return pictures resized to `size` (bilinear), and the function that takes a gradient by these to the
    gradient by the pictures given."""
    leaf = torch.from_numpy(pictures).requires_grad_()
    with torch.enable_grad():
        resized = functional.interpolate(
            leaf, (size, size), mode="bilinear", align_corners=False, antialias=size < pictures.shape[-1]
        )

    def shrink(gradient: Float[np.ndarray, "b 3 s s"]) -> Float[np.ndarray, "b 3 h w"]:
        with torch.enable_grad():
            product = inner_product([resized], [torch.from_numpy(np.ascontiguousarray(gradient))])
        (result,) = torch.autograd.grad(product, leaf)
        return np.asarray(result.numpy())

    return resized.detach().numpy(), shrink


def held_inside(
    pictures: Float[np.ndarray, "b 3 h w"], gradient: Float[np.ndarray, "b 3 h w"]
) -> Float[np.ndarray, "b 3 h w"]:
    """Return the gradient without what would push colours further out of [0, 1]: nothing shows there."""
    outwards = ((pictures >= 1) & (gradient < 0)) | ((pictures <= 0) & (gradient > 0))
    return np.where(outwards, np.float32(0), gradient)


def _norms(values: Float[np.ndarray, "b c h w"]) -> Float[np.ndarray, "b 1 1 1"]:
    return np.sqrt(np.square(values, dtype=np.float64).sum((1, 2, 3), keepdims=True))


def _channels_last(pictures: Float[np.ndarray, "b 3 s s"]) -> Float[np.ndarray, "b s s 3"]:
    return np.ascontiguousarray(pictures.transpose(0, 2, 3, 1))


def _channels_first(pictures: Float[np.ndarray, "b s s 3"]) -> Float[np.ndarray, "b 3 s s"]:
    return np.ascontiguousarray(pictures.transpose(0, 3, 1, 2))
