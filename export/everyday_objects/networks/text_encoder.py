"""The text encoder: a small transformer, trained with the denoiser."""

import torch
from torch import Tensor, nn
from torch.nn import functional as F

MAX_TOKENS = 32
WIDTH = 192


class TextEncoder(nn.Module):
    """Token ids (b, l) to embeddings (b, l, WIDTH), bidirectional; padding is a token like any other."""

    def __init__(self, vocabulary: int, width: int = WIDTH, layers: int = 3, heads: int = 4) -> None:
        super().__init__()
        self.tokens = nn.Embedding(vocabulary, width)
        self.positions = nn.Parameter(0.02 * torch.randn(MAX_TOKENS, width))
        self.layers = nn.ModuleList(TextLayer(width, heads) for _ in range(layers))
        self.norm = nn.LayerNorm(width)
        nn.init.normal_(self.tokens.weight, std=0.02)

    def forward(self, input_ids: Tensor, token_embeddings: Tensor | None = None) -> Tensor:
        """Encode; `token_embeddings` (n, WIDTH) are learned tokens, whose ids follow the vocabulary's."""
        table = self.tokens.weight
        if token_embeddings is not None:
            table = torch.cat([table, token_embeddings])
        x = F.embedding(input_ids, table) + self.positions[: input_ids.shape[1]]
        for layer in self.layers:
            x = layer(x)
        return self.norm(x)


class TextLayer(nn.Module):
    """Pre-norm self-attention and a two-layer perceptron."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm1, self.norm2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.qkv, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.mlp = nn.Sequential(nn.Linear(width, 3 * width), nn.GELU(), nn.Linear(3 * width, width))

    def forward(self, x: Tensor) -> Tensor:
        """(b, l, width) to the same shape."""
        b, length, width = x.shape
        q, k, v = (
            self.qkv(self.norm1(x)).view(b, length, 3, self.heads, width // self.heads).permute(2, 0, 3, 1, 4)
        )
        y = torch.softmax(q @ k.transpose(-1, -2) * (q.shape[-1] ** -0.5), dim=-1) @ v
        x = x + self.out(y.transpose(1, 2).reshape(b, length, width))
        return x + self.mlp(self.norm2(x))
