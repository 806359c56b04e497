"""The kernels against straightforward torch (`_plain`): forward and backward, the same work, in turn.

    make bench ONLY=field

Encoding, marching, compositing, reading texels, and a whole step (field, rendering, backward) of 64 x 64 rays
with the default bundle's grid. Both sides evaluate the same samples, `speedup_*` are ratios of medians on the
clock; `processor_speedup` compares processor time, which other work on the machine disturbs less.
`speedup_skipping` is that of rendering and backward with empty cells and hidden samples skipped, in scenes
learned from ideal denoisers, against plain torch that evaluates every sample in the box; `psnr_drop_db` what
the skipping changes in their views against the truth (the worst scene). Then the time of a step against rays,
samples a ray and threads. ROUNDS=5 unless said otherwise, the scaling in 3.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks import _plain
from benchmarks._ideal import ideal_guidance
from benchmarks._kernels import Size, both, compositing, encoding, foggy, marching, texels, view_rays
from benchmarks._plots import Curve, Panel, write_fronts
from benchmarks._tables import markdown
from benchmarks._timing import in_turn, kernel_threads
from benchmarks._trials import RESOLUTION, backgrounds, decibels, held_out, job_of, views_psnr
from benchmarks._truths import Truth, analytic_scenes, catalogue_scenes
from pipeline.kernels import parallel
from pipeline.nerf.rendering import Rays, make_rays, render_rays
from pipeline.nerf.scene import Scene
from pipeline.nerf.step import initial_state
from pipeline.nerf.train import train
from pipeline.options.nerf import TrainNerf

SKIPPED = ("torus", "boxes")
SKIPPED_MODELS = ("horse",)


def our_step(scene: Scene, rays: Rays) -> int:
    """Render and go back with a gradient of ones; return how often the field was evaluated."""
    seen = render_rays(scene, rays)
    clear(scene)
    torch.autograd.backward(
        [seen.latents, seen.log_transmittance],
        [torch.ones_like(seen.latents), torch.ones_like(seen.log_transmittance)],
    )
    return len(seen.density)


def plain_step(scene: Scene, rays: Rays) -> int:
    """Do the same in straightforward torch."""
    pixels, dimmed, count = _plain.render(scene, rays)
    clear(scene)
    torch.autograd.backward([pixels, dimmed], [torch.ones_like(pixels), torch.ones_like(dimmed)])
    return count


def clear(scene: Scene) -> None:
    """Forget the field's gradients."""
    for parameter in scene.field.parameters():
        parameter.grad = None


def whole_step(scene: Scene, side: int, rounds: int) -> dict[str, Any]:
    """Compare field, rendering and backward at equal samples."""
    rays = view_rays(side)
    counts = our_step(scene, rays), plain_step(scene, rays)
    if abs(counts[0] - counts[1]) > 1e-3 * counts[1]:  # a rounding at the box's wall may differ
        raise RuntimeError(f"the two sides evaluate {counts[0]} and {counts[1]} samples")
    result = both(lambda: plain_step(scene, rays), lambda: our_step(scene, rays), rounds)
    return {"rays": side * side, "samples": counts[0], **result}


def skipping(truth: Truth, options: TrainNerf, size: Size) -> dict[str, Any]:
    """Learn a scene, then compare rendering with everything skipped that can be, against nothing."""
    guidance = ideal_guidance(truth.draw, signal_power=options.signal_power)
    state = initial_state(options, backgrounds(), 0)
    train(state, [], options, min(RESOLUTION, size.side), guidance)
    scene, rays = state.scene, view_rays(size.side)
    cameras = held_out(options)
    flat = backgrounds()[0]
    skipped = views_psnr(scene, truth, cameras, size.side)
    errors = []
    with torch.no_grad():
        for camera in cameras:
            pixels, dimmed, _ = _plain.render(scene, make_rays([camera], size.side))
            shown = (pixels.numpy() + np.exp(dimmed.numpy())[:, None] * flat).T
            errors.append(shown.reshape(4, size.side, size.side) - truth.draw(camera, size.side, flat))
    everything = decibels(np.stack(errors))
    return {
        "scene": truth.name,
        "samples": our_step(scene, rays),
        "samples_in_box": plain_step(scene, rays),
        **both(lambda: plain_step(scene, rays), lambda: our_step(scene, rays), size.rounds),
        "psnr": round(skipped, 3),
        "psnr_unskipped": round(everything, 3),
        "psnr_drop_db": round(everything - skipped, 4),
    }


