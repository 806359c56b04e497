"""Cheaper denoisers: run time against the error of eps_cond - eps_uncond, which guidance multiplies.

The ways: int8 with static and dynamic scales, weights of 8 bits, weights of 16 bits, bf16 arithmetic where
onnxruntime has OpenVINO, two runs of one row in place of one of two, thread counts, half the resolution, and
leaving the unconditional pass out where noise is strongest. MODEL=name chooses another bundle.

Times are medians of runs that alternate with the reference, summed over the noise levels. The error is the
relative Euclidean distance from the reference's difference, over all noise levels together.
"""

from __future__ import annotations

import logging
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnx_ir as ir
import onnxruntime
import torch
from matplotlib.figure import Figure
from onnx import numpy_helper
from onnxruntime import quantization

from benchmarks._tables import markdown
from export.everyday_objects.autoencoder import LATENT_CHANNELS
from export.everyday_objects.restore import restore_networks
from export.everyday_objects.text_encoder import MAX_TOKENS, WIDTH
from export.graph import export_graph, store_as_half
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.onnx_file import read_onnx
from pipeline.diffusion.prompts import view_texts
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import Denoise, denoiser, text_encoder
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.job import DEFAULT_MODEL, bundle_folder

LEVELS = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Shares of the schedule: little noise to much."""
ROUNDS = 5
"""Runs a way and noise level."""
SKIP_ABOVE = 0.8
PROMPT = "a red armchair"
REFERENCE = "fp32, batch of 2"
Difference = Callable[[np.ndarray, int], np.ndarray]
"""Noisy latents (1, c, h, w) and a timestep to eps_cond - eps_uncond."""


def guided(denoise: Denoise, texts: np.ndarray) -> Difference:
    """Return the difference from one run on two rows; texts are cond and uncond."""

    def difference(noisy: np.ndarray, timestep: int) -> np.ndarray:
        told, without = denoise(np.repeat(noisy, 2, 0), np.array([timestep] * 2), texts)
        return told - without

    return difference


def concurrent(denoise: Denoise, texts: np.ndarray, pool: ThreadPoolExecutor) -> Difference:
    """Return the difference from two runs on one row each, at the same time."""

    def difference(noisy: np.ndarray, timestep: int) -> np.ndarray:
        rows = [pool.submit(denoise, noisy, np.array([timestep]), texts[i : i + 1]) for i in range(2)]
        told, without = (row.result()[0] for row in rows)
        return told - without

    return difference


def coarse(full: Difference) -> Difference:
    """Return the difference at half the resolution, enlarged."""

    def difference(noisy: np.ndarray, timestep: int) -> np.ndarray:
        b, c, h, w = noisy.shape
        # Twice the mean of four: the noise keeps its variance, as the schedule has it.
        small = noisy.reshape(b, c, h // 2, 2, w // 2, 2).mean((3, 5)) * 2
        return full(small.astype(np.float32), timestep).repeat(2, 1).repeat(2, 2)

    return difference


def without_unconditional(denoise: Denoise, texts: np.ndarray, full: Difference, above: int) -> Difference:
    """Return a difference of nothing where noise is strong (one pass, no guidance), else the full one."""

    def difference(noisy: np.ndarray, timestep: int) -> np.ndarray:
        if timestep < above:
            return full(noisy, timestep)
        denoise(noisy, np.array([timestep]), texts[:1])
        return np.zeros(noisy.shape[1:], np.float32)

    return difference


def inputs(bundle: Path) -> tuple[np.ndarray, list[tuple[np.ndarray, int]]]:
    """Return the texts (cond, uncond) and noisy latents with timesteps, of a picture the model predicts."""
    opened, schedule = open_bundle(bundle, verify=False), load_schedule(bundle / "scheduler")
    tokenizer = load_tokenizer(bundle / "tokenizer")
    prompt = view_texts(PROMPT, opened.view_prompts)[0]
    with text_encoder(bundle / "text_encoder") as encode:
        texts = encode(np.stack([tokenizer.encode(prompt), tokenizer.encode("")]))
    random = np.random.default_rng(0)
    shape = (1, opened.latent_channels, opened.latent_size, opened.latent_size)
    total = len(schedule.alphas_cumprod)
    noisy, last = random.standard_normal(shape, np.float32), np.array([int(0.98 * total)])
    with denoiser(bundle / "unet") as denoise:
        clean = schedule.to_clean(denoise(noisy, last, texts[:1]), noisy, last)
    cases = []
    for level in LEVELS:
        timestep = np.array([int(level * total)])
        cases.append(
            (schedule.add_noise(clean, random.standard_normal(shape, np.float32), timestep), int(timestep[0]))
        )
    return texts, cases


class Calibration(quantization.CalibrationDataReader):  # type: ignore[misc]
    """The cases, as onnxruntime's quantiser wants them."""

    def __init__(self, session: Any, texts: np.ndarray, cases: list[tuple[np.ndarray, int]]) -> None:
        kind = next(port.type for port in session.get_inputs() if port.name == "timestep")
        dtype = np.float32 if kind == "tensor(float)" else np.int64
        rank = len(next(port.shape for port in session.get_inputs() if port.name == "timestep"))
        self.rows: Iterator[dict[str, np.ndarray]] = iter(
            {
                "sample": np.repeat(noisy, 2, 0),
                "timestep": np.full((2,) if rank else (), timestep, dtype),
                "encoder_hidden_states": texts,
            }
            for noisy, timestep in cases
        )

    def get_next(self) -> dict[str, np.ndarray] | None:
        """Return the next case."""
        return next(self.rows, None)


