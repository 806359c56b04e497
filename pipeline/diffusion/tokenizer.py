"""CLIP's byte-pair tokenizer, by the `tokenizers` package, from the files of a bundle.

Text is normalised (NFC, white space to one blank, lower case), split into words, numbers digit by digit
and runs of symbols, spelled in bytes and merged. A sequence is: begin, tokens, end, padding. Radford et
al. 2021, "Learning transferable visual models from natural language supervision", section 2.4.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int
from tokenizers import AddedToken, Regex, Tokenizer, models, normalizers, pre_tokenizers

from pipeline.diffusion.bundle import read_json
from pipeline.errors import InputError

BEGIN, END = "<|startoftext|>", "<|endoftext|>"
CLIP_LENGTH = 77
MOST_TOKENS = 10_000_000
"""Rows of a text encoder's table: CLIP has 49,408."""
_WORDS = r"""'s|'t|'re|'ve|'m|'ll|'d|[\p{L}]+|[\p{N}]|[^\s\p{L}\p{N}]+"""


@dataclass(frozen=True)
class ClipTokenizer:
    """Tokenizer of one bundle: `length` is the model's window in tokens, with begin and end."""

    engine: Tokenizer
    begin: int
    end: int
    pad: int
    length: int

    def encode(self, text: str) -> Int[np.ndarray, " l"]:
        """Return the ids of `text`, (length,) int64: begin, tokens (cut to the window), end, padding."""
        ids = [self.begin, *self._encode(text).ids[: self.length - 2], self.end]
        return np.array(ids + [self.pad] * (self.length - len(ids)), np.int64)

    def fit(self, text: str, suffixes: Collection[str] = ("",)) -> tuple[str, str]:
        """Split `text` into (kept, cut) so that kept + any of `suffixes` fits into the window.

        `cut` is "" when all fits. Cuts between words where it can, so that words about the view, which
        stand last, are never the ones lost. Raises InputError when a suffix alone does not fit.
        """
        room = self.length - 2
        if all(len(self._encode(text + suffix).ids) <= room for suffix in suffixes):
            return text, ""
        longest = max(len(self._encode(suffix).ids) for suffix in suffixes)
        if longest >= room:
            raise InputError(f"the model's window of {self.length} tokens is too short for its view words")
        encoded = self._encode(text)
        ends = [end for _, end in encoded.offsets]
        words = encoded.word_ids
        for count in range(min(room - longest, len(ends)), 0, -1):
            between = count == len(ends) or words[count] != words[count - 1]
            if (between or words[count] == words[0]) and all(
                len(self._encode(text[: ends[count - 1]] + suffix).ids) <= room for suffix in suffixes
            ):
                return text[: ends[count - 1]], text[ends[count - 1] :]
        return "", text

    def _encode(self, text: str) -> Any:
        try:
            return self.engine.encode(text, add_special_tokens=False)
        except (TypeError, UnicodeError):
            raise InputError("the prompt holds characters that are no valid Unicode; type it again") from None


def load_tokenizer(folder: Path) -> ClipTokenizer:
    """Return the tokenizer in `folder`: vocab.json and merges.txt, or else tokenizer.json.

    The pad token comes from special_tokens_map.json or tokenizer_config.json (CLIP: the end token,
    Stable Diffusion 2: "!"), the window from tokenizer_config.json (else 77). Raises InputError naming
    the file that is missing or garbage.
    """
    vocabulary, merges, place = _read_vocabulary(folder)
    special = {name: vocabulary.get(name) for name in (BEGIN, END)}
    for name, index in special.items():
        if index is None:
            raise InputError(
                f"{place}: lacks the token {name}, expected CLIP's vocabulary; export the bundle again"
            )
    try:
        model = models.BPE(
            vocab=vocabulary,
            merges=merges,
            unk_token=END,
            end_of_word_suffix="</w>",
            continuing_subword_prefix="",
            fuse_unk=False,
        )
    except Exception as error:  # the package raises nothing more precise
        said = " ".join(str(error).split())[:120]
        blamed = folder / "merges.txt" if place.name == "vocab.json" else place
        raise InputError(
            f"{blamed}: its merges do not belong to the vocabulary ({said}); copy the bundle again"
        ) from None
    engine = Tokenizer(model)
    engine.normalizer, engine.pre_tokenizer = split_words()
    engine.add_special_tokens([AddedToken(name, normalized=False, special=True) for name in (BEGIN, END)])
    config = _optional_json(folder / "tokenizer_config.json")
    length = config.get("model_max_length", CLIP_LENGTH)
    length = int(length) if isinstance(length, (int, float)) and 3 <= length <= 4096 else CLIP_LENGTH
    pad = _pad_token(_optional_json(folder / "special_tokens_map.json")) or _pad_token(config) or END
    if pad not in vocabulary:
        raise InputError(
            f"{folder}: the padding token {pad!r} is not in the vocabulary; copy the bundle again"
        )
    return ClipTokenizer(engine, vocabulary[BEGIN], vocabulary[END], vocabulary[pad], length)


