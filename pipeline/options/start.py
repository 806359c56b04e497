"""Options of what a training starts from: an asset instead of nothing (with START)."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from pipeline.errors import InputError
from pipeline.options.nerf import TrainNerf
from pipeline.options.paint import TrainPaint
from pipeline.options.schema import check, option

FIELDS = ("field_rgb.npz", "field.npz")
"""What a run that made its shape can be gone on from: the last of its fields."""
T = TypeVar("T", TrainNerf, TrainPaint)


@dataclass(frozen=True)
class StartFit:
    """The fit to encoded views of what START names, before training."""

    views: int = option(48, "views encoded and fitted to", 4, 1024)
    steps: int = option(200, "steps of the fit (a MESH: none, its colours are solved for)", 1, 100_000)
    radius: float = option(
        0.75, "a mesh is scaled into a ball of this radius round the centre [scene units]", 0.1, 0.95
    )
    updates_per_call: int = option(
        0, "optimiser steps a call when training goes on; 0: those of train_nerf, of MODEL=a,b 6", 0, 64
    )
    cells: int = option(96, "cells along a side of the box, for the winding number of a mesh", 8, 256)

    def __post_init__(self) -> None:
        check(self)


def set_out(training: T, strength: float) -> T:
    """Return a training that sets out from the noise level `strength` of its schedule, as image-to-image
    does.

    Its most noise is that share of the way from the least to the most, and its steps are that share of all:
    those that would have gone to higher levels are left out.
    """
    low = training.timestep_min
    level = low + strength * (training.timestep_max - low)
    return replace(
        training,
        steps=max(1, round(strength * training.steps)),
        timestep_max=level,
        timestep_max_end=min(level, training.timestep_max_end),
    )


def started(training: TrainNerf, fit: StartFit, strength: float) -> TrainNerf:
    """Return the options of a field's training that goes on from a start."""
    updates = fit.updates_per_call or training.updates_per_call
    return replace(set_out(training, strength), updates_per_call=updates)


def lasting(given: str) -> str:
    """Return a path that the user gave without the links in it: `runs/latest` will point to another run, the
    very one that starts from it."""
    path = Path(given)
    for place in (path, *path.parents):
        if place.is_symlink():
            return lasting(str(place.parent / os.readlink(place) / path.relative_to(place)))
    return given


def check_start(start: str) -> None:
    """Raise InputError unless START names a mesh file or the folder of a run that can be gone on from."""
    path = Path(start)
    if path.is_file():
        return
    if not path.is_dir():
        raise InputError(
            f"START {start!r} does not exist: give the folder of a run, such as runs/latest, or a textured "
            "mesh"
        )
    if not any((path / name).is_file() for name in (*FIELDS, "mesh.npz")):
        raise InputError(
            f"START {start!r} is no run that has got as far as its shape (no field.npz, no mesh.npz): give "
            "the folder of a finished run, or a textured mesh"
        )
