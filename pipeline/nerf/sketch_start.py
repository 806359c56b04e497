"""The first state of a sketched scene: the sketch itself, in no particular colour.

Without it the first third of a short run would see haze: density grows slowly from nothing, and distillation
has nothing to say about haze. Growing it takes no picture and no denoiser.
"""

import numpy as np
import torch
from jaxtyping import Float

from pipeline.nerf.field import LatentField
from pipeline.nerf.sketch_loss import shape_loss
from pipeline.sketch.lattice import Sketch
from pipeline.training.adam import Adam
from pipeline.training.backward import backward

_POINTS = 8192
"""A step's points."""


def grow(field: LatentField, optimizer: Adam, sketch: Sketch, rng: np.random.Generator, steps: int) -> None:
    """Take optimiser steps towards the density of the sketch, at random points anywhere and inside it."""
    inside = np.argwhere(sketch.winding > 0.5)
    for _ in range(steps):
        points = torch.from_numpy(draw_points(inside, sketch.cell, rng))
        segment = field.evaluate(points)
        density, _ = field.attach([segment])
        _, gradient = shape_loss(sketch, sketch.cell / 2, points.numpy(), density.detach().numpy())
        optimizer.clear_gradients()
        backward([density], [torch.from_numpy(gradient)])
        optimizer.step()


def draw_points(inside: np.ndarray, cell: float, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """Return half of the points uniform in the box and half near lattice points `inside` (m, 3), float32."""
    anywhere = rng.uniform(-1, 1, (_POINTS // 2, 3))
    chosen = inside[rng.integers(len(inside), size=_POINTS - len(anywhere))]
    near = (chosen + rng.uniform(-0.5, 0.5, chosen.shape)) * cell - 1
    return np.concatenate([anywhere, near]).clip(-1, 1).astype(np.float32)
