"""RGB refinement, as the networks of a bundle allow it.

Letters: b views, h x w latent pixels.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from pipeline.diffusion.bundle import Bundle
from pipeline.diffusion.conditions import conditions_of
from pipeline.diffusion.distillation import SdsStep
from pipeline.diffusion.rgb_gradients import encoder_gradient, image_gradient
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import Decode, denoiser, vae_encoder, vae_encoder_vjp
from pipeline.diffusion.view_gradient import distil, load_embeddings
from pipeline.errors import InputError
from pipeline.options.nerf import Refinement
from pipeline.training.batch import Batch, ViewGradient

_MOST_PIXELS = 128


def require_encoder(bundle: Bundle, inputs: Mapping[str, Path], asked: str = "REFINE") -> None:
    """Raise InputError unless the bundle can encode pictures, as what was `asked` for needs."""
    if "vae_encoder" not in inputs:
        raise InputError(
            f"MODEL {bundle.name} has no vae_encoder, which {asked} needs: export the model with it, "
            f"or leave {asked} out"
        )


def view_size(options: Refinement, bundle: Bundle) -> int:
    """Return the side of a rendered view [pixels]."""
    return options.resolution or min(max(bundle.image_size // 2, 1), _MOST_PIXELS)


def possible_gradient(
    options: Refinement, bundle: Bundle, inputs: Mapping[str, Path]
) -> tuple[Literal["encoder", "image"], list[str]]:
    """Return how pictures are told what to become: as it is asked for if the bundle can, else the other way,
    with a warning."""
    if options.gradient == "image" or "vae_encoder_vjp" in inputs:
        return options.gradient, []
    return "image", [
        f"{bundle.name} has no vae_encoder_vjp (the encoder's gradient): pictures are refined towards "
        "decoded ones instead; export the bundle again to have it"
    ]


@contextmanager
def picture_distillation(
    options: Refinement,
    gradient: Literal["encoder", "image"],
    bundle: Bundle,
    inputs: Mapping[str, Path],
    decode: Decode,
    provider: str,
) -> Iterator[ViewGradient]:
    """Give score distillation of pictures by the bundle's networks, which are closed at the end."""
    embeddings, schedule = load_embeddings(inputs["embeddings"]), load_schedule(inputs["scheduler"])
    scale, rows = bundle.latent_scale, 2 * options.cameras_per_step
    with ExitStack() as stack:
        denoise = stack.enter_context(
            denoiser(inputs["unet"], provider=provider, rows_expected=rows, views=bundle.views)
        )
        encode = stack.enter_context(vae_encoder(inputs["vae_encoder"], scale, provider))

        def step(latents: Float[np.ndarray, "b 4 h w"], batch: Batch) -> SdsStep:
            return distil(latents, batch, denoise, schedule, embeddings, options, conditions_of(bundle))

        if gradient == "image":
            yield image_gradient(step, encode, decode, bundle.image_size)
        else:
            pull_back = stack.enter_context(vae_encoder_vjp(inputs["vae_encoder_vjp"], scale, provider))
            yield encoder_gradient(step, encode, pull_back, bundle.image_size)
