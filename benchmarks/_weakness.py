"""How the bundled model errs, and an ideal denoiser that errs like it.

    python -m benchmarks._weakness WORK [MODEL]

fits the clean latents that a model predicts for held-out objects of a training folder, x0_hat, by
g blur_w(x_0) + e n: a Gaussian blur of width w [latent pixels], a gain g and white noise n, by noise level.
What a caption leaves open counts as weakness here. `MEASURED` is what it printed for the bundled model after
16,000 steps of its training; that of 12,800 blurs by up to 0.1 more and has up to 4 % more noise.

Letters: b views, h x w latent pixels.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter

from benchmarks._ideal import linear_schedule


class Weakness(NamedTuple):
    """What becomes of clean latents."""

    width: float
    """Of the blur [latent pixels]."""
    gain: float
    noise: float
    """Standard deviation."""


TOTAL = 1000
WIDTHS = np.arange(0.0, 2.01, 0.1)
LEVELS = (100, 300, 500, 700, 850, 950)
MEASURED: dict[int, Weakness] = {
    100: Weakness(0.4, 0.996, 0.102),
    300: Weakness(0.6, 1.005, 0.135),
    500: Weakness(0.7, 1.001, 0.147),
    700: Weakness(0.8, 0.997, 0.158),
    850: Weakness(0.9, 0.992, 0.171),
    950: Weakness(0.9, 0.980, 0.194),
}


def blurred(latents: Float[np.ndarray, "b 4 h w"], width: float) -> Float[np.ndarray, "b 4 h w"]:
    """Return latents through a Gaussian."""
    return np.asarray(gaussian_filter(latents, (0, 0, width, width), mode="nearest"))


def fit(clean: Float[np.ndarray, "b 4 h w"], predicted: Float[np.ndarray, "b 4 h w"]) -> Weakness:
    """Return the weakness that explains predictions best, by least squares."""
    best, least = Weakness(0.0, 1.0, 0.0), np.inf
    for width in WIDTHS:
        softer = blurred(clean, float(width))
        gain = float((softer * predicted).sum() / np.square(softer).sum())
        left = float(np.square(predicted - gain * softer).mean())
        if left < least:
            best, least = Weakness(float(width), gain, left**0.5), left
    return best


def weakness_at(timestep: int) -> Weakness:
    """Return the bundle's at a timestep, linear between those measured."""
    rows = np.array([MEASURED[level] for level in LEVELS])
    return Weakness(*(float(np.interp(timestep, LEVELS, column)) for column in rows.T))


def weaken(
    clean: Float[np.ndarray, "b 4 h w"], timesteps: Int[np.ndarray, " b"], rng: np.random.Generator
) -> Float[np.ndarray, "b 4 h w"]:
    """Return clean latents as the bundle would have predicted them."""
    found = []
    for view, timestep in zip(clean, timesteps, strict=True):
        weak = weakness_at(int(timestep))
        noise = weak.noise * rng.standard_normal(view.shape)
        found.append(weak.gain * blurred(view[None], weak.width)[0] + noise)
    return np.stack(found)


def main() -> None:
    """Command line."""
    from export.everyday_objects.data.captions import caption, seen_from
    from export.everyday_objects.data.kinds import BY_WORD
    from export.everyday_objects.data.pictures import look_of
    from export.everyday_objects.train.batches import VIEWS, camera_rows, load_objects, shard_numbers
    from export.everyday_objects.train.sample import default_schedule, of_bundle

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("model", type=Path, nargs="?", default=Path("onnx_models/everyday-objects"))
    parser.add_argument("--objects", type=int, default=64)
    arguments = parser.parse_args()
    folder = arguments.work / "held_out_pictures"
    objects = load_objects(folder, shard_numbers(folder)[:1])
    rng, schedule = np.random.default_rng(0), default_schedule()
    told = np.ones(VIEWS, bool)
    found: dict[int, tuple[list[np.ndarray], list[np.ndarray]]] = {level: ([], []) for level in LEVELS}
    with of_bundle(arguments.model) as painter:
        for row in range(min(arguments.objects, len(objects.rows[0]))):
            views = np.arange(0, 2 * VIEWS, 2)
            word, _, *look = objects.rows[0][row]
            text = caption(rng, BY_WORD[word], look_of(look))
            cameras = objects.cameras[0][row, views]
            texts = painter.encode_text([seen_from(text, float(c[0]), float(c[1])) for c in cameras])
            clean = np.asarray(objects.latents[0][row, views], np.float32)
            rows = camera_rows(cameras, objects.backdrops[0][row, views], told, told)
            for level, (true, predicted) in found.items():
                timesteps = np.full(VIEWS, level)
                noisy = schedule.add_noise(
                    clean, rng.standard_normal(clean.shape).astype(np.float32), timesteps
                )
                output = painter.denoise(noisy, timesteps, texts, rows)
                true.append(clean)
                predicted.append(schedule.to_clean(output, noisy, timesteps))
    for level, (true, predicted) in found.items():
        weak = fit(np.concatenate(true), np.concatenate(predicted))
        print(f"    {level}: Weakness({weak.width:.1f}, {weak.gain:.3f}, {weak.noise:.3f}),")


if __name__ == "__main__":
    assert len(linear_schedule().alphas_cumprod) == TOTAL
    main()
