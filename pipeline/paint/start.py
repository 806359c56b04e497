"""What an asset shows, on another mesh or in a scene: the start of a training that goes on from it.

Letters: n colours that some view reads, b views of a group, h x w latent pixels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image
from scipy.sparse import vstack
from scipy.sparse.linalg import lsmr

from pipeline.cameras import Camera
from pipeline.errors import InputError
from pipeline.mesh.coloured import ColouredMesh, face_coloured, picture_of, read_coloured, textured
from pipeline.mesh.mesh import read_obj
from pipeline.options.paint import Prepare
from pipeline.paint.given_mesh import load_paint_mesh, to_unit_ball
from pipeline.paint.step import Pool
from pipeline.training.encoded import EncodedGroup, Pictures

_STIFFNESS = 0.05
"""How much a colour that the views hardly show keeps to the mean, against a pixel that shows it alone."""
_SOLID = 0.5
"""Pixels that the mesh covers less than this say more of what is behind it."""


def start_mesh(inputs: Mapping[str, Path], prepare: Prepare, radius: float) -> ColouredMesh:
    """Return the mesh that a stage's inputs name as its start, in a ball of `radius` around the origin.

    `start_file`: a file of any tool, turned as `prepare` says; `start_mesh` and `start_albedo`: a run's own.

    Raises:
        InputError: see `coloured.read_coloured`.
    """
    if "start_file" in inputs:
        mesh = read_coloured(inputs["start_file"])
        return mesh._replace(vertices=to_unit_ball(mesh, prepare.up, prepare.front) * radius)
    with Image.open(inputs["start_albedo"], formats=["PNG"]) as opened:
        albedo = np.asarray(opened.convert("RGB"), np.float32) / 255
    if inputs["start_mesh"].suffix == ".obj":
        made = textured(read_obj(inputs["start_mesh"]), albedo)
        return made._replace(vertices=to_unit_ball(made, "+y", "+z") * radius)
    given = load_paint_mesh(inputs["start_mesh"])
    if given.uv is None:
        return face_coloured(given.unit * radius, given.faces, albedo[0])
    return textured(given.scaled(radius), albedo)


def mesh_pictures(mesh: ColouredMesh) -> Pictures:
    """Return what cameras see of a mesh."""

    def pictures(
        cameras: Sequence[Camera], size: int
    ) -> tuple[Float[np.ndarray, "b s s 3"], Float[np.ndarray, "b s s"]]:
        pairs = [picture_of(mesh, camera, size) for camera in cameras]
        return np.stack([colours for colours, _ in pairs]), np.stack([opacity for _, opacity in pairs])

    return pictures


def solve_colours(pool: Pool, known: Sequence[EncodedGroup]) -> Float[np.ndarray, "n 4"]:
    """Return the colours with which the first groups of a pool look as their encoded views do: least squares,
    since a view is linear in the colours. What no view shows is the mean of what they show.

    Raises:
        InputError: no view shows anything.
    """
    weights, targets = [], []
    for views, group in zip(pool.views, known, strict=False):
        for view, background, latents in zip(views, group.backgrounds, group.latents, strict=True):
            solid = view.covered.ravel() > _SOLID
            behind = (1 - view.covered.ravel())[:, None] * background
            weights.append(view.weights[solid])
            targets.append((latents.reshape(4, -1).T - behind)[solid])
    matrix, wanted = vstack(weights, format="csr").astype(np.float64), np.concatenate(targets)
    if not len(wanted):
        raise InputError(
            "START: no view of the mesh shows any of it; check train_paint.radius and mesh_radius"
        )
    mean = wanted.mean(axis=0, dtype=np.float64)
    rest = wanted - np.asarray(matrix.sum(axis=1)).reshape(-1, 1) * mean
    columns = [lsmr(matrix, rest[:, channel], damp=_STIFFNESS, maxiter=200)[0] for channel in range(4)]
    return (np.stack(columns, axis=1) + mean).astype(np.float32)
