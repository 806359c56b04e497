"""The text encoder as a graph: token ids to hidden states, with room for rows learnt by textual inversion.

Inputs: `input_ids` (b, l) int64 and `token_embeddings` (n, d) float32. The second one's rows are appended to
the vocabulary's, so the id `vocabulary size + i` picks row i: a learnt token needs no other graph. A text
without such tokens gives one row of zeros, which no id picks. Outputs as Optimum's: `last_hidden_state`
(b, l, d) and `pooler_output` (b, d).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from export.graph import export_graph

OUTPUTS = ("last_hidden_state", "pooler_output")


class TextEncoderGraph(nn.Module):
    """A transformers CLIPTextModel, whose embedding table grows by the rows given with each text."""

    def __init__(self, model: Any) -> None:
        super().__init__()
        # transformers 5 dropped a level.
        embeddings = getattr(model, "text_model", model).embeddings
        # Graphs of a call's mask builder hold shapes of the example; additive masks of "eager" do not.
        model.set_attn_implementation("eager")
        self.table = _GrowingTable(embeddings.token_embedding)
        embeddings.token_embedding = self.table
        self.model = model

    @property
    def vocabulary(self) -> int:
        """Rows of the table as it was trained."""
        return len(self.table.weight)

    @property
    def width(self) -> int:
        """Numbers a row."""
        return self.table.weight.shape[1]

    def forward(self, input_ids: Tensor, token_embeddings: Tensor) -> tuple[Tensor, Tensor]:
        """Encode (see above)."""
        self.table.extra = [token_embeddings]
        try:
            result = self.model(input_ids=input_ids)
        finally:
            self.table.extra = []
        return result.last_hidden_state, result.pooler_output


class _GrowingTable(nn.Module):
    """An embedding table and, during a call, rows after its own (in a list: no part of the module)."""

    def __init__(self, table: nn.Embedding) -> None:
        super().__init__()
        self.weight = table.weight
        self.extra: list[Tensor] = []

    def forward(self, ids: Tensor) -> Tensor:
        """Look up ids, those behind the vocabulary among the extra embeddings."""
        return torch.cat([self.weight, *self.extra])[ids]


def export_text_encoder(
    model: Any,
    length: int,
    folder: Path,
    *,
    half_weights: bool = False,
    tolerance: float = 1e-4,
    release: bool = False,
) -> float:
    """Write a CLIPTextModel as `folder/model.onnx`; return its largest difference from torch.

    `length`: tokens a text. `release`, errors: as `export_graph`. The model's embedding table is
    replaced on the way.
    """
    module = TextEncoderGraph(model).eval()

    def texts(count: int, extra: int) -> dict[str, Tensor]:
        generator = torch.Generator().manual_seed(count)
        ids = torch.randint(0, module.vocabulary + extra, (count, length), generator=generator)
        # Every row that was appended is picked at least once; the last id is the end of the text.
        ids[:, :extra] = module.vocabulary + torch.arange(extra)
        ids[:, -1] = min(model.config.eos_token_id, module.vocabulary - 1)
        return {"input_ids": ids, "token_embeddings": torch.randn(extra, module.width, generator=generator)}

    return export_graph(
        module,
        texts(2, 3),
        list(OUTPUTS),
        folder,
        dynamic_axes={"input_ids": {0: "batch"}, "token_embeddings": {0: "tokens"}},
        check_inputs=[texts(3, 1)],
        half_weights=half_weights,
        tolerance=tolerance,
        release=release,
    )
