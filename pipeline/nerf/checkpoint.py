"""The state of a radiance field's training as named arrays: a run resumed from them equals, bit for bit, a
run never interrupted."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.nerf import scene as scenes
from pipeline.nerf.step import State, make_optimizer
from pipeline.options.nerf import TrainNerf
from pipeline.training import checkpoints


def encode_state(state: State, history: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Return the state after `state.step` steps and the history so far."""
    progress = {
        "step": state.step,
        "converged_at": state.converged_at,
        "rng": state.rng.bit_generator.state,
        "history": history,
    }
    return {
        "progress": np.frombuffer(json.dumps(progress).encode(), np.uint8),
        **{f"scene.{name}": array for name, array in scenes.to_arrays(state.scene).items()},
        **checkpoints.adam_arrays(state.optimizer),
        **({"snapshots": np.stack(state.snapshots)} if state.snapshots else {}),
    }


def decode_state(values: Mapping[str, np.ndarray], options: TrainNerf) -> tuple[State, list[dict[str, Any]]]:
    """Return what `encode_state` took apart. Raises ValueError for arrays of anything else."""
    try:
        progress = json.loads(values["progress"].tobytes())
        scene = scenes.from_arrays(
            {n.removeprefix("scene."): v for n, v in values.items() if n.startswith("scene.")}
        )
        optimizer = make_optimizer(scene, options)
        checkpoints.restore_adam(optimizer, values)
        rng = np.random.default_rng()
        rng.bit_generator.state = progress["rng"]
        snapshots = list(values.get("snapshots", ()))
        state = State(scene, optimizer, rng, progress["step"], snapshots, progress["converged_at"])
        return state, progress["history"]
    except KeyError as error:
        raise ValueError(f"not a state of this training: {error} is missing") from None
