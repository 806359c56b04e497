"""Export one torch module as an ONNX graph, run it, and compare it with torch.

An export is not done until its result was compared: `export_graph` returns the largest difference and
raises when it is too large, leaving the folder as it was.

Half-precision storage: with `half_weights` the parameters are rounded to fp16 *in torch first*; the file
then stores every fp32 constant that survives the round trip exactly (so, all those parameters) as fp16
with a Cast to fp32 in front of its use. Nothing is lost between torch and file, and the comparison tests
the export alone. onnxruntime folds the Casts when it opens the file: half the disk, the same speed, fp32
arithmetic throughout.
"""

from __future__ import annotations

import contextlib
import copy
import gc
import io
import logging
import os
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx_ir as ir
import torch

from pipeline.diffusion.graphs import open_graph

OPSET = 20  # from 23 on GroupNormalization is inlined into hundreds of small nodes
EXTERNAL_BYTES = 1_800_000_000  # a protocol-buffers message ends at 2 GB
MIN_HALF_ELEMENTS = 256  # smaller constants are not worth a Cast node


def export_graph(
    module: torch.nn.Module,
    inputs: Mapping[str, torch.Tensor],
    outputs: Sequence[str],
    folder: Path,
    *,
    dynamic_axes: Mapping[str, Mapping[int, str]] | None = None,
    check_inputs: Sequence[Mapping[str, torch.Tensor]] = (),
    half_weights: bool = False,
    tolerance: float = 1e-4,
    reference: torch.nn.Module | None = None,
    release: bool = False,
) -> float:
    """Write `module` as `folder/model.onnx` and return its largest difference from torch.

    `inputs`: example inputs by name, in the order of `module.forward`'s arguments; give dynamic axes a
    size above 1, since torch.export treats 0 and 1 as constants.
    `outputs`: names of the outputs, in order.
    `dynamic_axes`: {input: {axis: name of the size}}, equal names are equal sizes; other axes are fixed.
    `check_inputs`: further inputs to compare on, say of another batch or size.
    `half_weights`: store the weights as fp16 (see above); the module's own weights are not changed.
    `tolerance`: largest |onnx - torch| allowed, relative to max(1, max |torch|) of that output.
    `reference`: compare with this module, of the same arguments, instead of with `module` itself.
    `release`: give up the weights of `module` before onnxruntime loads its own; it is of no use afterwards.
    Raises ValueError when the difference is larger or not finite, or a weight does not fit fp16.
    """
    # A copy only where weights change: a large network twice in memory is more than many machines have.
    exported = (copy.deepcopy(module) if half_weights else module).eval().requires_grad_(False)
    if half_weights:
        round_to_half(exported)
    reference = exported if reference is None else reference
    with _quiet():
        program = torch.onnx.export(
            exported,
            kwargs=dict(inputs),
            input_names=list(inputs),
            output_names=list(outputs),
            opset_version=OPSET,
            dynamo=True,
            dynamic_shapes={name: dict((dynamic_axes or {}).get(name, {})) for name in inputs},
        )
    assert program is not None
    model = program.model
    if half_weights:
        store_as_half(model)
    _drop_notes(model)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as scratch:
        _save(model, Path(scratch))
        cases = [(feeds, _in_torch(reference, feeds)) for feeds in (inputs, *check_inputs)]
        if release:
            # Caches of the exporter still refer to the module's tensors and to the graph: empty both.
            for tensor in (*module.parameters(), *module.buffers()):
                tensor.data = torch.empty(0)
            for value in model.graph.initializers.values():
                value.const_value = None
            del program, model, exported, reference
            gc.collect()
        difference = max(
            _largest_difference(expected, Path(scratch), feeds, outputs) for feeds, expected in cases
        )
        if not difference <= tolerance:  # also catches NaN
            raise ValueError(
                f"{folder.name}: the exported graph differs from torch by {difference:.2e}, expected at most "
                f"{tolerance:.0e}; it was not installed"
            )
        folder.mkdir(exist_ok=True)
        for stale in ("model.onnx", "model.onnx_data"):
            (folder / stale).unlink(missing_ok=True)
        for file in sorted(Path(scratch).iterdir(), reverse=True):  # the weights first, then the graph
            os.replace(file, folder / file.name)
    return difference


