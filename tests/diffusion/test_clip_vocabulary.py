"""With CLIP's real vocabulary, the tokenizer gives what transformers' does, on thousands of odd strings."""

import random
import unicodedata
from pathlib import Path

import numpy as np
import pytest

from export.bundle_files import write_tokenizer
from export.clip_vocabulary import MERGES, clip_merges
from pipeline.diffusion.tokenizer import BEGIN, CLIP_LENGTH, END, ClipTokenizer, load_tokenizer
from pipeline.errors import InputError

COUNT = 4000
WORDS = ["a", "photo", "of", "armchair", "don't", "it's", "they'll", "DSLR", "3d", "CAFÉ", "naïve", "1234",
         "x2", "l'eau", "ÅNGSTRÖM", "#art", "@you"]  # fmt: skip
GLUE = [
    " ",
    "  ",
    "\t",
    "\n",
    "\u00a0",
    "\u3000",
    "",
    ",",
    ", ",
    "...",
    "-",
    "_",
    "'",
    '"',
    "!!",
    "/",
    "\u200d",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clip") / "tokenizer"
    try:
        merges = clip_merges()
    except InputError:
        pytest.skip("open_clip_torch is not installed: make test installs it")
    write_tokenizer(folder, merges, max_length=CLIP_LENGTH)
    return folder


@pytest.fixture(scope="module")
def tokenizer(folder: Path) -> ClipTokenizer:
    return load_tokenizer(folder)


def test_the_vocabulary_is_clips(tokenizer: ClipTokenizer) -> None:
    """Ids that OpenAI published: 49408 tokens, and those of "a photo of a cat"."""
    assert tokenizer.engine.get_vocab_size() == 49408 == MERGES + 512 + 2
    assert tokenizer.encode("a photo of a cat")[:7].tolist() == [49406, 320, 1125, 539, 320, 2368, 49407]
    assert (tokenizer.begin, tokenizer.end, tokenizer.pad) == (49406, 49407, 49407)


def odd_strings() -> list[str]:
    """Words, glue and characters of every kind that Unicode assigns, mixed."""
    draw = random.Random(0)
    plain = [chr(code) for code in range(0x20, 0x2FFF) if unicodedata.category(chr(code)) not in ("Cn", "Cs")]
    wide = [chr(draw.randrange(0x3000, 0x1FAFF)) for _ in range(3000)]
    wide = [char for char in wide if unicodedata.category(char) not in ("Cn", "Cs", "Co")]
    texts = [
        "",
        " ",
        "\n",
        "''",
        "'s",
        "a's b'S",
        "½ ² Ⅷ ①",
        "ﬁ ﬀ",
        "e\u0301",
        "İI",
        "ß ẞ",
        "👩‍🚀 🇩🇪",
        "कि",
        "ﷺ",
    ]
    for _ in range(COUNT):
        parts = [
            draw.choice(
                [draw.choice(WORDS), draw.choice(plain), draw.choice(wide), str(draw.randrange(10**6))]
            )
            + draw.choice(GLUE)
            for _ in range(draw.randrange(1, 14))
        ]
        texts.append("".join(parts))
    return texts


def test_thousands_of_odd_strings_are_tokenised_as_transformers_does(
    folder: Path, tokenizer: ClipTokenizer
) -> None:
    from transformers import CLIPTokenizer

    reference = CLIPTokenizer.from_pretrained(folder)
    texts = [text for text in odd_strings() if BEGIN not in text and END not in text]
    options = {"padding": "max_length", "max_length": CLIP_LENGTH, "truncation": True}
    wanted = np.array(reference(texts, **options).input_ids)
    found = np.stack([tokenizer.encode(text) for text in texts])
    wrong = [
        (t, f.tolist(), w.tolist()) for t, f, w in zip(texts, found, wanted, strict=True) if (f != w).any()
    ]
    assert not wrong, f"{len(wrong)} of {len(texts)}: {wrong[:2]}"
