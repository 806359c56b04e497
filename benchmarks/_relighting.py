"""Whether the light of the training pictures can be taken out of the colours of a finished object.

The default model was trained on pictures of one light (`render`): shade = ambient + directional * lambert +
sky * (1 + ny) / 2, times the colours. What was made with it has that light in its texture, under whatever
light a viewer adds; `pipeline.mesh.shading` estimates it and divides it out.

The truth is that of the makers' objects: their paints without light, and under another light. Letters:
n samples (pixels that see the object).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from export.everyday_objects.data import render as drawing
from export.everyday_objects.data.kinds import KINDS
from export.everyday_objects.data.looks import draw_look, dress
from export.everyday_objects.data.pictures import draw_views
from export.everyday_objects.data.render import AMBIENT, DIRECTIONAL, SKY, TOWARDS, Drawable, Looks, drawable
from export.everyday_objects.data.shapes import assemble
from pipeline.cameras import Camera, orbit_camera, project
from pipeline.mesh.shading import EXPLAINED, Light, fit_light, shade

OBJECTS, SIZE = 24, 64
TRUE = Light(DIRECTIONAL / AMBIENT, SKY / AMBIENT, 1.0)
OTHER = orbit_camera(2.2, 1.1, 1.0, 1.0).pose[:3, 2]
"""Unit vector towards the light that the object is shown under: from the right and behind."""
ERROR = 13.0
"""Of the normals of finished objects: of the mesh on known scenes [degrees]."""


class Samples(NamedTuple):
    """What the pixels of an object show."""

    paint: Float[np.ndarray, "n 3"]
    """Without light, in [0, 1]."""
    normals: Float[np.ndarray, "n 3"]


def samples_of(thing: Drawable, looks: Looks, cameras: list[Camera]) -> Samples:
    """Return what cameras see of an object: paints and normals are drawn as pictures of suitable lights."""
    white = looks._replace(colours=np.ones_like(looks.colours), codes=np.zeros_like(looks.codes))
    paint, normals = [], []
    for camera in cameras:
        picture, seen = _drawn(thing, looks, camera, (1.0, 0.0, 0.0), TOWARDS)
        sides = [
            _drawn(thing, white, camera, (0.0, 1.0, 0.0), sign * axis)[0][..., 0]
            for axis in np.eye(3)
            for sign in (1.0, -1.0)
        ]
        here = np.stack([sides[0] - sides[1], sides[2] - sides[3], sides[4] - sides[5]], axis=-1)[seen]
        length = np.linalg.norm(here, axis=1)
        whole = length > 0.5
        paint.append(picture[seen][whole])
        normals.append(here[whole] / length[whole, None])
    return Samples(np.concatenate(paint).astype(np.float64), np.concatenate(normals).astype(np.float64))


def _drawn(
    thing: Drawable, looks: Looks, camera: Camera, light: tuple[float, float, float], towards: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return a picture (SIZE, SIZE, 3) under a light, and where it shows the object."""
    shape = thing.shape
    xy, depth = project(camera, shape.vertices)
    screen = np.concatenate([xy * SIZE, 1.0 / depth[:, None]], axis=1)
    colour, nearest = np.zeros((SIZE, SIZE, 3), np.float32), np.zeros((SIZE, SIZE))
    things = (screen, shape.vertices, shape.faces, thing.normals, shape.paint)
    drawing._draw(*things, *looks, np.array(light), towards, camera.pose[:3, 3], colour, nearest)
    return colour, nearest > 0


def disturbed(
    normals: Float[np.ndarray, "n 3"], degrees: float, rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    """Return unit normals that are off by so much in the mean."""
    spread = np.radians(degrees) / np.sqrt(np.pi / 2)  # two directions of the tangent plane: a Rayleigh mean
    moved = normals + rng.normal(0, spread, normals.shape)
    return moved / np.linalg.norm(moved, axis=1, keepdims=True)


def relit_psnr(texture: np.ndarray, samples: Samples) -> float:
    """Return the PSNR [dB] of a texture under another light against the paint under it, at the exposure
    that suits it best."""
    light = shade(samples.normals, OTHER, TRUE)[:, None]
    light = light / light.max()
    shown, truth = texture * light, samples.paint * light
    gain = (shown * truth).sum() / max(float(np.square(shown).sum()), 1e-12)
    error = np.square(np.clip(gain * shown, 0, 1) - truth).mean()
    return float(-10 * np.log10(max(float(error), 1e-10)))


def relighting(number: int, seed: int = 0) -> dict[str, Any]:
    """Return the figures of an object, with the true normals (exact) and with those of a finished one."""
    kind = KINDS[number]
    rng = np.random.default_rng([seed, number])
    thing = drawable(assemble(kind.make(rng)))
    look = draw_look(rng, kind, kind.roles)
    looks = dress(rng, kind, thing.shape, look)
    samples = samples_of(thing, looks, [view.camera() for view in draw_views(rng)])
    made = np.clip(samples.paint * AMBIENT * shade(samples.normals, TOWARDS, TRUE)[:, None], 0, 1)
    row: dict[str, Any] = {
        "object": kind.words[0],
        "relit_psnr_undivided": round(relit_psnr(made, samples), 2),
    }
    for name, error in (("exact", 0.0), ("made", ERROR)):
        normals = disturbed(samples.normals, error, rng) if error else samples.normals
        light = fit_light(made, normals, TOWARDS)
        used = light if light.explained >= EXPLAINED else Light(0.0, 0.0, 0.0)
        divided = made / shade(normals, TOWARDS, used)[:, None]
        row[f"relit_psnr_{name}_normals"] = round(relit_psnr(divided, samples), 2)
        row[f"explained_{name}_normals"] = round(light.explained, 3)
    return row


def relit(count: int = OBJECTS) -> list[dict[str, Any]]:
    """Return a row for each of so many kinds, spread over all."""
    return [relighting(int(number)) for number in np.linspace(0, len(KINDS) - 1, count)]


def summarise_relit(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return mean PSNRs [dB] with the normals of finished objects, without and with the division, and how
    many objects lost by it."""
    names = ("relit_psnr_undivided", "relit_psnr_made_normals")
    before, after = (np.array([row[name] for row in rows]) for name in names)
    return {
        "relit_psnr": round(float(after.mean()), 2),
        "relit_psnr_undivided": round(float(before.mean()), 2),
        "relit_worse": int((after < before - 0.05).sum()),
    }
