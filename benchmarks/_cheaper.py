"""A denoiser's graph made cheaper: by int8 arithmetic, by fewer bits of its weights, or free to take other
sizes."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnx
import onnx_ir as ir
import onnxruntime
import torch
from onnx import numpy_helper
from onnxruntime import quantization

from export.everyday_objects.networks.autoencoder import LATENT_CHANNELS
from export.everyday_objects.networks.denoiser import CAMERA
from export.everyday_objects.networks.text_encoder import MAX_TOKENS, WIDTH
from export.everyday_objects.train.export_bundle import DenoiserGraph
from export.everyday_objects.train.restore import restore_networks
from export.graph import export_graph, store_as_half
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.onnx_file import read_onnx
from pipeline.options.models import DEFAULT_MODEL


class Told(NamedTuple):
    """What the denoiser is told of the v views that it sees together."""

    texts: np.ndarray
    """(2 v, l, d): of each view, then without a text"""
    cameras: np.ndarray
    """(v, k) float32, the columns that the bundle lists; k 0: it is told none"""


class Calibration(quantization.CalibrationDataReader):  # type: ignore[misc]
    """The cases, as onnxruntime's quantiser wants them."""

    def __init__(self, session: Any, told: Told, cases: list[tuple[np.ndarray, int]]) -> None:
        kind = next(port.type for port in session.get_inputs() if port.name == "timestep")
        dtype = np.float32 if kind == "tensor(float)" else np.int64
        rank = len(next(port.shape for port in session.get_inputs() if port.name == "timestep"))
        taken = {port.name for port in session.get_inputs()}
        cameras = {"camera": np.tile(told.cameras, (2, 1))} if "camera" in taken else {}
        self.rows: Iterator[dict[str, np.ndarray]] = iter(
            {
                "sample": np.concatenate([noisy, noisy]),
                "timestep": np.full((2 * len(noisy),) if rank else (), timestep, dtype),
                "encoder_hidden_states": told.texts,
                **cameras,
            }
            for noisy, timestep in cases
        )

    def get_next(self) -> dict[str, np.ndarray] | None:
        """Return the next case."""
        return next(self.rows, None)


def quantised(folder: Path, work: Path, told: Told, cases: list[tuple[np.ndarray, int]]) -> dict[str, Path]:
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
        Calibration(session, told, cases),
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

    network = restore_networks(bundle)[2]
    rows = 2 * network.views
    export_graph(
        DenoiserGraph(network),
        example(rows, side),
        ["out_sample"],
        work / "free size",
        dynamic_axes=free_axes(),
        check_inputs=[example(rows, side // 2)],
    )
    return work / "free size"


def example(rows: int, size: int) -> dict[str, torch.Tensor]:
    """Return inputs of the default model's denoiser."""
    text, steps = torch.randn(rows, MAX_TOKENS, WIDTH), torch.arange(rows)
    latents, cameras = torch.randn(rows, LATENT_CHANNELS, size, size), torch.rand(rows, len(CAMERA))
    return {"sample": latents, "timestep": steps, "encoder_hidden_states": text, "camera": cameras}


def free_axes() -> dict[str, dict[int, str]]:
    """Return the axes of those inputs that may have any size."""
    axes = {name: {0: "rows"} for name in example(1, 8)}
    axes["sample"] |= {2: "height", 3: "width"}
    return axes
