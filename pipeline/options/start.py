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


def started(training: T, has_start: bool, strength: float) -> T:
    """Return the options that a training goes by: `set_out` if it has a start."""
    return set_out(training, strength) if has_start else training


def lasting(start: str) -> str:
    """Return the path that START names, without a link at its end: `runs/latest` will point to another run,
    the very one that starts from it."""
    path = Path(start)
    return str(path.parent / os.readlink(path)) if path.is_symlink() else start


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
