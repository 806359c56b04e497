"""Attention as one node: com.microsoft::MultiHeadAttention in place of the exporter's matrix products.

onnxruntime does not find attention again in what torch exports, and its fused kernel needs neither the
memory of the score matrix (at 64 x 64 latents 4096 x 4096 a head) nor its time. While a graph is exported,
the processor below emits that node; at any other time it computes the same with torch, so the module that
is exported is also its own reference.
"""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn


class FusedAttention:
    """A diffusers attention processor. Plain attention only, as UNets and VAEs of SD's class have it."""

    def __call__(
        self,
        attn: Any,
        hidden_states: Tensor,
        encoder_hidden_states: Tensor | None = None,
        attention_mask: Tensor | None = None,
        temb: Tensor | None = None,
    ) -> Tensor:
        """Return the layer's output; pictures (b, c, h, w) are rows of pixels while they attend.

        Raises NotImplementedError for a mask or another addition that the node could not express.
        """
        residual = hidden_states
        unusual = [n for n in ("spatial_norm", "norm_q", "norm_k", "norm_cross") if getattr(attn, n, None)]
        unusual += [] if attention_mask is None else ["attention_mask"]
        if unusual:
            raise NotImplementedError(f"attention with {', '.join(unusual)}")
        if is_picture := hidden_states.ndim == 4:
            hidden_states = hidden_states.flatten(2).transpose(1, 2)
        if attn.group_norm is not None:
            hidden_states = attn.group_norm(hidden_states.transpose(1, 2)).transpose(1, 2)
        seen = hidden_states if encoder_hidden_states is None else encoder_hidden_states
        mixed = multi_head_attention(
            attn.to_q(hidden_states), attn.to_k(seen), attn.to_v(seen), attn.heads, attn.scale
        )
        mixed = attn.to_out[1](attn.to_out[0](mixed))
        if is_picture:
            mixed = mixed.transpose(1, 2).reshape(residual.shape)
        if attn.residual_connection:
            mixed = mixed + residual
        return mixed / attn.rescale_output_factor


def multi_head_attention(query: Tensor, key: Tensor, value: Tensor, heads: int, scale: float) -> Tensor:
    """Return softmax(scale q k^T) v of every head; (b, rows, heads x width) all of them."""
    if torch.onnx.is_in_onnx_export():
        return torch.onnx.ops.symbolic(
            "com.microsoft::MultiHeadAttention",
            (query, key, value),
            {"num_heads": heads, "scale": float(scale)},
            dtype=query.dtype,
            shape=query.shape,
            version=1,
        )
    q, k, v = (x.unflatten(2, (heads, -1)).transpose(1, 2) for x in (query, key, value))
    return F.scaled_dot_product_attention(q, k, v, scale=scale).transpose(1, 2).flatten(2)


def fuse_attention(module: nn.Module) -> None:
    """Give every attention layer of a diffusers model the processor above, in place."""
    layer: Any
    for layer in module.modules():
        if hasattr(layer, "set_processor") and hasattr(layer, "to_q"):
            layer.set_processor(FusedAttention())
