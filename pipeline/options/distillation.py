"""Options that every training by score distillation has."""

from dataclasses import dataclass
from typing import Literal

from pipeline.errors import InputError
from pipeline.options.schema import check, option, snake


@dataclass(frozen=True)
class Distillation:
    """Score distillation: what both kinds of training share."""

    cameras_per_step: int = option(4, "views rendered and denoised in one step", 1, 64)
    resolution: int = option(
        0, "side of a rendered view [latent pixels]; 0: the bundle's latent size", 0, 512
    )
    guidance_scale: float = option(
        100.0, "classifier-free guidance at the first step; 1 skips the unconditional pass", 1, 1000
    )
    guidance_scale_end: float = option(
        0.0, "guidance at the last step (linear in between); 0: as at the first", 0, 1000
    )
    timestep_min: float = option(0.02, "least noise, as a share of the schedule", 0, 1)
    timestep_max: float = option(0.98, "most noise at the first step, as a share of the schedule", 0, 1)
    timestep_max_end: float = option(
        0.0, "most noise at the last step (linear in between); 0: as at the first", 0, 1
    )
    timestep_annealing: Literal["linear", "sqrt"] = option(
        "linear", "how the most noise falls from the first to the last step; sqrt: quickly at first"
    )
    view_text: Literal["bins", "interpolated"] = option(
        "bins", "words of the nearest named view (the paper), or embeddings mixed by azimuth"
    )
    perp_neg: float = option(
        0.0, "Perp-Neg: weight of the front view's text as a negative, growing to the back; 0: none", 0, 10
    )
    guidance_rescale: float = option(
        0.0, "how far the contrast of the guided prediction is taken back to that of the text's own", 0, 1
    )
    gradient_clip: float = option(
        0.0, "bound on the absolute gradient of every latent at the first step; 0: none", 0, 1000
    )
    gradient_clip_end: float = option(
        0.0, "that bound at the last step (linear in between); 0: as at the first", 0, 1000
    )
    predicted_clean_clamp: float = option(
        0.0, "bound on the absolute predicted clean latents; 0: none", 0, 1000
    )
    signal_power: float = option(
        0.5, "p of the weight abar^p (1 - abar); 0.5: Latent-NeRF's code, 0: DreamFusion", 0, 4
    )
    background: Literal["random", "learned"] = option(
        "random", "a random flat colour each view, or a learned one"
    )
    checkpoint_every: int = option(100, "steps between checkpoints", 1, 100_000)
    preview_every: int = option(
        0, "steps between preview images; 0: every 5 seconds, or every step if these are slower", 0, 100_000
    )
    radius: tuple[float, float] = option((1.0, 1.5), "camera distance, from and to [scene units]", 0.1, 100)
    fov_degrees: tuple[float, float] = option((40.0, 70.0), "field of view, from and to [degrees]", 1, 170)
    polar_degrees: tuple[float, float] = option(
        (0.0, 150.0), "angle from the vertical axis, from and to [degrees]", 0, 180
    )

    def __post_init__(self) -> None:
        check(self)
        for start in ("guidance_scale", "timestep_max", "gradient_clip"):
            if getattr(self, f"{start}_end") == 0:
                # frozen, but not yet given to anyone
                object.__setattr__(self, f"{start}_end", getattr(self, start))
        if self.timestep_min >= min(self.timestep_max, self.timestep_max_end):
            section = snake(type(self).__name__)
            raise InputError(
                f"{section}.timestep_min must be below timestep_max and timestep_max_end, "
                f"found {self.timestep_min} against {self.timestep_max} and {self.timestep_max_end}"
            )
        if self.gradient_clip_end > 0 and self.gradient_clip == 0:
            section = snake(type(self).__name__)
            raise InputError(
                f"{section}.gradient_clip_end is {self.gradient_clip_end}, but gradient_clip is 0: "
                "say where the bound starts"
            )
