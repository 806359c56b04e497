"""Colours that are solved for show what was encoded."""

from dataclasses import replace

import numpy as np
import trimesh

from pipeline.mesh.mesh import Mesh
from pipeline.options.paint import TrainPaint
from pipeline.paint.start import solve_colours
from pipeline.paint.step import make_pool
from pipeline.training.encoded import EncodedGroup

OPTIONS = TrainPaint(steps=1, views=24, cameras_per_step=4, supersampling=2)


def test_the_solution_is_the_colours_that_made_the_views() -> None:
    ball = trimesh.creation.icosphere(2, radius=0.6)
    mesh = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces, np.int32))
    pool = make_pool(mesh, replace(OPTIONS, radius=(1.8, 2.0)), None, 32, 0)
    rng = np.random.default_rng(0)
    true = (mesh.vertices[mesh.faces].mean(1)[pool.seen] @ rng.normal(size=(3, 4))).astype(np.float32)
    known = []
    for group, views in zip(pool.groups, pool.views, strict=True):
        flat = rng.normal(size=(4, 4)).astype(np.float32)
        latents = np.stack([view.render(true, one) for view, one in zip(views, flat, strict=True)])
        known.append(EncodedGroup(group, flat, latents))
    found = solve_colours(pool, known)
    np.testing.assert_array_equal(found, solve_colours(pool, known))
    weight = np.mean([view.weights.sum(0) for views in pool.views for view in views], 0)
    shown = weight > np.quantile(weight, 0.2)
    error = np.abs(found - true)[shown]
    assert error.mean() < 0.1 * np.abs(true).mean()
    few = solve_colours(pool, known[:2])
    assert np.isfinite(few).all(), "colours that no known view shows are the mean"
