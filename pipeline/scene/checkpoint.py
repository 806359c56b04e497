"""Checkpoints of a training run: a run resumed from one equals, bit for bit, a run never interrupted.

A checkpoint is one file, `<step>.checkpoint`: a line with the sha256 of the rest, then named arrays. It
appears whole or not at all (written beside, synced, renamed, the folder synced). The last two are kept;
reading takes the newest one whose checksum holds.
"""

import hashlib
import json
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from pipeline import arrays, files
from pipeline.job import TrainNerf
from pipeline.scene import scene as scenes
from pipeline.scene.training import State, make_optimizer

_KEPT = 2
_MOMENTS = ("step", "exp_avg", "exp_avg_sq")


def save(folder: Path, state: State, history: list[dict[str, Any]]) -> None:
    """Write the state after `state.step` steps and the history so far; drop all but the last two files."""
    progress = {"step": state.step, "rng": state.rng.bit_generator.state, "history": history}
    payload = arrays.pack(
        {
            "progress": np.frombuffer(json.dumps(progress).encode(), np.uint8),
            **{f"scene.{name}": array for name, array in scenes.to_arrays(state.scene).items()},
            **{
                f"adam.{i}.{key}": values[key].numpy()
                for i, values in _moments(state.optimizer)
                for key in _MOMENTS
            },
        }
    )
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / f".partial{os.getpid()}"
    try:
        partial.write_bytes(hashlib.sha256(payload).hexdigest().encode() + b"\n" + payload)
        files.publish([(partial, folder / f"{state.step:08d}.checkpoint")])
    finally:
        partial.unlink(missing_ok=True)
    for old in _newest_first(folder)[_KEPT:]:
        old.unlink()


class Found(NamedTuple):
    """What a folder of checkpoints has to offer."""

    state: State | None
    """The newest whole state; None: there is none."""
    history: list[dict[str, Any]]
    damaged: list[str]
    """Names of the newer files that were passed over."""


def load(folder: Path, options: TrainNerf) -> Found:
    """Return the newest state whose checksum holds."""
    damaged: list[str] = []
    for path in _newest_first(folder):
        try:
            return Found(*_read(path, options), damaged)
        except ValueError:
            damaged.append(path.name)
    return Found(None, [], damaged)


def _newest_first(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.checkpoint"), reverse=True)


def _read(path: Path, options: TrainNerf) -> tuple[State, list[dict[str, Any]]]:
    """Raises ValueError: the file is truncated or changed."""
    digest, _, payload = path.read_bytes().partition(b"\n")
    if hashlib.sha256(payload).hexdigest().encode() != digest:
        raise ValueError(f"{path} does not match its checksum")
    values = arrays.unpack(payload)
    progress = json.loads(values["progress"].tobytes())
    scene = scenes.from_arrays(
        {n.removeprefix("scene."): v for n, v in values.items() if n.startswith("scene.")}
    )
    optimizer = make_optimizer(scene, options)
    parameters = [p for group in optimizer.param_groups for p in group["params"]]
    for i, parameter in enumerate(parameters):
        if f"adam.{i}.step" in values:
            optimizer.state[parameter] = {
                key: torch.from_numpy(values[f"adam.{i}.{key}"].copy()) for key in _MOMENTS
            }
    rng = np.random.default_rng()
    rng.bit_generator.state = progress["rng"]
    return State(scene, optimizer, rng, progress["step"]), progress["history"]


def _moments(optimizer: torch.optim.Adam) -> list[tuple[int, dict[str, torch.Tensor]]]:
    parameters = [p for group in optimizer.param_groups for p in group["params"]]
    return [(i, optimizer.state[p]) for i, p in enumerate(parameters) if p in optimizer.state]
