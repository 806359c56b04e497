"""A known light is found under paints and patterns, and taken out; what is no light is left alone."""

import numpy as np
import pytest

from pipeline.mesh.shading import Light, brightest, fit_light, shade, without_light
from pipeline.mesh.texture import paint, surface_texels
from pipeline.mesh.unwrap import unwrap_mesh
from tests import shapes

TOWARDS = np.array([0.0, 0.8, 0.6])
TRUE = Light(0.6, 0.4, 1.0)


def sphere_normals(count: int) -> np.ndarray:
    values = np.random.default_rng(0).normal(size=(count, 3))
    return values / np.linalg.norm(values, axis=1, keepdims=True)


def test_a_light_is_found_under_paints_and_patterns() -> None:
    normals, rng = sphere_normals(6000), np.random.default_rng(1)
    paints = np.array([[0.5, 0.1, 0.1], [0.1, 0.15, 0.45], [0.3, 0.3, 0.3]])[rng.integers(3, size=6000)]
    paints *= np.where(rng.random(6000) < 0.2, 0.7, 1.0)[:, None]
    found = fit_light(paints * shade(normals, TOWARDS, TRUE)[:, None], normals, TOWARDS)
    assert found.directional == pytest.approx(0.6, abs=0.11)
    assert found.sky == pytest.approx(0.4, abs=0.11)
    assert found.explained > 0.3
    plain = fit_light(paints, normals, TOWARDS)
    assert plain.explained < 0.02
    assert fit_light(np.ones((9, 3)), normals[:9], TOWARDS) == Light(0, 0, 0), "clipped colours tell nothing"


def test_no_direction_gets_more_than_the_brightest() -> None:
    assert shade(sphere_normals(20_000), TOWARDS, TRUE).max() == pytest.approx(
        brightest(TOWARDS, TRUE), rel=1e-3
    )


def test_a_texture_is_itself_again_up_to_the_exposure() -> None:
    mesh, _ = unwrap_mesh(shapes.mesh_of(shapes.torus(0.5, 0.2), 24), 128, 2)
    texels = surface_texels(mesh, 128)
    colours = np.tile([0.5, 0.3, 0.2], (len(texels.place), 1))
    lit = colours * shade(texels.normal, TOWARDS, TRUE)[:, None] / brightest(TOWARDS, TRUE)
    texture = paint(lit.astype(np.float32), texels, 4)
    made, light = without_light(mesh, texture, TOWARDS, 4)
    assert light.explained > 0.9
    np.testing.assert_allclose(made.reshape(-1, 3)[texels.place], colours, rtol=0.05)
    flat = paint(colours.astype(np.float32), texels, 4)
    same, light = without_light(mesh, flat, TOWARDS, 4)
    assert light.explained < 0.1
    assert same is flat
