"""Textual inversion: learned embeddings that stand for words (Gal et al. 2022). Files: `token_files`.

A concept is n x d numbers, n tokens of width d. A prompt names a concept by the file's own placeholder, by
the file's name, or, where there is only one, by `*`. Each of its tokens gets an id behind the vocabulary;
the text encoder's graph takes their embeddings as an input, `token_embeddings` (n, d), which it appends to
its table.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32
from tokenizers import AddedToken, Tokenizer

from pipeline.diffusion.bundle import graph_config
from pipeline.diffusion.onnx_file import read_onnx
from pipeline.diffusion.tokenizer import ClipTokenizer
from pipeline.errors import InputError
from pipeline.options.schema import short

ANY = "*"
_PRIVATE = 0xE000
"""Unicode's private use area: characters that stand for the added tokens inside a text."""
_UNUSED = 0xF0000
_IN_PRIVATE = re.compile("[\ue000-\uf8ff\U000f0000-\U000ffffd]+")


@dataclass(frozen=True)
class LearnedToken:
    """A concept: what it may be called and its embeddings."""

    path: Path
    names: tuple[str, ...]
    vectors: Float32[np.ndarray, "n d"]


class Inserted(NamedTuple):
    """Texts in which every placeholder has become characters that the tokenizer knows as tokens."""

    texts: list[str]
    tokenizer: ClipTokenizer
    embeddings: Float32[np.ndarray, "n d"]
    """In the order of the ids behind the vocabulary."""


class TokenTable(NamedTuple):
    """What a text encoder needs of learned tokens."""

    rows: int
    """Of its own table: the id of the first learned token."""
    width: int


def token_table(text_encoder: Path, tokenizer: ClipTokenizer) -> TokenTable | None:
    """Return the table of the text encoder in this folder; None: its graph takes no learned tokens.

    A table may be longer than the vocabulary: config.json says so (`vocab_size`).
    """
    port = read_onnx(text_encoder / "model.onnx").inputs.get("token_embeddings")
    if port is None or not port.shape or port.shape[-1] is None:
        return None
    rows = graph_config(text_encoder).get("vocab_size")
    known = tokenizer.engine.get_vocab_size()
    return TokenTable(max(rows, known) if isinstance(rows, int) else known, port.shape[-1])


def insert_tokens(
    tokens: Sequence[LearnedToken],
    prompt: str,
    others: Sequence[str],
    tokenizer: ClipTokenizer,
    table: TokenTable | None,
) -> Inserted:
    """Return `prompt` and `others` with the placeholders of the tokens replaced, and how to read them.

    The prompt must hold each token; the other texts may. `table`: the text encoder's, see `token_table`.

    Raises:
        InputError: no graph for learned tokens, a token that the prompt does not hold, a width other than the
            encoder's, a name that two tokens share or that is a word of the model.
    """
    if table is None:
        raise InputError(
            f"TOKEN {tokens[0].path} is given, but the text encoder takes no learned tokens (its graph "
            "lacks the input token_embeddings): export the model again, or leave TOKEN out"
        )
    taken: dict[str, Path] = {}
    engine = Tokenizer.from_str(tokenizer.engine.to_str())
    texts = [_IN_PRIVATE.sub("", text) for text in (prompt, *others)]
    first = 0
    vocabulary = engine.get_vocab(with_added_tokens=False)
    for token in tokens:
        if token.vectors.shape[1] != table.width:
            raise InputError(
                f"TOKEN {token.path}: embeddings of width {token.vectors.shape[1]}, the model's text encoder "
                f"has width {table.width}: use a token that was learned for this kind of model"
            )
        words = [name for name in token.names if f"{name.lower()}</w>" in vocabulary or name in vocabulary]
        names = [name for name in token.names if name not in words] + [ANY] * (len(tokens) == 1)
        for name in names:
            if name in taken:
                raise InputError(
                    f"TOKEN {token.path} and {taken[name]} are both called {name}: rename one file"
                )
            taken[name] = token.path
        if not (used := [name for name in names if _placeholder(name).search(texts[0])]):
            raise InputError(_absent(token, names, words, prompt))
        characters = "".join(chr(_PRIVATE + first + i) for i in range(len(token.vectors)))
        for name in sorted(used, key=len, reverse=True):
            texts = [_placeholder(name).sub(characters, text) for text in texts]
        first += len(token.vectors)
    # Added tokens are numbered on from the vocabulary: unused ones fill it up to the table.
    unused = [chr(_UNUSED + i) for i in range(table.rows - engine.get_vocab_size())]
    added = unused + [chr(_PRIVATE + i) for i in range(first)]
    engine.add_tokens([AddedToken(character, normalized=False) for character in added])
    rows = np.concatenate([token.vectors for token in tokens])
    return Inserted(texts, replace(tokenizer, engine=engine), rows)


def readable(text: str) -> str:
    """Return a text whose tokens were inserted with * for each, for people and word lists."""
    return _IN_PRIVATE.sub(ANY, text)


def _absent(token: LearnedToken, names: Sequence[str], words: Sequence[str], prompt: str) -> str:
    because = f" ({', '.join(words)} is a word of the model already)" if words else ""
    if not names:
        return f"TOKEN {token.path} has no name of its own{because}: rename the file"
    return (
        f"TOKEN {token.path} is not in the prompt {short(prompt)}: write {' or '.join(names)} where it is to "
        f"stand{because}"
    )


def _placeholder(name: str) -> re.Pattern[str]:
    """Return what finds a name as a whole word."""
    before, after = (r"(?<!\w)" if name[0].isalnum() else ""), (r"(?!\w)" if name[-1].isalnum() else "")
    return re.compile(before + re.escape(name) + after, re.IGNORECASE)
