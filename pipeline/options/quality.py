"""What QUALITY decides of a job, and what a model that takes over does: layers of options, by section."""

from typing import Any

# Chosen from `make bench ONLY=oracle`, and by looking at what the bundled model makes: 100 steps of four
# updates look like 200 of two; after 300 of those it was not better, after 400 its armchair had a second back
# in place of the seat. A cell of 192 is two thirds of one of 128: normals are off by 14.1 degrees without
# more smoothing, by 12.9 with it. What 60 steps paint has not arrived yet: cooled, it is .7 dB worse.
QUALITY: dict[str, dict[str, dict[str, Any]]] = {
    "draft": {
        "train_nerf": {"steps": 50, "samples_per_ray": 48},
        "refinement": {"fit_steps": 30, "steps": 50},
        "extract": {"resolution": 96, "views": 12},
        "clean": {"faces": 8_000},
        "unwrap": {"resolution": 512},
        "bake": {"views": 12, "texture": 512},
        "prepare": {"resolution": 512},
        "train_paint": {"steps": 60, "cooling": 0.0},
        "bake_paint": {"views": 12, "texture": 512},
        "publish": {"turntable_frames": 24},
    },
    "standard": {},
    "high": {
        "train_nerf": {"samples_per_ray": 96},
        "refinement": {"fit_steps": 120, "steps": 400},
        "extract": {"resolution": 192, "views": 48, "smoothing": 2.25},
        "clean": {"faces": 60_000},
        "unwrap": {"resolution": 2048},
        "bake": {"views": 48, "texture": 2048},
        "prepare": {"resolution": 2048},
        "train_paint": {"steps": 300, "views": 192},
        "bake_paint": {"views": 48, "texture": 2048},
        "publish": {"turntable_frames": 120},
    },
}


# What a model takes over: calls are what the hand-over saves, optimiser steps cost less. Oracles (`make bench
# ONLY=hand-over`), from a blurred start: a ball 31.9 dB after 50 calls of 6 steps, 31.8 of 12; a chair of
# boxes 30.1 and 30.1.
HAND_OVER: dict[str, dict[str, Any]] = {"start_fit": {"updates_per_call": 6}}