def split_words() -> tuple[normalizers.Normalizer, pre_tokenizers.PreTokenizer]:
    """Return CLIP's normaliser and its splitter into words."""
    normalizer = normalizers.Sequence(
        [normalizers.NFC(), normalizers.Replace(Regex(r"\s+"), " "), normalizers.Lowercase()]
    )
    splitter = pre_tokenizers.Sequence(
        [
            pre_tokenizers.Split(Regex(_WORDS), behavior="removed", invert=True),
            pre_tokenizers.ByteLevel(add_prefix_space=False),
        ]
    )
    return normalizer, splitter


def _optional_json(path: Path) -> dict[str, Any]:
    return read_json(path) if path.exists() else {}


def _pad_token(config: dict[str, Any]) -> str:
    token = config.get("pad_token", "")
    return str(token.get("content", "")) if isinstance(token, dict) else str(token or "")


def _read_vocabulary(folder: Path) -> tuple[dict[str, int], list[tuple[str, str]], Path]:
    """Return (ids by token, merges in order, the file they are from)."""
    if not (folder / "vocab.json").exists() and (folder / "tokenizer.json").exists():
        place = folder / "tokenizer.json"
        model = read_json(place).get("model", {})
        vocabulary = model.get("vocab") if isinstance(model, dict) else None
        lines = model.get("merges") if isinstance(model, dict) else None
        if not isinstance(lines, list) or not all(isinstance(line, str | list) for line in lines):
            raise InputError(f"{place}: merges are no list of pairs; copy or export the bundle again")
        pairs = [tuple(line.split(" ")) if isinstance(line, str) else tuple(line) for line in lines]
    else:
        place = folder / "vocab.json"
        vocabulary = read_json(place)
        pairs = _read_merges(folder / "merges.txt")
    if (
        not isinstance(vocabulary, dict)
        or not vocabulary
        or not all(type(i) is int for i in vocabulary.values())
    ):
        raise InputError(f"{place}: no vocabulary of tokens and numbers; copy or export the bundle again")
    low, high = min(vocabulary.values()), max(vocabulary.values())
    if low < 0 or high >= MOST_TOKENS:
        raise InputError(
            f"{place}: token numbers run from {low} to {high}, expected 0 to {MOST_TOKENS - 1}; copy or "
            "export the bundle again"
        )
    merges = [(pair[0], pair[1]) for pair in pairs if len(pair) == 2 and all(type(p) is str for p in pair)]
    if len(merges) < len(pairs):
        raise InputError(f"{place}: merges that are not pairs; copy or export the bundle again")
    return vocabulary, merges, place


def _read_merges(path: Path) -> list[tuple[str, ...]]:
    if not path.is_file():
        raise InputError(f"{path}: missing, expected the tokenizer's merges; copy or export the bundle again")
    try:
        lines = path.read_text("utf-8").split("\n")
    except UnicodeDecodeError:
        raise InputError(f"{path}: no UTF-8 text, expected a merge a line; copy the bundle again") from None
    pairs = [
        (number, line.split(" "))
        for number, line in enumerate(lines, 1)
        if line.strip() and not (number == 1 and line.startswith("#"))
    ]
    for number, pair in pairs:
        if len(pair) != 2:
            raise InputError(
                f"{path}: line {number} is not a pair of tokens; copy or export the bundle again"
            )
    return [tuple(pair) for _, pair in pairs]


def unknown_words(text: str, known: Collection[str] | None) -> list[str]:
    """Return the words of `text`, lower case, each once, that the model's captions never held.

    `known`: the bundle's known_words; None knows everything. Letters make words (a plural s is
    forgiven), pictographs count as words, digits and punctuation do not.
    """
    if known is None:
        return []
    text = unicodedata.normalize("NFC", text).lower()
    found = re.findall(r"[^\W\d_]+(?:'[^\W\d_]+)?|[^\w\s]", text)
    words = [word for word in found if word[0].isalpha() or unicodedata.category(word[0]) == "So"]
    forms = {
        word: {word, word.removesuffix("'s"), word.removesuffix("s"), word.removesuffix("es")}
        for word in words
    }
    return [word for word in dict.fromkeys(words) if not forms[word] & set(known)]