def quantised(
    folder: Path, work: Path, texts: np.ndarray, cases: list[tuple[np.ndarray, int]]
) -> dict[str, Path]:
    """Write the graph with int8 arithmetic, 8-bit weights and 16-bit weights; return the folders by name."""
    made = {name: work / name for name in ("int8 static", "int8 dynamic", "8-bit weights", "fp16 storage")}
    for place in made.values():
        place.mkdir()
    # onnxruntime's quantiser wants constants in place, not behind a Cast.
    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
    options.optimized_model_filepath = str(work / "plain.onnx")
    session = onnxruntime.InferenceSession(str(folder / "model.onnx"), options, ["CPUExecutionProvider"])
    plain = work / "plain.onnx"
    quantization.quantize_dynamic(
        plain, made["int8 dynamic"] / "model.onnx", op_types_to_quantize=["MatMul", "Gemm"]
    )
    logging.getLogger().setLevel(logging.ERROR)  # a line for every vector that has no channels
    quantization.quantize_static(
        plain,
        made["int8 static"] / "model.onnx",
        Calibration(session, texts, cases),
        op_types_to_quantize=["Conv", "MatMul", "Gemm"],
        per_channel=True,
    )
    onnx.save(eight_bit_weights(onnx.load(plain)), made["8-bit weights"] / "model.onnx")
    model = ir.load(plain)
    for value in model.graph.initializers.values():
        if value.const_value is not None and value.const_value.dtype == ir.DataType.FLOAT:
            rounded = value.const_value.numpy().astype(np.float16).astype(np.float32)
            value.const_value = ir.tensor(rounded, name=value.name)
    store_as_half(model)
    ir.save(model, made["fp16 storage"] / "model.onnx")
    return made


def eight_bit_weights(model: onnx.ModelProto) -> onnx.ModelProto:
    """Round every weight matrix and kernel to 255 levels an output channel; arithmetic stays fp32."""
    for tensor in model.graph.initializer:
        values = numpy_helper.to_array(tensor)
        if values.dtype == np.float32 and values.ndim >= 2 and values.size >= 256:
            axes = tuple(range(1, values.ndim)) if values.ndim == 4 else (0,)
            step = np.maximum(np.abs(values).max(axes, keepdims=True), 1e-12) / 127
            tensor.CopyFrom(
                numpy_helper.from_array((np.round(values / step) * step).astype(np.float32), tensor.name)
            )
    return model


