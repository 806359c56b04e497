"""The report says what was left out, and nothing of what was not."""

from typing import Any

from pipeline.report.unneeded import unneeded


def entry(stage: str, metrics: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    return {"stage": stage, "metrics": metrics or {}, **more}


def test_a_run_that_left_nothing_out_says_nothing() -> None:
    options = {"train_nerf": {"guidance_scale": 20.0, "guidance_scale_end": 1.0}}
    metrics = {"skipped_steps": 0, "steps": 200, "skipped_samples": {}}
    entries = [entry("sketch"), entry("train_nerf", metrics, options=options), entry("refine")]
    assert unneeded(entries) == []


def test_a_text_run() -> None:
    metrics = {
        "skipped_steps": 10,
        "steps": 490,
        "skipped_samples": {"outside the box": 0.4456, "in empty cells": 0.4465},
        "unjudged_share": 0.0125,
    }
    options = {"train_nerf": {"guidance_scale": 1.0, "guidance_scale_end": 1.0}}
    assert unneeded([entry("train_nerf", metrics, options=options), entry("bake", reused_from="other")]) == [
        "train_nerf: samples of its rays: 44.6 % outside the box, 44.6 % in empty cells",
        "train_nerf: 10 of 500 steps, since the scene had converged",
        "train_nerf: the sketch's distance in the 1.2 % of the box nearest it",
        "train_nerf: the denoiser's pass without the text, since guidance is 1",
        "not asked for, so neither run nor loaded: a sketch and refinement",
        "taken from another run: bake",
    ]


def test_a_painted_mesh() -> None:
    entries = [
        entry("prepare", {"uv": "the file's"}),
        entry("train_paint", {"colours": 8307, "unseen_colours": 8077, "steps": 120}),
    ]
    assert unneeded(entries) == [
        "prepare: unwrapping: the file's texture coordinates are good",
        "train_paint: 8077 of 16384 colours, which no face uses or no view sees",
        "not asked for, so neither run nor loaded: refinement",
    ]
    assert unneeded([entry("prepare", {"uv": "new (xatlas)"}), *entries[1:], entry("refine_paint")]) == [
        "train_paint: 8077 of 16384 colours, which no face uses or no view sees"
    ]
