"""A painted mesh: latents for every texel or face, complete enough to be decoded.

Letters: s latent texels along a side, n colours that were seen, f triangles.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pipeline import arrays
from pipeline.errors import InputError
from pipeline.mesh.fill import continue_nearest
from pipeline.mesh.mesh import Mesh, face_normals
from pipeline.mesh.texture import Texels, fill_unseen, surface_texels


class Painted(NamedTuple):
    """What training leaves. Rows of `latents` are texels (row-major) or faces."""

    latents: Float[np.ndarray, "c 4"]
    texture: int | None
    """Side of the latent texture; None: a colour a face."""
    mesh_radius: float
    """Of the ball that the mesh was fitted to [scene units]."""


def face_texels(mesh: Mesh) -> Texels:
    """Return a stand-in texel for every face, at its centroid."""
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    normal = face_normals(mesh)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-20)
    place = np.arange(len(mesh.faces))
    return Texels(0, place, corners.mean(axis=1).astype(np.float32), normal.astype(np.float32), 0.0)


def complete(
    mesh: Mesh, seen: Int[np.ndarray, " n"], colours: Float[np.ndarray, "n 4"], texture: int | None
) -> tuple[Float[np.ndarray, "c 4"], dict[str, float]]:
    """Return latents for every texel or face, and metrics.

    What is on the surface but was not seen continues what is nearest on the surface; the rest of a texture
    continues the nearest texel: a decoder, or a bilinear lookup, that reaches over a chart's border then
    finds the chart's own colours. `seen_share` is the share of the surface's texels (or faces) that some view
    saw, `colours` how many texels (or faces) were optimised, `unseen_colours` how many were not.
    """
    surface = face_texels(mesh) if texture is None else surface_texels(mesh, texture)
    known = np.zeros(len(mesh.faces) if texture is None else texture**2, bool)
    latents = np.zeros((len(known), 4), np.float32)
    known[seen], latents[seen] = True, colours
    on_surface = known[surface.place]
    if on_surface.any():
        latents[surface.place] = fill_unseen(
            latents[surface.place], on_surface.astype(np.float64), surface.position, surface.normal
        )
        known[surface.place] = True
    if texture is not None:
        square = latents.reshape(texture, texture, 4)
        latents = continue_nearest(square, known.reshape(texture, texture)).reshape(-1, 4)
    metrics = {"seen_share": float(on_surface.mean()), "colours": len(seen)}
    return latents, {**metrics, "unseen_colours": len(latents) - len(seen)}


def save_painted(path: Path, painted: Painted) -> None:
    """Write it; equal latents give equal bytes."""
    values = {
        "latents": painted.latents,
        "texture": np.array(painted.texture or 0),
        "mesh_radius": np.array(painted.mesh_radius),
    }
    path.write_bytes(arrays.pack(values))


def load_painted(path: Path) -> Painted:
    """Read what `save_painted` wrote. Raises InputError if the file is damaged."""
    try:
        values = arrays.unpack(path.read_bytes())
        return Painted(values["latents"], int(values["texture"]) or None, float(values["mesh_radius"]))
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is damaged ({error}): delete it and run again") from None
