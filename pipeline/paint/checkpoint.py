"""The state of a painting as named arrays: a run resumed from them equals, bit for bit, a run never
interrupted."""

import json
from collections.abc import Mapping

import numpy as np
import torch
from torch import nn

from pipeline.options.paint import TrainPaint
from pipeline.paint.step import PaintState, paint_optimizer
from pipeline.training import checkpoints
from pipeline.training.loop import History


def encode_state(state: PaintState, history: History) -> dict[str, np.ndarray]:
    """Return everything a resumed run needs."""
    progress = {"step": state.step, "rng": state.rng.bit_generator.state, "history": history}
    return {
        "progress": np.frombuffer(json.dumps(progress).encode(), np.uint8),
        "colours": state.colours.detach().numpy(),
        **{f"background.{name}": value.numpy() for name, value in state.background.state_dict().items()},
        **checkpoints.adam_arrays(state.optimizer),
    }


def decode_state(
    values: Mapping[str, np.ndarray], options: TrainPaint, state: PaintState
) -> tuple[PaintState, History]:
    """Return what `encode_state` took apart, put into `state`, an initial one of the same options.

    Raises ValueError if it belongs to other options.
    """
    try:
        progress = json.loads(values["progress"].tobytes())
        saved = {
            name.removeprefix("background."): torch.from_numpy(value.copy())
            for name, value in values.items()
            if name.startswith("background.")
        }
        state.background.load_state_dict(saved)
        if values["colours"].shape != tuple(state.colours.shape):
            raise ValueError("another number of colours")
    except (KeyError, RuntimeError) as error:
        raise ValueError(f"not a state of this training: {error}") from None
    state.colours = nn.Parameter(torch.from_numpy(values["colours"].copy()))
    state.optimizer = paint_optimizer(state.colours, state.background, options)
    checkpoints.restore_adam(state.optimizer, values)
    state.rng.bit_generator.state = progress["rng"]
    state.step = progress["step"]
    return state, progress["history"]
