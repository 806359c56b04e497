"""Stage `start_paint`: the colours of what START names, in latents, on the mesh that is to be painted."""

from __future__ import annotations

import numpy as np

from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.refinement import require_encoder
from pipeline.diffusion.sessions import vae_encoder
from pipeline.diffusion.view_gradient import load_embeddings
from pipeline.errors import InputError
from pipeline.paint.given_mesh import load_paint_mesh
from pipeline.paint.start import mesh_pictures, solve_colours, start_mesh
from pipeline.paint.step import make_pool
from pipeline.paint.surface_latents import Painted, complete, save_painted
from pipeline.run.stage import Context, Progress, execute
from pipeline.run.start_files import spent_before
from pipeline.training.encoded import Backdrops, encode_groups


def main(context: Context) -> None:
    """Read the mesh, what START names, the embeddings and the encoder; write latents of texels or faces."""
    job, inputs, options = context.job, context.inputs, context.job.train_paint
    bundle = open_bundle(inputs["vae_decoder"].parent, verify=False)
    require_encoder(bundle, inputs, "START")
    embeddings = load_embeddings(inputs["embeddings"])
    if embeddings.backgrounds is None or embeddings.background_rgb is None:
        raise InputError(f"{inputs['embeddings']} holds no backgrounds: delete it and run again")
    mesh = load_paint_mesh(inputs["mesh"]).scaled(options.mesh_radius)
    source = start_mesh(inputs, job.prepare, options.mesh_radius)
    side = options.texture if job.param == "texture" else None
    pool = make_pool(mesh, options, side, bundle.latent_size, job.seed)
    groups = pool.groups[: -(-job.start_fit.views // options.cameras_per_step)]
    rng = np.random.default_rng([job.seed, 5])
    backdrops = Backdrops(embeddings.backgrounds, embeddings.background_rgb)
    with (
        vae_encoder(inputs["vae_encoder"], bundle.latent_scale, job.provider) as encode,
        Progress("start_paint", sum(len(group[0]) for group in groups), "views encoded") as progress,
    ):
        known = encode_groups(
            groups, mesh_pictures(source), encode, backdrops, bundle.image_size, rng, progress.update
        )
    before = spent_before(inputs["start_mesh"]) if "start_mesh" in inputs else []
    latents, metrics = complete(mesh, pool.seen, solve_colours(pool, known), side)
    save_painted(context.outputs["painted"], Painted(latents, side, options.mesh_radius))
    context.metrics.update(before=before, views=sum(len(group.latents) for group in known), **metrics)


if __name__ == "__main__":
    execute("start_paint", main)
