"""Stage `start`: what START names, as a scene in the latents of this model, for training to go on from.

The field of a run made with the same latents is taken as it is. Other fields, and meshes, are fitted to their
views, each encoded once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack

import numpy as np
from jaxtyping import Float

from pipeline.cameras import Camera
from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.diffusion.decoding import view_resolution
from pipeline.diffusion.refinement import require_encoder
from pipeline.diffusion.rgb_gradients import LATENT_TO_RGB, enlarge
from pipeline.diffusion.sessions import Decode, vae_decoder, vae_encoder
from pipeline.diffusion.view_gradient import Embeddings, flat_backgrounds, load_embeddings
from pipeline.errors import InputError
from pipeline.files import path_sha256
from pipeline.mesh.baking import decibels
from pipeline.mesh.silhouettes import opacity_masks
from pipeline.nerf.checkpoint import decode_state, encode_state
from pipeline.nerf.refining import render_rgb
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import Scene, load_scene, save_scene
from pipeline.nerf.start import (
    fit_options,
    fit_state,
    fit_step,
    linear_map,
    mesh_state,
    scene_in_other_latents,
    settled,
    view_groups,
)
from pipeline.nerf.step import State
from pipeline.nerf.train import preview_cameras
from pipeline.nerf.views import decoded_views
from pipeline.options.nerf import TrainNerf
from pipeline.paint.start import mesh_pictures, start_mesh
from pipeline.report.latents import latent_preview
from pipeline.report.png import write_png
from pipeline.run.stage import Context, Progress, execute
from pipeline.run.start_files import spent_before
from pipeline.sketch.lattice import Sketch
from pipeline.sketch.winding import orient_outwards, tabulate
from pipeline.training import checkpoints
from pipeline.training.encoded import Backdrops, KnownViews, Pictures, encode_groups
from pipeline.training.loop import PREVIEW, History, resume, take_steps
from pipeline.training.nan_report import explained

_ZEROS = np.zeros(4, np.float32)


def rgb_map(bundle: Bundle) -> tuple[Float[np.ndarray, "3 4"], Float[np.ndarray, " 3"]]:
    """Return the linear map of a bundle's latents to RGB in [0, 1]: its own, else the paper's."""
    matrix = np.array(LATENT_TO_RGB if bundle.latent_to_rgb is None else bundle.latent_to_rgb)
    return matrix / 2, (np.array(bundle.latent_to_rgb_bias) + 1) / 2


def scene_pictures(scene: Scene, resolution: int, decode: Decode) -> Pictures:
    """Return what cameras see of a scene: of a latent one, what its decoder makes of latents."""

    def pictures(
        cameras: Sequence[Camera], size: int
    ) -> tuple[Float[np.ndarray, "b s s 3"], Float[np.ndarray, "b s s"]]:
        if scene.rgb is not None:
            colours, opacity = render_rgb(scene, cameras, size)
            return colours.transpose(0, 2, 3, 1).clip(0, 1), opacity
        decoded = np.stack(decoded_views(scene, cameras, resolution, decode)).transpose(0, 3, 1, 2)
        opacity = render_views(scene, cameras, size, _ZEROS).opacity
        shown = enlarge(np.ascontiguousarray(decoded), size)[0].transpose(0, 2, 3, 1)
        return shown * opacity[..., None], opacity

    return pictures


def likeness(
    scene: Scene, pictures: Pictures, cameras: list[Camera], bundle: Bundle, decode: Decode
) -> float:
    """Return the PSNR [dB] of a latent scene's decoded views against what the start shows, where that is
    opaque."""
    wanted, opacity = pictures(cameras, bundle.image_size)
    found = np.stack(decoded_views(scene, cameras, bundle.latent_size, decode))
    mask, _ = opacity_masks(opacity)
    solid = (wanted / np.maximum(opacity, 0.05)[..., None]).clip(0, 1)
    squared = np.square(found - solid).mean(-1)[mask]
    return decibels(float(squared.mean())) if squared.size else 0.0


def first_state(
    source: Scene | Sketch,
    own: Bundle,
    other: Bundle | None,
    embeddings: Embeddings,
    options: TrainNerf,
    seed: int,
) -> State:
    """Return the state before the first step of the fit."""
    backgrounds = flat_backgrounds(embeddings)
    if isinstance(source, Sketch):
        return mesh_state(source, backgrounds, options, seed)
    matrix, bias = rgb_map(own)
    if source.rgb is not None:
        theirs, their_bias = (p.detach().numpy() for p in (source.rgb.matrix, source.rgb.bias))
    else:
        assert other is not None
        theirs, their_bias = rgb_map(other)
    change = linear_map(theirs, matrix)
    offset = np.linalg.pinv(matrix) @ (their_bias - bias)
    return fit_state(scene_in_other_latents(source, change, offset, backgrounds, options), options, seed)


def main(context: Context) -> None:
    """Read what START names, the embeddings and the autoencoder; write the scene."""
    job, inputs = context.job, context.inputs
    own = open_bundle(inputs["vae_decoder"].parent, verify=False)
    scene = load_scene(inputs["start_scene"]) if "start_scene" in inputs else None
    same = scene is not None and path_sha256(inputs["start_decoder"]) == path_sha256(inputs["vae_decoder"])
    given = inputs.get("start_scene") or inputs.get("start_mesh")
    context.metrics.update(
        before=spent_before(given) if given else [],
        warnings=[],
        fitted=not same or scene is None or scene.rgb is not None,
    )
    if scene is not None and not context.metrics["fitted"]:
        save_scene(context.outputs["scene"], scene)
        return
    require_encoder(own, inputs, "START")
    embeddings = load_embeddings(inputs["embeddings"])
    if embeddings.backgrounds is None or embeddings.background_rgb is None:
        raise InputError(f"{inputs['embeddings']} holds no backgrounds: delete it and run again")
    options = fit_options(job.train_nerf, job.start_fit.steps)
    cameras = preview_cameras(options)

    source: Scene | Sketch
    with ExitStack() as stack:
        other, sketch = None, None
        if scene is None:
            mesh = start_mesh(inputs, job.prepare, job.start_fit.radius)
            faces = orient_outwards(mesh.vertices, mesh.faces)
            sketch = tabulate(
                mesh.vertices,
                faces,
                job.start_fit.cells,
                str(inputs.get("start_file") or inputs["start_mesh"]),
            )
            pictures = mesh_pictures(mesh)
            source = sketch
        else:
            other = open_bundle(inputs["start_decoder"].parent, verify=False)
            resolution = view_resolution(inputs.get("start_description"))
            decoder = vae_decoder(inputs["start_decoder"], other.latent_scale, job.provider)
            pictures = scene_pictures(scene, resolution, stack.enter_context(decoder))
            source = scene

        def show(state: State) -> None:
            views = render_views(state.scene, cameras, own.latent_size)
            write_png(context.scratch / PREVIEW, latent_preview(views.latents, views.opacity, own))

        state, history, resumed_at, warnings = resume(
            "start",
            context.scratch,
            lambda values: decode_state(values, options),
            lambda: first_state(source, own, other, embeddings, options, job.seed),
            show,
        )
        rng = np.random.default_rng([job.seed, 5])
        groups = view_groups(options, job.start_fit.views, rng)
        backdrops = Backdrops(embeddings.backgrounds, embeddings.background_rgb)
        with (
            vae_encoder(inputs["vae_encoder"], own.latent_scale, job.provider) as encode,
            Progress("start", sum(len(group[0]) for group in groups), "views encoded") as progress,
        ):
            known = encode_groups(groups, pictures, encode, backdrops, own.image_size, rng, progress.update)
        _fit(context, state, history, options, KnownViews(known), sketch, own.latent_size, show)
        found = settled(state)
        save_scene(context.outputs["scene"], found)
        with vae_decoder(inputs["vae_decoder"], own.latent_scale, job.provider) as decode:
            psnr = likeness(found, pictures, cameras, own, decode)
    context.metrics.update(
        warnings=warnings,
        resumed_at=resumed_at,
        steps=state.step,
        views=len(groups) * len(groups[0][0]),
        psnr=psnr,
    )


def _fit(
    context: Context,
    state: State,
    history: History,
    options: TrainNerf,
    known: KnownViews,
    sketch: Sketch | None,
    size: int,
    show: Callable[[State], None],
) -> None:
    """Take the steps that are left."""
    with explained("start", "train_nerf", lambda: state.step, context.scratch):
        take_steps(
            "start",
            state,
            history,
            options,
            lambda state: fit_step(state, options, known, sketch, size),
            keep=lambda state, history: checkpoints.write(
                context.scratch, state.step, encode_state(state, history)
            ),
            show=show,
        )


if __name__ == "__main__":
    execute("start", main)
