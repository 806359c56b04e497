"""Learned tokens from every format, and what is wrong with bad ones."""

import json
import pickle
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from pipeline.diffusion.sessions import text_encoder
from pipeline.diffusion.token_files import read_token
from pipeline.diffusion.tokenizer import ClipTokenizer, load_tokenizer
from pipeline.diffusion.tokens import (
    Inserted,
    LearnedToken,
    TokenTable,
    insert_tokens,
    readable,
    token_table,
)
from pipeline.errors import InputError
from tests.tiny_bundle import VOCABULARY, WIDTH, write_tiny_bundle

TABLE = TokenTable(VOCABULARY, WIDTH)
VECTORS = torch.from_numpy(np.random.default_rng(0).normal(size=(3, WIDTH)).astype(np.float32))


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_bundle(tmp_path_factory.mktemp("models") / "tiny", learned_tokens=True)


@pytest.fixture(scope="module")
def tokenizer(bundle: Path) -> ClipTokenizer:
    return load_tokenizer(bundle / "tokenizer")


def a1111(tensor: Any) -> dict[str, Any]:
    return {"string_to_token": {"*": 265}, "string_to_param": {"*": tensor}, "name": "My Cat", "step": 500}


WRITERS: dict[str, tuple[Callable[[Path], None], str]] = {
    "cat.safetensors": (lambda path: save_file({"<cat>": VECTORS[0]}, path), "<cat>"),
    "many.safetensors": (lambda path: save_file({"<cat>": VECTORS}, path), "<cat>"),
    "half.safetensors": (lambda path: save_file({"<cat>": VECTORS.bfloat16()}, path), "<cat>"),
    "learned_embeds.bin": (lambda path: torch.save({"<cat>": VECTORS[0]}, path), "<cat>"),
    "zorblax.safetensors": (lambda path: save_file({"emb_params": VECTORS}, path), "zorblax"),
    "style.pt": (lambda path: torch.save(a1111(VECTORS), path), "My Cat"),
    "wrapped.pt": (
        lambda path: torch.save(
            a1111(VECTORS) | {"string_to_param": torch.nn.ParameterDict({"*": VECTORS})}, path
        ),
        "My Cat",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_is_read(tmp_path: Path, name: str) -> None:
    write, own = WRITERS[name]
    write(tmp_path / name)
    token = read_token(tmp_path / name)
    assert own in token.names
    assert Path(name).stem in token.names
    expected = VECTORS.bfloat16().float() if name.startswith("half") else VECTORS
    np.testing.assert_array_equal(token.vectors, expected[: len(token.vectors)])
    assert len(token.vectors) in (1, 3)


class Attack:
    """What a malicious file holds: a call on loading."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return (open, (str(self.path), "w"))


def safetensors_with(header: dict[str, Any] | None, length: int | None = None) -> bytes:
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text) if length is None else length) + text + bytes(4 * WIDTH)


BAD: dict[str, tuple[bytes, list[str]]] = {
    "a.safetensors": (safetensors_with({}, 2**63), ["no readable safetensors"]),
    "b.safetensors": (b"", ["0 bytes"]),
    "c.safetensors": (b"<!DOCTYPE html><html>", ["no readable safetensors"]),
    "d.safetensors": (
        safetensors_with({
            n: {"dtype": "F32", "shape": [WIDTH], "data_offsets": [0, 4 * WIDTH]} for n in ("x", "y")
        }),
        ["no readable safetensors"],
    ),
    "e.pt": (b"PK\x03\x04 half a zip", ["torch file"]),
    "f.bin": (pickle.dumps([1, 2]), ["TOKEN"]),
    "g.ckpt": (b"abc", [".ckpt", ".safetensors", ".pt"]),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_damaged_files_are_one_line(tmp_path: Path, name: str) -> None:
    content, words = BAD[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as error:
        read_token(tmp_path / name)
    assert "\n" not in str(error.value)
    for word in [name, *words]:
        assert word in str(error.value)


@pytest.mark.parametrize("wrap", [lambda attack: attack, lambda attack: {"<cat>": attack}])
@pytest.mark.parametrize("zipped", [True, False])
def test_nothing_in_a_file_runs(tmp_path: Path, wrap: Callable[[Attack], Any], zipped: bool) -> None:
    path = tmp_path / "cat.pt"
    torch.save(wrap(Attack(tmp_path / "ran")), path, _use_new_zipfile_serialization=zipped)
    with pytest.raises(InputError, match="more than numbers"):
        read_token(path)
    path.write_bytes(pickle.dumps(wrap(Attack(tmp_path / "ran"))))
    with pytest.raises(InputError, match="TOKEN"):
        read_token(path)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"a": VECTORS, "b": VECTORS}, ["2 entries", "'a'", "one learned embedding"]),
        ({}, ["0 entries"]),
        ({"a": torch.zeros(2, 3, 4)}, ["(2, 3, 4)"]),
        ({"a": torch.zeros(100, 4)}, ["100", "75"]),
        ({"a": torch.full((4,), torch.nan)}, ["NaN"]),
        ({"a": 3}, ["one learned embedding"]),
    ],
)
def test_what_is_no_embedding_is_said(tmp_path: Path, values: dict[str, Any], words: list[str]) -> None:
    torch.save(values, tmp_path / "cat.bin")
    with pytest.raises(InputError) as error:
        read_token(tmp_path / "cat.bin")
    for word in words:
        assert word in str(error.value)


def token(*names: str, count: int = 1, first: int = 0, width: int = WIDTH) -> LearnedToken:
    rows = np.arange(first, first + count, dtype=np.float32)[:, None].repeat(width, 1)
    return LearnedToken(Path(f"{names[-1]}.pt"), names, rows)


def ids(inserted: Inserted, row: int = 0) -> list[int]:
    """Return the ids of a text between begin and end."""
    found = inserted.tokenizer.encode(inserted.texts[row])
    return found[1 : list(found).index(inserted.tokenizer.end)].tolist()


def test_placeholders_become_the_ids_behind_the_vocabulary(tokenizer: ClipTokenizer) -> None:
    size = VOCABULARY
    assert size > tokenizer.engine.get_vocab_size(), "a table longer than the vocabulary"
    plain = tokenizer.encode("a red ball, front view")
    words = plain[1 : list(plain).index(tokenizer.end)].tolist()
    for prompt in (
        "a red <cat> ball, front view",
        "a red * ball, front view",
        "a red Zorblax ball, front view",
    ):
        inserted = insert_tokens(
            [token("<cat>", "zorblax", count=3)], prompt, ["no zorblax"], tokenizer, TABLE
        )
        assert ids(inserted) == [*words[:2], size, size + 1, size + 2, *words[2:]]
        assert inserted.embeddings.shape == (3, WIDTH)
        assert readable(inserted.texts[0]) == "a red * ball, front view"
    assert ids(inserted, 1)[-3:] == [size, size + 1, size + 2]


def test_several_tokens_each_have_their_own_ids(tokenizer: ClipTokenizer) -> None:
    size = VOCABULARY
    tokens = [token("<cat>", count=2), token("<hat>", count=1, first=7)]
    inserted = insert_tokens(tokens, "<hat><cat> <hat>", [], tokenizer, TABLE)
    assert ids(inserted) == [size + 2, size, size + 1, size + 2]
    assert inserted.embeddings[:, 0].tolist() == [0, 1, 7]


@pytest.mark.parametrize(
    ("tokens", "prompt", "words"),
    [
        ([token("<cat>", "zorblax")], "a red ball", ["zorblax.pt", "'a red ball'", "<cat> or zorblax or *"]),
        ([token("<cat>"), token("<hat>")], "a <cat>, a *", ["<hat>.pt", "write <hat>"]),
        ([token("<cat>", width=24)], "a *", [f"width {WIDTH}", "width 24"]),
        ([token("<cat>", "a1"), token("<cat>", "b1")], "a <cat>", ["a1.pt", "b1.pt", "<cat>"]),
        ([token("ball")], "a ball", ["ball is a word of the model already", "write *"]),
        ([token("ball"), token("<hat>")], "a ball <hat>", ["ball is a word", "rename"]),
    ],
)
def test_what_does_not_fit_is_said_with_its_names(
    tokenizer: ClipTokenizer, tokens: list[LearnedToken], prompt: str, words: list[str]
) -> None:
    with pytest.raises(InputError) as error:
        insert_tokens(tokens, prompt, [], tokenizer, TABLE)
    for word in words:
        assert word in str(error.value)
    with pytest.raises(InputError, match="token_embeddings"):
        insert_tokens(tokens, prompt, [], tokenizer, None)


def test_a_name_is_found_as_a_whole_word_only(tokenizer: ClipTokenizer) -> None:
    with pytest.raises(InputError, match="zorb"):
        insert_tokens([token("zorb")], "a zorblax", [], tokenizer, TABLE)


def test_a_text_with_characters_of_the_private_use_area_is_no_way_in(tokenizer: ClipTokenizer) -> None:
    inserted = insert_tokens([token("<cat>")], "a <cat> \ue000", [], tokenizer, TABLE)
    assert ids(inserted).count(VOCABULARY) == 1


def test_the_encoder_takes_the_embeddings(bundle: Path, tokenizer: ClipTokenizer) -> None:
    """A learned token with a word's own embedding is that word."""
    assert token_table(bundle / "text_encoder", tokenizer) == TABLE
    table = np.random.default_rng(0).normal(size=(VOCABULARY, WIDTH)).astype(np.float32)
    word = int(tokenizer.encode("ball")[1])
    learned = LearnedToken(Path("x.pt"), ("<x>",), table[word][None])
    inserted = insert_tokens([learned], "a red <x>", [], tokenizer, TABLE)
    with text_encoder(bundle / "text_encoder", inserted.embeddings) as encode:
        found = encode(inserted.tokenizer.encode(inserted.texts[0])[None])
    with text_encoder(bundle / "text_encoder") as encode:
        expected = encode(tokenizer.encode("a red ball")[None])
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_cut_never_splits_what_is_left(tokenizer: ClipTokenizer) -> None:
    inserted = insert_tokens([token("<cat>", count=4)], "a red ball " * 12 + "<cat>", [], tokenizer, TABLE)
    kept, cut = inserted.tokenizer.fit(inserted.texts[0], (", front view",))
    assert cut
    assert len(inserted.tokenizer.encode(kept + ", front view")) == inserted.tokenizer.length
