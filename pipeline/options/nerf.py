"""Options of a text's own shape: the latent field, and the sketch that may guide it."""

from dataclasses import dataclass, fields, replace
from typing import Any, Literal, TypeVar

from pipeline.errors import InputError
from pipeline.options.distillation import Distillation
from pipeline.options.schema import check, option


@dataclass(frozen=True)
class TrainNerf(Distillation):
    """Latent-NeRF: score distillation of a radiance field in latent space."""

    steps: int = option(100, "steps: calls of the denoiser", 1, 100_000)
    samples_per_ray: int = option(64, "samples along a ray through the whole box", 8, 1024)
    learning_rate: float = option(1e-3, "Adam's rate for the small network", 1e-7, 1)
    grid_learning_rate: float = option(1e-2, "Adam's rate for the hash grid", 1e-7, 1)
    # The paper's 5e-4 acted through a gradient scaler that the distillation bypassed: 33 in effect. On
    # an ideal denoiser of a known scene 3 costs 0.15 dB and 30 costs 3.4 dB; below 1 it does not act.
    sparsity_weight: float = option(1.0, "weight of the binary entropy of every ray's opacity", 0, 1e6)
    sparsity_ramp: float = option(
        0.0, "share of the run over which that weight grows from 0; 0: constant, as in the paper", 0, 1
    )
    opacity_weight: float = option(0.0, "weight of the mean opacity", 0, 1e6)
    emptiness_weight: float = option(
        100.0, "weight of the optical thickness of the box where rendering takes it to be empty", 0, 1e6
    )
    # A draft of a house at SIGMA_S 0.05: agreement with the sketch 0.64 at weight 0, 0.61 at 1, 0.75 at 10,
    # 0.86 at 100, 0.95 at 1000; at SIGMA_S 0.3, 0.72 at 100 and 0.82 at 1000.
    shape_weight: float = option(1000.0, "weight of the sketch's shape loss (with SKETCH)", 0, 1e6)
    sigma_s: float = option(
        0.3, "SIGMA_S: how far from the sketch's surface the shape is free [scene units]", 0.01, 10
    )
    shape_start: int = option(
        100, "steps that grow the sketch before the first view; 0: start from nothing", 0, 10_000
    )
    # The paper's code starts from density 1 everywhere (bias 0, blob 5), and its first occupancy grid cuts
    # that fog off; rendered as it is, fog grows and fills the box. -4 starts without any.
    density_bias: float = option(
        -4.0, "log density [1 / scene unit] far from the centre at the start", -15, 15
    )
    blob_density: float = option(7.0, "height of the bump of the log density at the centre", 0, 1000)
    blob_radius: float = option(0.2, "standard deviation of that bump [scene units]", 1e-3, 10)
    grid_levels: int = option(16, "levels of the hash grid", 1, 24)
    grid_finest: int = option(512, "cells along a side of the box at the finest level", 16, 8192)
    grid_table_log2: int = option(16, "log2 of the most table entries of a level", 8, 22)
    # What counts is updates: 100 calls of 4 are as good as 200 of 2 (`make bench ONLY=distillation`).
    updates_per_call: int = option(
        4, "optimiser steps that go towards what one call of the denoiser asked for", 1, 64
    )
    # Six ideal trainings (`ONLY=oracle`), cooled once they drift less than 1.6, end with no error more than
    # 4 % larger than after all of their steps, most with smaller ones.
    convergence: float = option(
        1.6,
        "training ends, after half of its steps at the earliest, once the scene drifts less than so many "
        "times its own noise: 100 steps at falling rates take the place of the rest; 0: never",
        0,
        10,
    )
    density_sharpening: float = option(
        1.0, "density multiplier at the end (geometric ramp over the second half)", 1, 1000
    )


@dataclass(frozen=True)
class Refinement(Distillation):
    """RGB refinement (with REFINE=1); sampling, losses and rates but for these are those of train_nerf."""

    fit_steps: int = option(
        60, "steps that fit the RGB field to decoded views of the latent one, before distillation", 0, 100_000
    )
    steps: int = option(120, "steps of score distillation in RGB", 0, 100_000)
    updates_per_call: int = option(2, "as train_nerf's, of refinement", 1, 64)
    resolution: int = option(
        0, "side of a rendered view [pixels]; 0: half the bundle's image size, at most 128", 0, 1024
    )
    gradient: Literal["encoder", "image"] = option(
        "encoder",
        "how a picture is told what to become: through the VAE encoder's gradient (where the bundle has "
        "vae_encoder_vjp), or by the picture decoded from the denoised latents",
    )
    learning_rate: float = option(
        1e-3,
        "Adam's rate for the small network and the linear layer (colours on a MESH: 0.002, fixed)",
        1e-7,
        1,
    )
    grid_learning_rate: float = option(5e-3, "Adam's rate for the hash grid", 1e-7, 1)
    shading: float = option(0.0, "share of the steps that see the object lit from a random side", 0, 1)
    ambient: float = option(0.5, "light that comes from everywhere in these steps", 0, 1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fit_steps + self.steps == 0:
            raise InputError("refinement.fit_steps and refinement.steps are 0: expected a step, or REFINE=0")


T = TypeVar("T", bound=Distillation)


def refined(training: T, refinement: Refinement, **others: Any) -> T:
    """Return the options of a training with refinement's in place of those that both have, and `others`."""
    shared = {spec.name for spec in fields(Refinement)} & {spec.name for spec in fields(training)}
    return replace(training, **{name: getattr(refinement, name) for name in shared} | others)


@dataclass(frozen=True)
class Contest:
    """Several seeds begin, the best one goes on (with SEEDS)."""

    share: float = option(0.35, "of the training's steps that every seed takes before it is judged", 0.01, 1)
    views: int = option(8, "views that a scene is judged by", 4, 64)

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class SketchField:
    """The sketch in the scene (with SKETCH)."""

    cells: int = option(64, "cells along a side of the box, for winding number and distance", 8, 256)
    radius: float = option(
        0.75, "the sketch is scaled into a ball of this radius round the centre [scene units]", 0.1, 0.95
    )
    thickness: float = option(0.3, "of a traced drawing, as a share of its longer side", 0.02, 2)

    def __post_init__(self) -> None:
        check(self)
