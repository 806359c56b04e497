"""Checkpoints of a radiance field's training: a run resumed from one equals, bit for bit, a run never
interrupted."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pipeline import checkpoint_files
from pipeline.nerf_options import TrainNerf
from pipeline.scene import scene as scenes
from pipeline.scene.training import State, make_optimizer


def save(folder: Path, state: State, history: list[dict[str, Any]]) -> None:
    """Write the state after `state.step` steps and the history so far; drop all but the last two files."""
    progress = {
        "step": state.step,
        "rest_at": state.rest_at,
        "rng": state.rng.bit_generator.state,
        "history": history,
    }
    values = {
        "progress": np.frombuffer(json.dumps(progress).encode(), np.uint8),
        **{f"scene.{name}": array for name, array in scenes.to_arrays(state.scene).items()},
        **checkpoint_files.adam_arrays(state.optimizer),
        **({"looks": np.stack(state.looks)} if state.looks else {}),
    }
    checkpoint_files.write(folder, state.step, values)


class Found(NamedTuple):
    """What a folder of checkpoints has to offer."""

    state: State | None
    """The newest whole state; None: there is none."""
    history: list[dict[str, Any]]
    damaged: list[str]
    """Names of the newer files that were passed over."""


def load(folder: Path, options: TrainNerf) -> Found:
    """Return the newest state whose checksum holds."""
    found, damaged = checkpoint_files.read_newest(folder, lambda values: _decode(values, options))
    state, history = found or (None, [])
    return Found(state, history, damaged)


def _decode(values: Mapping[str, np.ndarray], options: TrainNerf) -> tuple[State, list[dict[str, Any]]]:
    progress = json.loads(values["progress"].tobytes())
    scene = scenes.from_arrays(
        {n.removeprefix("scene."): v for n, v in values.items() if n.startswith("scene.")}
    )
    optimizer = make_optimizer(scene, options)
    checkpoint_files.restore_adam(optimizer, values)
    rng = np.random.default_rng()
    rng.bit_generator.state = progress["rng"]
    looks = list(values.get("looks", ()))
    state = State(scene, optimizer, rng, progress["step"], looks, progress["rest_at"])
    return state, progress["history"]
