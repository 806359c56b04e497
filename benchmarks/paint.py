"""Latent-Paint on real meshes: two ways from latents to colours, the files' coordinates and new ones.

Every mesh is painted with the default bundle; its latents are then decoded as an atlas (the paper) and as
views projected back. `psnr` compares renderings of the texture with decoded views that took no part in the
baking; `seam_error` is the colour jump across chart borders (root mean square, colours in [0, 1]).
`paint.png` shows, a row a mesh, a decoded view, that of the projected texture, and that of the decoded atlas.

Meshes come from what is installed: Debian's sweethome3d-furniture, and the Python packages pybullet and
genesis-world where they are found; others are left out and named in `missing`.
STEPS=60 unless said otherwise.
"""

import dataclasses
import importlib.util
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from export.everyday_objects.data.catalogue import read_catalogue
from pipeline.cameras import ring
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.conditions import conditions_of
from pipeline.diffusion.prompts import view_texts
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import Decode, denoiser, text_encoder, vae_decoder, vae_encoder
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.diffusion.view_gradient import Embeddings, distillation_gradient, flat_backgrounds
from pipeline.mesh.baking import bake_cameras, bake_texture
from pipeline.mesh.coordinates import make_coordinates
from pipeline.mesh.mesh import Mesh, bounding_radius
from pipeline.mesh.rasterize import rasterize
from pipeline.mesh.readers import read_mesh
from pipeline.mesh.seams import find_seams, seam_jump
from pipeline.mesh.texture import render_texture
from pipeline.options.job import Job, resolve
from pipeline.options.models import DEFAULT_MODEL, MODELS
from pipeline.paint.baking import atlas_texture, painted_views, texture_psnr, view_margin
from pipeline.paint.given_mesh import to_unit_ball
from pipeline.paint.step import initial_paint, make_pool
from pipeline.paint.surface_latents import Painted, complete
from pipeline.paint.train import train
from pipeline.report.png import to_bytes
from pipeline.report.preview import sheet
from pipeline.stages.embed import embed_texts, flat_latents
from pipeline.training.flat_colours import flat_colours

BUNDLE = MODELS / DEFAULT_MODEL
TEXTURE, VIEWS, RESOLUTION, HELD_OUT = 1024, 24, 64, 6


class Subject(NamedTuple):
    """A mesh and what it shall look like; the file's +Y is up unless said otherwise."""

    source: str
    """Package, or "catalogue"."""
    file: str
    """The catalogue's key, or a path inside the package's folder."""
    prompt: str
    up: str = "+y"
    front: str = "+z"


SUBJECTS = (
    Subject("catalogue", "BlendSwap-CC-0/pianoAQueue", "a pink grand piano"),
    Subject("catalogue", "BlendSwap-CC-0/pianoAQueue", "a wooden grand piano"),
    Subject("catalogue", "Scopia/chevrolet", "a red car"),
    Subject("catalogue", "BlendSwap-CC-BY/horse", "a brown horse"),
    Subject("pybullet_data", "duck.obj", "a yellow duck", front="-x"),
    Subject("pybullet_data", "teddy2_VHACD_CHs.obj", "a brown teddy bear"),
    Subject("genesis", "assets/meshes/duck.obj", "a yellow duck"),
    Subject("genesis", "assets/meshes/boat/boat.obj", "a blue boat", front="+x"),
)


def find_file(subject: Subject, catalogue: Path) -> Path | None:
    """Return the file of a subject, or None where its package is not installed."""
    if subject.source == "catalogue":
        found = [entry for entry in read_catalogue(catalogue) if entry.key == subject.file]
        return next(iter(found[0].path.parent.glob("*.obj")), None) if found else None
    spec = importlib.util.find_spec(subject.source)
    places = spec.submodule_search_locations if spec else None
    path = Path(places[0]) / subject.file if places else None
    return path if path and path.is_file() else None


def embed(prompt: str) -> Embeddings:
    """Return what stage `embed` writes, without its files."""
    bundle, tokenizer = open_bundle(BUNDLE, verify=False), load_tokenizer(BUNDLE / "tokenizer")
    with text_encoder(BUNDLE / "text_encoder") as encode_text:
        rows = embed_texts([*view_texts(prompt, bundle.view_prompts), ""], tokenizer, encode_text)
    with vae_encoder(BUNDLE / "vae_encoder") as encode:
        backgrounds = flat_latents(encode, flat_colours(), 128)
    return Embeddings(rows[:-1], rows[-1], bundle.view_prompts, backgrounds, flat_colours())