def thread_scaling(scene: Scene, side: int, rounds: int) -> list[dict[str, Any]]:
    """Return the time of our step with 1, 2, ... threads, as many as there are processors."""
    rays, most = view_rays(side), parallel.threads()

    def step_with(count: int) -> None:
        with kernel_threads(count):
            our_step(scene, rays)

    counts = sorted({1, 2, *(2**i for i in range(2, most.bit_length())), most} & set(range(1, most + 1)))
    paces = in_turn({str(count): lambda c=count: step_with(c) for count in counts}, rounds)  # type: ignore[misc]
    return [{"threads": count, **paces[str(count)]._asdict()} for count in counts]


def measure(truths: Sequence[Truth], options: TrainNerf, size: Size) -> dict[str, Any]:
    """Return all figures; the first truth lends its mesh to the texels."""
    scene = foggy(options)
    rays = [whole_step(scene, side, size.scaling_rounds) for side in size.sides]
    samples = []
    for count in size.samples:
        scene.samples_per_ray = count
        samples.append({"samples_per_ray": count, **whole_step(scene, size.side, size.scaling_rounds)})
    scene.samples_per_ray = options.samples_per_ray
    return {
        "encoding": encoding(scene, size),
        "marching": marching(scene, size),
        "compositing": compositing(scene, size),
        "texels": texels(truths[0], size),
        "step": whole_step(scene, size.side, size.rounds),
        "skipping": [skipping(truth, options, size) for truth in truths],
        "by_rays": rays,
        "by_samples": samples,
        "by_threads": thread_scaling(scene, size.side, size.rounds),
    }


def summarise(figures: dict[str, Any]) -> dict[str, Any]:
    """Return the summary of `measure`'s figures: of the scenes for skipping, the worst."""
    return {
        "speedup_encoding": figures["encoding"]["speedup"],
        "speedup_step": figures["step"]["speedup"],
        "speedup_skipping": min(row["speedup"] for row in figures["skipping"]),
        "psnr_drop_db": max(row["psnr_drop_db"] for row in figures["skipping"]),
        "processor": {
            name: figures[name]["processor_speedup"]
            for name in ("encoding", "marching", "compositing", "texels", "step")
        },
    }


def table(figures: dict[str, Any]) -> str:
    """Return the comparisons in Markdown."""
    parts = ("encoding", "marching", "compositing", "texels", "step")
    rows = [
        *((name, figures[name]) for name in parts),
        *((f"step, skipping: {row['scene']}", row) for row in figures["skipping"]),
    ]
    heads = ("forward and backward", "plain torch [s]", "ours [s]", "times faster", "in processor time")
    return markdown(
        heads,
        [
            (name, row["plain"]["seconds"], row["ours"]["seconds"], row["speedup"], row["processor_speedup"])
            for name, row in rows
        ],
    )


def panels(figures: dict[str, Any]) -> list[Panel]:
    """Return the plots of how a step scales."""
    seconds = "seconds a step"

    def curve(side: str, rows: str, x: str) -> Curve:
        return Curve(side, [row[x] for row in figures[rows]], [row[side]["seconds"] for row in figures[rows]])

    scaling = [
        Panel(label, seconds, [curve(side, rows, x) for side in ("plain", "ours")], log_y=True)
        for rows, x, label in (
            ("by_rays", "rays", "rays"),
            ("by_samples", "samples_per_ray", "samples a ray through the whole box"),
        )
    ]
    threads = figures["by_threads"]
    return [
        *scaling,
        Panel(
            "threads",
            seconds,
            [Curve("ours", [row["threads"] for row in threads], [row["seconds"] for row in threads])],
            log_y=True,
        ),
    ]


def main(folder: Path) -> dict[str, Any]:
    """Measure, write the plot into `folder`, return the figures."""
    chosen = [truth for truth in analytic_scenes() if truth.name in SKIPPED]
    truths = [*chosen, *catalogue_scenes(SKIPPED_MODELS)]
    size = Size(rounds=int(os.environ.get("ROUNDS") or Size().rounds))
    figures = measure(truths, job_of("standard", steps=Size().steps).train_nerf, size)
    write_fronts(folder / "field.png", panels(figures), "One step of 64 x 64 rays, unless said otherwise")
    (folder / "field.md").write_text(table(figures), encoding="utf-8")
    return {"summary": summarise(figures), "rounds": size.rounds, **figures}
