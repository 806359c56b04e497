"""What the denoiser has learned, by noise level, on looks and cameras that it never saw."""

import numpy as np
import torch
from torch import Tensor

from export.everyday_objects.data.captions import caption, seen_from
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.pictures import look_of
from export.everyday_objects.train.batches import VIEWS, Batch, Objects, camera_rows, draw_batch, locate
from export.everyday_objects.train.loss import Model, loss_of

FIGURES_AT = (300, 500, 700, 850, 950)
"""Timesteps at which the loss on held-out objects is said."""


def held_out_figures(model: Model, objects: Objects, abar: Tensor) -> dict[str, list[float]]:
    """Return the loss at FIGURES_AT on held-out objects: told everything; a wrong or no camera, backdrop,
    text; and with every view alone."""
    ends = np.cumsum([len(rows) for rows in objects.rows])
    count = min(int(ends[-1]), 64)
    base = draw_batch(objects, 0, count)
    rng = np.random.default_rng(0)
    whole, texts = [], list[str]()
    for i in range(count):  # the same draws as draw_batch would make, with nothing left out
        shard, row = locate(ends, i * 7 % int(ends[-1]))
        views = np.arange(0, 2 * VIEWS, 2)
        word, _, *look = objects.rows[shard][row]
        text = caption(rng, BY_WORD[word], look_of(look))
        cameras = objects.cameras[shard][row, views]
        texts += [seen_from(text, float(c[0]), float(c[1])) for c in cameras]
        whole.append((np.asarray(objects.latents[shard][row, views], np.float32), cameras,
                      objects.backdrops[shard][row, views]))  # fmt: skip
    clean, cameras, backdrops = (np.concatenate(part) for part in zip(*whole, strict=True))
    yes, no = np.ones(len(clean), bool), np.zeros(len(clean), bool)
    turned = cameras + np.array([np.pi / 2, 0, 0, 0], np.float32)
    other = [*texts[VIEWS:], *texts[:VIEWS]]
    right = camera_rows(cameras, backdrops, yes, yes)
    arms: dict[str, tuple[list[str], np.ndarray, int]] = {
        "right": (texts, right, VIEWS),
        "wrong camera": (texts, camera_rows(turned, backdrops, yes, yes), VIEWS),
        "no camera": (texts, camera_rows(cameras, backdrops, no, yes), VIEWS),
        "no backdrop": (texts, camera_rows(cameras, backdrops, yes, no), VIEWS),
        "wrong text": (other, right, VIEWS),
        "no text": ([""] * len(texts), right, VIEWS),
        "views apart": (texts, right, 1),
    }
    figures: dict[str, list[float]] = {}
    for name, (said, told, seen) in arms.items():
        figures[name] = []
        for t in FIGURES_AT:
            level = np.full(len(clean), t)
            parts = [
                Batch(clean[s], base.noise[s], level[s], said[s], told[s], seen)
                for s in (slice(i, i + 64) for i in range(0, len(clean), 64))
            ]
            with torch.inference_mode():
                figures[name].append(
                    round(float(torch.cat([loss_of(model, p, abar) for p in parts]).mean()), 4)
                )
    return figures
