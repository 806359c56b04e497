"""Stage `refine_paint`: RGB refinement of a painted mesh. The baked colours are trained on, in RGB.

What is trained is the change of the colours, at most as fine as the views show it; the baked texture keeps
its own detail beneath. The geometry is given, so there is nothing to fit first.

Letters: s texels along a side of the baked texture, n colours that some view reads.
"""

from __future__ import annotations

import json

import cv2
import numpy as np
import torch
from jaxtyping import Float
from PIL import Image
from torch import nn

from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.refinement import (
    picture_distillation,
    possible_gradient,
    require_encoder,
    view_size,
)
from pipeline.diffusion.sessions import vae_decoder
from pipeline.mesh.fill import continue_nearest
from pipeline.options.nerf import Refinement, refined
from pipeline.options.paint import TrainPaint
from pipeline.paint.checkpoint import decode_state, encode_state
from pipeline.paint.given_mesh import load_paint_mesh
from pipeline.paint.step import PaintState, make_pool, paint_optimizer, shown_views
from pipeline.paint.train import train
from pipeline.report.png import write_png
from pipeline.run.stage import Context, execute
from pipeline.training import checkpoints
from pipeline.training.background import FlatBackground
from pipeline.training.flat_colours import flat_colours
from pipeline.training.loop import PREVIEW, History, resume, seconds_of
from pipeline.training.nan_report import explained

_FINEST = 512
"""Texels along a side of what is trained: views of 128 pixels show no more."""
_RATE = 2e-3
"""Adam's rate: in a hundred steps a colour may change by a fifth of its range."""


def refinement_options(paint: TrainPaint, refinement: Refinement) -> TrainPaint:
    """Return the options of the steps: refinement's own, and for the rest those of the painting."""
    cameras = {name: getattr(paint, name) for name in ("radius", "fov_degrees", "polar_degrees")}
    steps = max(refinement.steps, 1)
    return refined(paint, refinement, **cameras, steps=steps, learning_rate=_RATE, background="random")


def start_colours(albedo: Float[np.ndarray, "s s 3"], side: int) -> Float[np.ndarray, "n 3"]:
    """Return the texels of a baked texture averaged down to `side` x `side`, row-major."""
    small = cv2.resize(albedo, (side, side), interpolation=cv2.INTER_AREA) if len(albedo) > side else albedo
    return np.ascontiguousarray(small.reshape(-1, 3), np.float32)


def with_change(
    albedo: Float[np.ndarray, "s s 3"], change: Float[np.ndarray, "n 3"], seen: np.ndarray, side: int
) -> Float[np.ndarray, "s s 3"]:
    """Return a texture with the change of the `seen` texels of a `side` x `side` one added; what was not seen
    changes as the nearest that was."""
    known = np.zeros(side * side, bool)
    values = np.zeros((side * side, 3), np.float32)
    known[seen], values[seen] = True, change
    spread = continue_nearest(values.reshape(side, side, 3), known.reshape(side, side))
    if len(albedo) != side:
        spread = cv2.resize(spread, albedo.shape[:2], interpolation=cv2.INTER_LINEAR)
    return np.clip(albedo + spread, 0, 1).astype(np.float32)


def main(context: Context) -> None:
    """Read the mesh, its colours, the embeddings and the networks; write the colours and their history."""
    job, inputs = context.job, context.inputs
    bundle = open_bundle(inputs["unet"].parent, verify=False)
    require_encoder(bundle, inputs)
    refinement = job.refinement
    options = refinement_options(job.train_paint, refinement)
    mesh = load_paint_mesh(inputs["mesh"]).scaled(options.mesh_radius)
    with Image.open(inputs["albedo"], formats=["PNG"]) as opened:
        albedo = np.asarray(opened.convert("RGB"), np.float32) / 255
    side = None if job.param == "face" else min(len(albedo), _FINEST)
    start = albedo[0] if side is None else start_colours(albedo, side)
    pool = make_pool(mesh, options, side, view_size(refinement, bundle), job.seed)

    def initial(seed: int) -> PaintState:
        colours, background = nn.Parameter(torch.from_numpy(start[pool.seen])), FlatBackground(flat_colours())
        rng = np.random.default_rng([seed, 3])
        return PaintState(colours, background, paint_optimizer(colours, background, options), rng)

    shown = shown_views(pool)

    def show(state: PaintState) -> None:
        colours, grey = state.colours.detach().numpy(), np.full(3, 0.5, np.float32)
        views = [view.render(colours, grey).transpose(1, 2, 0) for view in shown]
        write_png(context.scratch / PREVIEW, np.concatenate(views, axis=1))

    state, history, resumed_at, warnings = resume(
        "refine_paint",
        context.scratch,
        lambda values: decode_state(values, options, initial(0)),
        lambda: initial(job.seed),
        show,
    )
    gradient, more = possible_gradient(refinement, bundle, inputs)

    def keep(state: PaintState, history: History) -> None:
        checkpoints.write(context.scratch, state.step, encode_state(state, history))

    with (
        vae_decoder(inputs["vae_decoder"], bundle.latent_scale, job.provider) as decode,
        picture_distillation(refinement, gradient, bundle, inputs, decode, job.provider) as distillation,
        explained("refine_paint", "refinement", lambda: state.step, context.scratch),
    ):
        train(
            state,
            history,
            options,
            pool,
            distillation,
            keep=keep,
            show=show,
            stage="refine_paint",
            noise_size=bundle.latent_size,
        )

    change = state.colours.detach().numpy() - start[pool.seen]
    if side is None:
        refined = albedo.copy()
        refined[0, pool.seen] = np.clip(refined[0, pool.seen] + change, 0, 1)
    else:
        refined = with_change(albedo, change, pool.seen, side)
    write_png(context.outputs["albedo"], refined)
    context.outputs["history"].write_text(json.dumps(history, allow_nan=False) + "\n", encoding="utf-8")
    context.metrics.update(
        warnings=[*warnings, *more],
        gradient=gradient,
        steps=state.step,
        resumed_at=resumed_at,
        resolution=pool.resolution,
        change=float(np.sqrt(np.square(change).mean())),
        gradient_norm=history[-1]["gradient_norm"],
        seconds=seconds_of(history),
    )


if __name__ == "__main__":
    execute("refine_paint", main)
