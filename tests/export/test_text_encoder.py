"""The exported text encoder equals transformers', with and without rows after its vocabulary."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from transformers import CLIPTextConfig, CLIPTextModel

from export.text_encoder import export_text_encoder
from pipeline.diffusion.sessions import text_encoder
from pipeline.errors import InputError
from tests.tiny_bundle import write_text_encoder

VOCABULARY, WIDTH, LENGTH = 20, 16, 12


def clip_text_model() -> Any:
    torch.manual_seed(0)
    return CLIPTextModel(
        CLIPTextConfig(
            vocab_size=VOCABULARY, hidden_size=WIDTH, intermediate_size=32, num_hidden_layers=2,
            num_attention_heads=2, max_position_embeddings=LENGTH, bos_token_id=18, eos_token_id=19,
            pad_token_id=19,
        )
    ).eval()  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bundle") / "text_encoder"
    assert export_text_encoder(clip_text_model(), LENGTH, folder) < 1e-4
    return folder


def reference(ids: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
    """What transformers gives, its own table resized for the learnt rows."""
    model = clip_text_model()
    if rows is not None:
        model.resize_token_embeddings(VOCABULARY + len(rows), mean_resizing=False)
        model.get_input_embeddings().weight.data[VOCABULARY:] = torch.tensor(rows)
    with torch.no_grad():
        output: np.ndarray = model(input_ids=torch.tensor(ids)).last_hidden_state.numpy()
    return output


IDS = np.array([[18, 3, 4, 5] + [19] * 8, [18, 7] + [19] * 10])


def test_plain_text_is_as_in_transformers(folder: Path) -> None:
    with text_encoder(folder) as encode:
        np.testing.assert_allclose(encode(IDS), reference(IDS), atol=1e-4)


def test_ids_past_the_vocabulary_pick_the_learnt_rows(folder: Path) -> None:
    rows = np.random.default_rng(0).normal(size=(2, WIDTH)).astype(np.float32)
    ids = IDS.copy()
    ids[0, 2], ids[1, 1] = VOCABULARY, VOCABULARY + 1
    with text_encoder(folder, rows) as encode:
        np.testing.assert_allclose(encode(ids), reference(ids, rows), atol=1e-4)
        np.testing.assert_allclose(encode(IDS), reference(IDS), atol=1e-4)


def test_rows_of_another_width_and_graphs_without_the_input_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="its tokens have 16 numbers, the learnt one has 8"):
        text_encoder(folder, np.zeros((1, 8), np.float32)).__enter__()
    write_text_encoder(tmp_path / "plain", vocabulary=20)
    with pytest.raises(InputError, match="takes no learnt token"):
        text_encoder(tmp_path / "plain", np.zeros((1, WIDTH), np.float32)).__enter__()
