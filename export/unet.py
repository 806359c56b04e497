"""The denoiser as a graph: `sample`, `timestep`, `encoder_hidden_states` to `out_sample`.

A timestep a row, where Optimum's graph takes one for all: views of one step are noised differently. A UNet of
a latent consistency model also takes `timestep_cond`, as Optimum's does.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from export.attention import fuse_attention
from export.graph import export_graph

TIMESTEPS = 1000


class UNetGraph(nn.Module):
    """A diffusers UNet2DConditionModel with the arguments of the graph."""

    def __init__(self, unet: Any) -> None:
        super().__init__()
        self.unet = unet

    def forward(
        self,
        sample: Tensor,
        timestep: Tensor,
        encoder_hidden_states: Tensor,
        timestep_cond: Tensor | None = None,
    ) -> Tensor:
        """Return the network's raw output, the sample's shape."""
        result: Tensor = self.unet(
            sample, timestep, encoder_hidden_states, timestep_cond=timestep_cond, return_dict=False
        )[0]
        return result


def export_unet(
    unet: Any,
    length: int,
    folder: Path,
    *,
    fixed: bool = False,
    half_weights: bool = False,
    tolerance: float = 1e-4,
    release: bool = False,
) -> float:
    """Write a UNet as `folder/model.onnx`; return its largest difference from torch.

    `length`: tokens a text. `fixed`: the guided batch of 2 and the training size alone, else any batch and
    any size that the UNet can halve. `release`, errors: as `export_graph`. Its attention layers are replaced.
    """
    fuse_attention(unet)
    config = unet.config
    guidance = getattr(config, "time_cond_proj_dim", None)
    halvings = 2 ** (len(config.block_out_channels) - 1)

    def inputs(batch: int, height: int, width: int) -> dict[str, Tensor]:
        generator = torch.Generator().manual_seed(batch + height)
        feeds = {
            "sample": torch.randn(batch, config.in_channels, height, width, generator=generator),
            "timestep": torch.randint(0, TIMESTEPS, (batch,), generator=generator),
            "encoder_hidden_states": torch.randn(
                batch, length, config.cross_attention_dim, generator=generator
            ),
        }
        if guidance:
            feeds["timestep_cond"] = torch.randn(batch, guidance, generator=generator)
        return feeds

    size = config.sample_size
    example = inputs(2, size, size)
    axes = {name: {0: "batch"} for name in example}
    axes["sample"] |= {2: "height", 3: "width"}
    # A second size that is neither square nor the first one, and small: the check is of shapes.
    other = inputs(1, 2 * halvings, 3 * halvings)
    return export_graph(
        UNetGraph(unet),
        example,
        ["out_sample"],
        folder,
        dynamic_axes={} if fixed else axes,
        check_inputs=[] if fixed else [other],
        half_weights=half_weights,
        tolerance=tolerance,
        release=release,
    )
