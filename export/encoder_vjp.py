"""The input gradient of a VAE encoder as a plain inference graph, `vae_encoder_vjp/model.onnx`.

Refinement in RGB needs d loss / d pixels from d loss / d latents, and the runtime has no autograd over ONNX.
So the vector-Jacobian product itself is traced: forward and backward become one graph of ordinary operators,
with inputs `sample` (b, 3, H, W) in [-1, 1] and `cotangent` (b, c, h, w), and the output `gradient` of the
sample's shape. Latents here are the encoder's own mean, before the latent scale.

What autograd calls has no ONNX counterpart in places, and is replaced while tracing: decompositions for
normalisations, activations, softmax and slices, and `_convolution_backward`, which only needs the gradient of
the input. The sizes of the example are baked in: one graph, one image size, one batch.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch._decomp import get_decompositions
from torch.fx.experimental.proxy_tensor import make_fx
from torch.nn.attention import SDPBackend, sdpa_kernel

from export.graph import export_graph, round_to_half

INPUTS = ("sample", "cotangent")
OUTPUT = "gradient"
_DECOMPOSED = (
    torch.ops.aten.native_group_norm,
    torch.ops.aten.native_group_norm_backward,
    torch.ops.aten.native_layer_norm_backward,
    torch.ops.aten.gelu_backward,
    torch.ops.aten.elu_backward,
    torch.ops.aten.leaky_relu_backward,
    torch.ops.aten.threshold_backward,
    torch.ops.aten.tanh_backward,
    torch.ops.aten.sigmoid_backward,
    torch.ops.aten.hardtanh_backward,
    torch.ops.aten._softmax_backward_data,
    torch.ops.aten.select_backward,
    torch.ops.aten.slice_backward,
)


class EncoderVjp(nn.Module):
    """The gradient by autograd: what is traced, and what the exported graph is compared with."""

    def __init__(self, encoder: nn.Module) -> None:
        super().__init__()
        self.encoder = encoder

    def forward(self, sample: Tensor, cotangent: Tensor) -> Tensor:
        """Return d <cotangent, encoder(sample)> / d sample."""
        pull = torch.func.vjp(self.encoder, sample)[1]
        with (
            torch.no_grad()
        ):  # else autograd takes formulas that can be differentiated again, with large constants
            return pull(cotangent)[0]


def export_encoder_vjp(
    encoder: nn.Module,
    sample: Tensor,
    folder: Path,
    *,
    half_weights: bool = False,
    tolerance: float = 1e-4,
) -> float:
    """Write the input gradient of `encoder` as `folder/model.onnx`, return its largest difference.

    `encoder`: pictures (b, 3, H, W) in [-1, 1] -> mean latents (b, c, h, w). `sample`: an example, whose
    sizes the graph keeps. `folder`: `<bundle>/vae_encoder_vjp`. `half_weights`, `tolerance`, errors: as
    `export_graph`; the reference is autograd, and a second picture and cotangent show that no value of the
    example was baked in.
    """
    encoder = copy.deepcopy(encoder).eval().requires_grad_(False)
    if half_weights:
        round_to_half(encoder)
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        cotangent = torch.randn(encoder(sample).shape, generator=generator)
    reference = EncoderVjp(encoder)
    with sdpa_kernel(SDPBackend.MATH):  # the fused kernels' backward is one opaque operator
        traced = make_fx(
            torch.func.functionalize(lambda x, y: reference(x, y), remove="mutations_and_views"),
            decomposition_table=_table(),
        )(sample, cotangent)
    others = (
        torch.rand(sample.shape, generator=generator) * 2 - 1,
        torch.randn(cotangent.shape, generator=generator),
    )
    return export_graph(
        _Named(traced),
        dict(zip(INPUTS, (sample, cotangent))),
        [OUTPUT],
        folder,
        check_inputs=[dict(zip(INPUTS, others))],
        half_weights=half_weights,
        tolerance=tolerance,
        reference=reference,
    )


class _Named(nn.Module):
    """A traced graph numbers its arguments; the exporter wants their names."""

    def __init__(self, traced: nn.Module) -> None:
        super().__init__()
        self.traced = traced

    def forward(self, sample: Tensor, cotangent: Tensor) -> Tensor:
        """Run the traced graph: (b, 3, h, w), (b, c, h, w) to (b, 3, h, w)."""
        return self.traced(sample, cotangent)


def _table() -> dict[Any, Callable[..., Any]]:
    table: dict[Any, Callable[..., Any]] = dict(get_decompositions(list(_DECOMPOSED)))
    table[torch.ops.aten.convolution_backward.default] = _convolution_backward
    table[torch.ops.aten.silu_backward.default] = _silu_backward
    table[torch.ops.aten.replication_pad2d_backward.default] = _replication_pad2d_backward
    table[torch.ops.aten._safe_softmax.default] = _softmax
    return table


def _silu_backward(gradient: Tensor, value: Tensor) -> Tensor:
    """Return the gradient of x sigmoid(x). torch's decomposition stores ones as large as x."""
    gate = torch.sigmoid(value)
    return gradient * gate * (1 + value * (1 - gate))


def _replication_pad2d_backward(gradient: Tensor, sample: Tensor, padding: list[int]) -> Tensor:
    """Return the gradient of repeating the edge: what fell on the copies belongs to the edge."""
    left, right, top, bottom = padding
    for axis, before, after in ((3, left, right), (2, top, bottom)):
        count = gradient.shape[axis]
        first = gradient.narrow(axis, 0, before + 1).sum(axis, keepdim=True)
        last = gradient.narrow(axis, count - after - 1, after + 1).sum(axis, keepdim=True)
        middle = gradient.narrow(axis, before + 1, count - before - after - 2)
        gradient = torch.cat([first, middle, last], axis)
    return gradient


def _softmax(scores: Tensor, dim: int, dtype: torch.dtype | None = None) -> Tensor:
    """Return the softmax. torch's "safe" one, meant for masks, stores as many zeros as scores."""
    return torch.ops.aten._softmax.default(scores if dtype is None else scores.to(dtype), dim, False)


def _convolution_backward(
    gradient: Tensor,
    sample: Tensor,
    weight: Tensor,
    bias_sizes: list[int] | None,
    stride: list[int],
    padding: list[int],
    dilation: list[int],
    transposed: bool,
    output_padding: list[int],
    groups: int,
    output_mask: list[bool],
) -> tuple[Tensor, None, None]:
    """Return the gradient of a convolution's input alone: the transposed convolution of the same weights.

    Rows and columns that a stride skipped at the far end are given back as `output_padding`.
    """
    if transposed:
        raise NotImplementedError("an encoder with transposed convolutions")
    lost = [
        size - ((out - 1) * step - 2 * pad + wide * (kernel - 1) + 1)
        for size, out, step, pad, wide, kernel in zip(
            sample.shape[2:], gradient.shape[2:], stride, padding, dilation, weight.shape[2:]
        )
    ]
    back = torch.ops.aten.convolution.default(
        gradient, weight, None, stride, padding, dilation, True, lost, groups
    )
    return back, None, None