def free_size(bundle: Path, work: Path) -> Path | None:
    """Return a denoiser of the bundle that takes any size: its own, or one exported anew; None if neither
    can be had.
    """
    side = open_bundle(bundle, verify=False).latent_size
    shape = read_onnx(bundle / "unet" / "model.onnx").inputs["sample"].shape
    if shape is None or shape[2] != side:
        return bundle / "unet"
    if bundle.name != DEFAULT_MODEL:
        return None

    def example(rows: int, size: int) -> dict[str, torch.Tensor]:
        text, steps = torch.randn(rows, MAX_TOKENS, WIDTH), torch.arange(rows)
        latents = torch.randn(rows, LATENT_CHANNELS, size, size)
        return {"sample": latents, "timestep": steps, "encoder_hidden_states": text}

    axes = {name: {0: "rows"} for name in example(1, 8)}
    axes["sample"] |= {2: "height", 3: "width"}
    export_graph(
        restore_networks(bundle)[2],
        example(2, side),
        ["out_sample"],
        work / "free size",
        dynamic_axes=axes,
        check_inputs=[example(2, side // 2)],
    )
    return work / "free size"


def measure(
    difference: Difference, reference: Difference, cases: list[tuple[np.ndarray, int]]
) -> dict[str, float]:
    """Return seconds, their ratio to the reference's, and the error; runs alternate with the reference's."""
    mine = its = wrong = right = 0.0
    difference(*cases[0])
    # A median a noise level, and the mean of them: a way may be cheaper at some levels alone.
    for noisy, timestep in cases:
        spent: list[tuple[float, float]] = []
        for _ in range(ROUNDS):
            began = time.perf_counter()
            expected = reference(noisy, timestep)
            between = time.perf_counter()
            found = difference(noisy, timestep)
            spent.append((time.perf_counter() - between, between - began))
        mine += statistics.median(row[0] for row in spent) / len(cases)
        its += statistics.median(row[1] for row in spent) / len(cases)
        wrong += float(np.square(found - expected, dtype=np.float64).sum())
        right += float(np.square(expected, dtype=np.float64).sum())
    return {
        "seconds": round(mine, 4),
        "relative_time": round(mine / its, 3),
        "error": round((wrong / right) ** 0.5, 5),
    }


def plot(rows: dict[str, dict[str, float]], path: Path) -> None:
    """Draw relative time (across) against error (up, logarithmic; exact ways stand at 1e-5)."""
    figure = Figure(figsize=(9, 5), layout="constrained")
    axes = figure.subplots()
    axes.set_yscale("log")
    axes.set_ylim(2e-6, 10)
    axes.grid(visible=True, color="#dddddd")
    axes.set_xlabel("time, relative to fp32 on a batch of 2")
    axes.set_ylabel("error of eps_cond - eps_uncond (1e-5: none)")
    for name, row in rows.items():
        x, y = row["relative_time"], max(row["error"], 1e-5)
        axes.plot([x], [y], "o", color="#2060a0" if name == REFERENCE else "#b03030")
        # Exact ways share a height: their names stand upright above them.
        turn = 60 if y == 1e-5 else 0
        axes.annotate(name, (x, y), (6, 4), textcoords="offset points", fontsize=8, rotation=turn)
    figure.savefig(path, dpi=100, metadata={"Software": None})


def main(folder: Path) -> dict[str, Any]:
    """Measure every way; draw denoiser.png."""
    bundle = bundle_folder(os.environ.get("MODEL") or DEFAULT_MODEL)
    texts, cases = inputs(bundle)
    unet, total = bundle / "unet", len(load_schedule(bundle / "scheduler").alphas_cumprod)
    cores = len(os.sched_getaffinity(0))
    rows: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as work, ExitStack() as stack:
        exact = stack.enter_context(denoiser(unet))
        reference = guided(exact, texts)
        rows[REFERENCE] = measure(reference, reference, cases)
        pool = stack.enter_context(ThreadPoolExecutor(2))
        rows["two runs in turn"] = measure(concurrent_in_turn(exact, texts), reference, cases)
        with denoiser(unet, threads=max(1, cores // 2)) as single:
            rows["two runs at once"] = measure(concurrent(single, texts, pool), reference, cases)
        for threads in sorted({1, cores // 2, 2 * cores} - {0, cores}):
            with denoiser(unet, threads=threads) as other:
                rows[f"{threads} thread{'s' * (threads > 1)}"] = measure(
                    guided(other, texts), reference, cases
                )
        for name, place in quantised(unet, Path(work), texts, cases).items():
            with denoiser(place) as other:
                rows[name] = measure(guided(other, texts), reference, cases)
        if "OpenVINOExecutionProvider" in onnxruntime.get_available_providers():
            with denoiser(unet, provider="openvino") as other:
                rows["OpenVINO"] = measure(guided(other, texts), reference, cases)
        if (free := free_size(bundle, Path(work))) is None:
            print(f"half resolution: left out, {unet} is fixed to {cases[0][0].shape[-1]} latents a side")
        else:
            with denoiser(free) as other:
                rows["half resolution"] = measure(coarse(guided(other, texts)), reference, cases)
        skipping = without_unconditional(exact, texts, reference, int(SKIP_ABOVE * total))
        rows[f"no unconditional pass above {SKIP_ABOVE:g}"] = measure(skipping, reference, cases)
    plot(rows, folder / "denoiser.png")
    table = markdown(
        ("way", "time", "error"), [(n, row["relative_time"], row["error"]) for n, row in rows.items()]
    )
    (folder / "denoiser.md").write_text(table, encoding="utf-8")
    summary = {name: [row["relative_time"], row["error"]] for name, row in rows.items()}
    return {"summary": summary, "model": bundle.name, "load_at_end": os.getloadavg(), "rows": rows}


def concurrent_in_turn(denoise: Denoise, texts: np.ndarray) -> Difference:
    """Return the difference from two runs on one row each, one after the other."""

    def difference(noisy: np.ndarray, timestep: int) -> np.ndarray:
        told, without = (denoise(noisy, np.array([timestep]), texts[i : i + 1])[0] for i in range(2))
        return told - without

    return difference
