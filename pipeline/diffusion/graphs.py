"""One ONNX graph, opened in onnxruntime.

Exporters disagree about names, types and ranks (Optimum, diffusers' script, Olive). The graph's own
signature decides: every feed is cast to it, inputs that the graph lacks are dropped.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from pipeline.diffusion.bundle import check_graph
from pipeline.diffusion.onnx_file import OnnxFile
from pipeline.diffusion.providers import provider_chain
from pipeline.documents import whole_number
from pipeline.errors import InputError

Array: TypeAlias = np.ndarray

_DTYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(int32)": np.int32,
    "tensor(int64)": np.int64,
    "tensor(bool)": np.bool_,
}
# No network of a working bundle comes near this; a flipped exponent bit in a weight passes it.
LARGEST_OUTPUT = 1e6


class Graph:
    """One open ONNX graph: `run` casts named feeds to its signature and returns named float32 outputs."""

    def __init__(self, outline: OnnxFile, threads: int | None = None, provider: str = "cpu") -> None:
        import onnxruntime

        path = outline.path

        options = onnxruntime.SessionOptions()
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_ALL
        options.intra_op_num_threads = usable_threads() if threads is None else threads
        # Its threads may spin while a run lasts (a tenth faster), but not between runs, when the cores belong
        # to torch and numba.
        options.add_session_config_entry("session.force_spinning_stop", "1")
        options.log_severity_level = (
            4  # faults arrive as exceptions; its log would repeat them on the terminal
        )
        onnxruntime.set_seed(0)  # a VAE encoder that samples in the graph must repeat itself
        self.path = path
        chain = provider_chain(provider)
        try:
            # A path, not bytes: external weights are found beside the file, and mapped, not read.
            self.session: Any = onnxruntime.InferenceSession(str(path), sess_options=options, providers=chain)
        except Exception as error:
            # onnxruntime's exceptions share no base class but Exception.
            raise InputError(f"{path}: {explain_load_error(str(error))}") from error
        if (running := self.session.get_providers())[0] != chain[0]:
            # onnxruntime falls back in silence when, say, the libraries of CUDA are missing.
            raise InputError(
                f"PROVIDER is {provider!r}, but it did not start (onnxruntime would use {running[0]}): "
                "install its drivers and libraries, or choose another one"
            )
        # onnxruntime's shapes do not tell a scalar from an input of unknown rank; the file does.
        self.shapes = {name: port.shape for name, port in outline.inputs.items()}
        self.types = {port.name: port.type for port in self.session.get_inputs()}
        self.outputs = [port.name for port in self.session.get_outputs()]

    def axis(self, name: str, axis: int) -> int | None:
        """Return the size that the graph fixes for an axis of an input, None where any size will do."""
        shape = self.shapes.get(name) or ()
        return shape[axis] if axis < len(shape) else None

    def rank(self, name: str) -> int | None:
        """Return the number of axes of an input, None when the graph lacks it or takes any number."""
        shape = self.shapes.get(name)
        return None if shape is None else len(shape)

    def run(self, feeds: dict[str, Array]) -> dict[str, Array]:
        """Run once, dropping feeds that the graph lacks. Raises InputError for an input without a feed."""
        if missing := [name for name in self.types if name not in feeds]:
            raise InputError(
                f"{self.path}: wants the input(s) {', '.join(missing)}, this program has {', '.join(feeds)}; "
                "export the model with the usual inputs"
            )
        cast = {name: self._cast(name, feeds[name]) for name in self.types}
        values = self.session.run(self.outputs, cast)
        return {name: np.asarray(value, np.float32) for name, value in zip(self.outputs, values, strict=True)}

    def _cast(self, name: str, value: Array) -> Array:
        kind, shape = self.types[name], self.shapes.get(name)
        if kind not in _DTYPES:
            raise InputError(f"{self.path}: input {name} is {kind}, expected one of {', '.join(_DTYPES)}")
        with np.errstate(over="ignore"):  # half precision ends at 65504
            value = np.asarray(value, _DTYPES[kind], order="C")
        if not np.isfinite(value).all():
            raise FloatingPointError(
                f"{self.path}: the input {name} holds NaN, infinity or more than its {kind} can hold, "
                "before the network runs"
            )
        if shape is None:
            return value
        if value.ndim != len(shape):
            raise InputError(f"{self.path}: input {name} has {len(shape)} axes, expected {value.ndim}")
        for axis, (found, wanted) in enumerate(zip(value.shape, shape, strict=True)):
            if wanted is not None and wanted != found:
                raise InputError(
                    f"{self.path}: input {name} is fixed to {wanted} on axis {axis}, here it is {found}; "
                    "use that size, or export the model with a free one"
                )
        return value

    def pick(self, outputs: dict[str, Array], names: tuple[str, ...], rank: int, when: str = "") -> Array:
        """Return the output with one of `names`, or the only one of that rank, checked to be sane."""
        name = next((name for name in names if name in outputs), None)
        if name is None:
            fitting = [name for name, value in outputs.items() if value.ndim == rank]
            if len(fitting) != 1:
                raise InputError(
                    f"{self.path}: its outputs are {', '.join(outputs)}, expected {' or '.join(names)}; "
                    "export the model with the usual names"
                )
            name = fitting[0]
        value = outputs[name]
        largest = float(np.abs(value).max(initial=0.0))
        if not largest < LARGEST_OUTPUT:  # NaN compares false
            what = f"values up to {largest:.1e}" if np.isfinite(largest) else "NaN or infinity"
            raise InputError(
                f"{self.path}: the output {name} holds {what}{when}, expected finite values below "
                f"{LARGEST_OUTPUT:.0e}; the weights are damaged or overflow fp16: copy or export them again"
            )
        return value


def usable_threads() -> int:
    """Return the cores that this process may use; OMP_NUM_THREADS lowers it, as for torch and numpy."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, whole_number(os.environ.get("OMP_NUM_THREADS", "")) or cores)


def explain_load_error(message: str) -> str:
    """Return in plain words, one line, what onnxruntime says when it cannot load a model."""
    operator = re.search(
        r"No Op registered for (\w+)|(\S+)\(-?\d+\) is not a registered|implementation for (\w+)", message
    )
    if operator:
        name = next(group for group in operator.groups() if group)
        return (
            f"needs the operator {name}, which onnxruntime's CPU provider lacks; export it with standard ones"
        )
    if "Opset" in message or "IR version" in message:
        return "newer than this onnxruntime understands; export it at opset 20, or update onnxruntime"
    if "external" in message.lower():
        return (
            "its external weights are missing, too short or outside its folder; copy the whole folder again"
        )
    if "Protobuf parsing failed" in message or "raw_data size" in message:
        return "damaged or no ONNX model; copy or export the file again"
    reason = " ".join(
        re.sub(r"^.*?failed:|^\[ONNXRuntimeError\] : \d+ : \w+ : ", "", message, count=1).split()
    )
    return f"onnxruntime cannot load it ({reason[:300]}); export the model again"


@contextmanager
def open_graph(folder: Path, threads: int | None = None, provider: str = "cpu") -> Iterator[Graph]:
    """Open `folder/model.onnx` (checked first), give the Graph, and release its session at the end.

    `threads`: intra-op threads; None is every core this process may use. `provider`: a name of
    `providers.PROVIDERS`. Raises InputError with the
    file's name when it is missing, damaged or not loadable.
    """
    graph = Graph(check_graph(folder), threads, provider)
    try:
        yield graph
    finally:
        del graph.session  # frees the weights now, not when the last closure goes
