"""Options of Latent-Paint: the colours of a given mesh."""

from dataclasses import dataclass
from typing import Literal

from pipeline.errors import InputError
from pipeline.options.distillation import Distillation
from pipeline.options.schema import check, check_power_of_two, option


@dataclass(frozen=True)
class Prepare:
    """A given mesh made ready for painting."""

    up: Literal["+x", "-x", "+y", "-y", "+z", "-z"] = option("+y", "the mesh's axis that points up")
    front: Literal["+x", "-x", "+y", "-y", "+z", "-z"] = option("+z", "the mesh's axis that its front faces")
    resolution: int = option(1024, "side of the atlas that islands are packed for [texels]", 64, 16_384)
    uv: Literal["auto", "rewrap"] = option(
        "auto", "use the file's texture coordinates if they are usable, or always make new ones"
    )

    def __post_init__(self) -> None:
        check(self)
        if self.up[1] == self.front[1]:
            raise InputError(
                f"prepare.up is {self.up} and prepare.front {self.front}: expected two different axes"
            )


@dataclass(frozen=True)
class TrainPaint(Distillation):
    """Latent-Paint: score distillation of the colours of a given mesh, in latent space."""

    steps: int = option(120, "optimiser steps", 1, 100_000)
    texture: int = option(128, "side of the latent texture [latent texels]", 8, 4096)
    mesh_radius: float = option(0.6, "radius of the ball that the mesh is fitted to [scene units]", 0.01, 10)
    views: int = option(96, "views whose texel weights are computed once and drawn from", 4, 4096)
    supersampling: int = option(3, "samples along a side of a latent pixel", 1, 16)
    # The paper starts from unit noise. A view averages several texels in a latent pixel, so what is finer
    # than a pixel stays as it began: on the grand piano the noise was still there after 200 steps.
    initial_noise: float = option(0.0, "standard deviation of the latents at the start; the paper: 1", 0, 10)
    # The paper's 1e-2 moves a texel by 1 in 100 steps at most.
    learning_rate: float = option(5e-2, "Adam's rate for the colours", 1e-7, 1)
    # Six meshes with ideal denoisers: 39.9 dB without, 41.7 dB with it after 120 steps; 38.1 and 43.5 dB
    # after 400; 36.0 and 35.3 dB after 60. Fields gain nothing (30.5 and 30.6 dB after 200 steps).
    cooling: float = option(
        0.5, "last share of the run, over which the rate falls to a tenth; the paper: 0, constant", 0, 1
    )


@dataclass(frozen=True)
class BakePaint:
    """From painted latents to colours."""

    method: Literal["views", "atlas"] = option(
        "views", "decode rendered views and project them, or decode the latent texture once (the paper)"
    )
    views: int = option(24, "views decoded and projected", 4, 256)
    large_views: int = option(
        10,
        "instead, where a decoded picture has 512 pixels or more a side and takes a third of a minute",
        4,
        256,
    )
    view_resolution: int = option(
        0, "side of a rendered view [latent pixels]; 0: the bundle's latent size, doubled up to 64", 0, 512
    )
    texture: int = option(1024, "side of the texture [texels], a power of two", 64, 8192)

    def __post_init__(self) -> None:
        check(self)
        check_power_of_two("bake_paint.texture", self.texture)
