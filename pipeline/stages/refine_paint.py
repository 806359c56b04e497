"""Stage `refine_paint`: RGB refinement of a painted mesh. The baked colours are trained on, in RGB.

What is trained is the change of the colours, at most as fine as the views show it; the baked texture keeps
its own detail beneath. The geometry is given, so there is nothing to fit first.

Letters: s texels along a side of the baked texture, n colours that some view reads.
"""

from __future__ import annotations

import json
from dataclasses import fields, replace
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Float
from PIL import Image
from torch import nn

from pipeline import checkpoint_files
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.sessions import vae_decoder
from pipeline.divergence import explained
from pipeline.errors import InputError
from pipeline.nerf_options import Refinement
from pipeline.paint_options import TrainPaint
from pipeline.scene.background import FlatBackground
from pipeline.scene.flat_colours import flat_colours
from pipeline.scene.paint_mesh import load_paint_mesh
from pipeline.scene.painted import extend
from pipeline.scene.painting import PaintState, make_pool, paint_optimizer
from pipeline.stage import Context, execute, say
from pipeline.stages.refine import rgb_guidance, view_size
from pipeline.stages.train_paint import History, decode_state, encode_state, train

_FINEST = 512
"""Texels along a side of what is trained: views of 128 pixels show no more."""
_RATE = 2e-3
"""Adam's rate: in a hundred steps a colour may change by a fifth of its range."""


def refinement_options(paint: TrainPaint, refinement: Refinement) -> TrainPaint:
    """Return the options of the steps: refinement's own, and for the rest those of the painting."""
    given = {spec.name for spec in fields(Refinement)} & {spec.name for spec in fields(TrainPaint)}
    own = {name: getattr(refinement, name) for name in given} | {"learning_rate": _RATE}
    cameras = {name: getattr(paint, name) for name in ("radius", "fov_degrees", "polar_degrees")}
    return replace(paint, **(own | cameras | {"steps": max(refinement.steps, 1), "background": "random"}))


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
    spread = extend(values.reshape(side, side, 3), known.reshape(side, side))
    if len(albedo) != side:
        spread = cv2.resize(spread, albedo.shape[:2], interpolation=cv2.INTER_LINEAR)
    return np.clip(albedo + spread, 0, 1).astype(np.float32)


def main(context: Context) -> None:
    job, inputs = context.job, context.inputs
    bundle = open_bundle(inputs["unet"].parent, verify=False)
    if "vae_encoder" not in inputs:
        raise InputError(
            f"MODEL {bundle.name} has no vae_encoder, which RGB refinement needs: export the model with it, "
            "or leave REFINE out"
        )
    options = refinement_options(job.train_paint, job.refinement)
    mesh = load_paint_mesh(inputs["mesh"]).scaled(options.mesh_radius)
    with Image.open(inputs["albedo"], formats=["PNG"]) as opened:
        albedo = np.asarray(opened.convert("RGB"), np.float32) / 255
    by_face = job.param == "face"
    side = None if by_face else min(len(albedo), _FINEST)
    start = albedo[0] if side is None else start_colours(albedo, side)
    pool = make_pool(mesh, options, side, view_size(job, bundle), job.seed)

    def initial(seed: int) -> PaintState:
        colours, background = nn.Parameter(torch.from_numpy(start[pool.seen])), FlatBackground(flat_colours())
        rng = np.random.default_rng([seed, 3])
        return PaintState(colours, background, paint_optimizer(colours, background, options), rng)

    warnings: list[str] = context.metrics.setdefault("warnings", [])
    found, damaged = checkpoint_files.read_newest(
        context.scratch, lambda values: decode_state(values, options, initial(0))
    )
    state, history = found or (initial(job.seed), [])
    if found:
        say(f"refine_paint: continues after step {state.step}")
    warnings += [f"{name} was damaged: trained again from step {state.step}" for name in damaged]
    resumed_at = state.step

    def keep(state: PaintState, history: History) -> None:
        checkpoint_files.write(context.scratch, state.step, encode_state(state, history))

    with (
        vae_decoder(inputs["vae_decoder"], bundle.latent_scale, job.provider) as decode,
        rgb_guidance(context, bundle, decode) as guidance,
        explained("refine_paint", "refinement", lambda: state.step, context.scratch),
    ):
        train(
            state, history, options, pool, guidance, keep, name="refine_paint", noise_size=bundle.latent_size
        )

    change = state.colours.detach().numpy() - start[pool.seen]
    if side is None:
        refined = albedo.copy()
        refined[0, pool.seen] = np.clip(refined[0, pool.seen] + change, 0, 1)
    else:
        refined = with_change(albedo, change, pool.seen, side)
    picture = Image.fromarray(np.round(refined * 255).astype(np.uint8))
    picture.save(context.outputs["albedo"], format="PNG")
    context.outputs["history"].write_text(json.dumps(history, allow_nan=False) + "\n", encoding="utf-8")
    figures: dict[str, Any] = {
        part: round(sum(row["seconds"][part] for row in history), 3) for part in history[0]["seconds"]
    }
    context.metrics.update(
        steps=state.step,
        resumed_at=resumed_at,
        resolution=pool.resolution,
        change=float(np.sqrt(np.square(change).mean())),
        gradient_norm=history[-1]["gradient_norm"],
        seconds=figures,
    )


if __name__ == "__main__":
    execute("refine_paint", main)
