"""Checkpoints of a training run on disk: the last two, each whole or not there at all.

A checkpoint is one file, `<step>.checkpoint`: a line with the sha256 of the rest, then named arrays. It
is written beside, synced and renamed, and the folder synced. Reading takes the newest one whose checksum
holds.
"""

import hashlib
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch

from pipeline import arrays, files
from pipeline.training.adam import Adam

T = TypeVar("T")
_KEPT = 2
_MOMENTS = ("step", "exp_avg", "exp_avg_sq")


def write(folder: Path, step: int, values: Mapping[str, np.ndarray]) -> None:
    """Write the state after `step` steps; drop all but the last two files."""
    payload = arrays.pack(values)
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / f".partial{os.getpid()}"
    try:
        with files.create(partial) as stream:
            stream.write(hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload)
        files.publish([(partial, folder / f"{step:08d}.checkpoint")])
    finally:
        partial.unlink(missing_ok=True)
    for old in _newest_first(folder)[_KEPT:]:
        old.unlink()


def read_newest(folder: Path, decode: Callable[[dict[str, np.ndarray]], T]) -> tuple[T | None, list[str]]:
    """Return the newest state that is whole (None: there is none) and the names of the files passed over.

    `decode` makes a state of named arrays, or raises ValueError.
    """
    damaged: list[str] = []
    for path in _newest_first(folder):
        try:
            digest, _, payload = path.read_bytes().partition(b"\n")
            if hashlib.sha256(payload).hexdigest().encode() != digest:
                raise ValueError(f"{path} does not match its checksum")
            return decode(arrays.unpack(payload)), damaged
        except ValueError:
            damaged.append(path.name)
    return None, damaged


def newest(folder: Path) -> Path | None:
    """Return the file of the latest state, unread; None: there is none."""
    return next(iter(_newest_first(folder)), None)


def adam_arrays(optimizer: Adam) -> dict[str, np.ndarray]:
    """Return the moments and step counts of every parameter that has any, as `adam.<row>.<name>`."""
    return {
        f"adam.{i}.{key}": optimizer.state[p][key].numpy()
        for i, p in enumerate(optimizer.parameters)
        if p in optimizer.state
        for key in _MOMENTS
    }


def restore_adam(optimizer: Adam, values: Mapping[str, np.ndarray]) -> None:
    """Put back what `adam_arrays` took."""
    for i, parameter in enumerate(optimizer.parameters):
        if f"adam.{i}.step" in values:
            optimizer.state[parameter] = {
                key: torch.from_numpy(values[f"adam.{i}.{key}"].copy()) for key in _MOMENTS
            }


def _newest_first(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.checkpoint"), reverse=True)