def round_to_half(module: torch.nn.Module) -> None:
    """Round the fp32 parameters to fp16 values in place; buffers (tables, statistics) stay as they are.

    Raises ValueError when a parameter does not fit fp16.
    """
    for name, parameter in module.named_parameters():
        if parameter.dtype == torch.float32:
            rounded = parameter.data.half().float()
            if not torch.isfinite(rounded).all():
                raise ValueError(f"{name}: values up to {parameter.abs().max():.3g} do not fit fp16 (65504)")
            parameter.data.copy_(rounded)


def store_as_half(model: ir.Model) -> None:
    """Replace every fp32 initializer that fp16 holds exactly by its fp16 copy and a Cast to fp32."""
    graph = model.graph
    for name, value in list(graph.initializers.items()):
        tensor = value.const_value
        if tensor is None or tensor.dtype != ir.DataType.FLOAT or tensor.size < MIN_HALF_ELEMENTS:
            continue
        full = tensor.numpy()
        with np.errstate(over="ignore"):
            half = full.astype(np.float16)
        if not np.array_equal(half.astype(np.float32), full):
            continue
        stored = ir.Value(
            name=f"{name}_half",
            type=ir.TensorType(ir.DataType.FLOAT16),
            shape=ir.Shape(half.shape),
            const_value=ir.tensor(half, name=f"{name}_half"),
        )
        cast = ir.node("Cast", [stored], {"to": int(ir.DataType.FLOAT)}, name=f"{name}_cast")
        value.replace_all_uses_with(cast.outputs[0])
        del graph.initializers[name]
        cast.outputs[0].name = name
        graph.register_initializer(stored)
        graph.insert_before(graph[0], cast)


def _drop_notes(model: ir.Model) -> None:
    """Drop the exporter's stack traces: they hold the paths of this machine and a third of a small file."""
    for node in model.graph.all_nodes():
        node.metadata_props.clear()
        node.doc_string = None
    for value in (*model.graph.inputs, *model.graph.outputs, *model.graph.initializers.values()):
        value.metadata_props.clear()
    model.graph.metadata_props.clear()
    model.metadata_props.clear()


def _save(model: ir.Model, folder: Path) -> None:
    size = sum(value.const_value.nbytes for value in model.graph.initializers.values() if value.const_value)
    ir.save(model, folder / "model.onnx", external_data="model.onnx_data" if size > EXTERNAL_BYTES else None)


def _in_torch(module: torch.nn.Module, feeds: Mapping[str, torch.Tensor]) -> tuple[torch.Tensor, ...]:
    with torch.no_grad():
        result = module(**feeds)
    return (result,) if isinstance(result, torch.Tensor) else tuple(result)


def _largest_difference(
    expected: Sequence[torch.Tensor],
    folder: Path,
    feeds: Mapping[str, torch.Tensor],
    outputs: Sequence[str],
) -> float:
    """Return max |onnx - torch| / max(1, max |torch|) over the outputs."""
    with open_graph(folder) as graph:
        found = graph.run({name: value.numpy() for name, value in feeds.items()})
    differences = []
    for name, told in zip(outputs, expected, strict=True):
        reference = told.numpy()
        if found[name].shape != reference.shape:
            raise ValueError(
                f"{folder.name}: {name} has shape {found[name].shape}, torch gives {reference.shape}"
            )
        differences.append(float(np.abs(found[name] - reference).max() / max(1.0, np.abs(reference).max())))
    return float(np.max(differences))


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep torch.export's chatter off the terminal; exceptions pass through."""
    level = logging.getLogger("torch.onnx").level
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            logging.getLogger("torch.onnx").setLevel(level)