def versions_of(path: Path, subject: Subject) -> Iterator[tuple[str, Mesh, dict[str, Any]]]:
    """Give the mesh with its own texture coordinates, if they are usable, and with new ones."""
    given = read_mesh(path)
    mesh = Mesh(to_unit_ball(given, subject.up, subject.front), given.faces, given.uv, given.uv_faces)
    made, figures = make_coordinates(mesh, TEXTURE, TEXTURE // 64, rewrap=False)
    yield "own" if figures["uv"] == "the file's" else "new", made, figures
    if figures["uv"] == "the file's":
        yield "new", *make_coordinates(mesh, TEXTURE, TEXTURE // 64, rewrap=True)


def paint(mesh: Mesh, prompt: str, job: Job) -> tuple[Painted, dict[str, Any]]:
    """Paint a mesh in the unit ball as the stage `train_paint` does."""
    options, embeddings = job.train_paint, embed(prompt)
    scaled = mesh._replace(vertices=mesh.vertices * options.mesh_radius)
    pool = make_pool(scaled, options, options.texture, 32, job.seed)
    state = initial_paint(options, pool, flat_backgrounds(embeddings), job.seed)
    bundle = open_bundle(BUNDLE, verify=False)
    with denoiser(BUNDLE / "unet", views=bundle.views) as denoise:
        schedule = load_schedule(BUNDLE / "scheduler")
        guidance = distillation_gradient(denoise, schedule, embeddings, options, conditions_of(bundle))
        train(state, [], options, pool, guidance)
    latents, figures = complete(scaled, pool.seen, state.colours.detach().numpy(), options.texture)
    return Painted(latents, options.texture, options.mesh_radius), figures


def compare(painted: Painted, mesh: Mesh, decode: Decode) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Return the figures of both ways, and three tiles: a decoded view, and each texture seen from there."""
    scaled = mesh._replace(vertices=mesh.vertices * painted.mesh_radius)
    cameras = bake_cameras(VIEWS, bounding_radius(scaled))
    views = painted_views(painted, scaled, cameras, RESOLUTION, decode)
    held_out = ring(HELD_OUT, np.radians(65.0), 2.5 * bounding_radius(scaled), np.radians(50.0))
    shown = painted_views(painted, scaled, held_out, RESOLUTION, decode)
    margin = view_margin(len(views[0]), RESOLUTION)
    textures = {
        "views": bake_texture(scaled, cameras, views, TEXTURE, margin, two_sided=True)[0],
        "atlas": atlas_texture(painted, scaled, TEXTURE, decode),
    }
    seams = find_seams(scaled)
    figures = {
        way: {
            "psnr": round(texture_psnr(texture, scaled, held_out, shown), 2),
            "seam_error": round(seam_jump(seams, texture), 5),
        }
        for way, texture in textures.items()
    }
    fragments = rasterize(held_out[1], scaled.vertices, scaled.faces, len(shown[1]))
    tiles = [shown[1], *(render_texture(fragments, scaled, texture) for texture in textures.values())]
    return figures, [np.where(fragments.mask[..., None], tile, 0.93).astype(np.float32) for tile in tiles]


def main(folder: Path) -> dict[str, Any]:
    """Paint every subject, bake it both ways, write the table and the picture; return the figures."""
    rows, tiles, missing = [], [], []
    with tempfile.TemporaryDirectory() as work, vae_decoder(BUNDLE / "vae_decoder") as decode:
        for subject in SUBJECTS:
            path = find_file(subject, Path(work))
            if path is None:
                missing.append(f"{subject.source}: {subject.file}")
                continue
            job = resolve({"PROMPT": subject.prompt})
            steps = int(os.environ.get("STEPS") or 60)
            job = dataclasses.replace(job, train_paint=dataclasses.replace(job.train_paint, steps=steps))
            for coordinates, mesh, unwrapped in versions_of(path, subject):
                began = time.process_time()
                painted, figures = paint(mesh, subject.prompt, job)
                both, pictures = compare(painted, mesh, decode)
                tiles += pictures
                rows.append(
                    {
                        "mesh": f"{subject.source}/{subject.file}",
                        "prompt": subject.prompt,
                        "faces": len(mesh.faces),
                        "coordinates": coordinates,
                        "charts": unwrapped.get("charts"),
                        "why_new": unwrapped.get("uv_reason", ""),
                        "overlap": unwrapped["overlap"],
                        "seen_share": round(figures["seen_share"], 4),
                        "processor_seconds": round(time.process_time() - began, 1),
                        **both,
                    }
                )
    Image.fromarray(to_bytes(sheet(tiles, 3))).save(folder / "paint.png")
    means = {
        way: {
            key: round(float(np.mean([row[way][key] for row in rows])), 4) for key in ("psnr", "seam_error")
        }
        for way in ("views", "atlas")
    }
    return {"summary": {"meshes": len(rows), **means}, "rows": rows, "missing": missing}
