"""CLIP's tokenization, hand-checked, and texts nobody expects."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from export.bundle_files import bytes_alphabet, train_tokenizer, write_tokenizer
from pipeline.diffusion.tokenizer import BEGIN, END, ClipTokenizer, load_tokenizer, unknown_words
from pipeline.errors import InputError
from tests.tiny_bundle import CAPTIONS, WINDOW

MERGES = [
    ("r", "e"),
    ("re", "d</w>"),
    ("a", "r"),
    ("ar", "m"),
    ("c", "h"),
    ("arm", "ch"),
    ("i", "r</w>"),
    ("a", "ir</w>"),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_tokenizer(tmp_path, MERGES, max_length=12)
    return tmp_path


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> ClipTokenizer:
    folder = tmp_path_factory.mktemp("tokenizer")
    train_tokenizer(folder, CAPTIONS, vocabulary_size=600, max_length=WINDOW)
    return load_tokenizer(folder)


def spelled(tokenizer: ClipTokenizer, text: str) -> list[str]:
    """Return the tokens of `text` between begin and end."""
    ids = tokenizer.encode(text).tolist()
    assert ids[0] == tokenizer.begin
    return [str(tokenizer.engine.id_to_token(i)) for i in ids[1 : ids.index(tokenizer.end)]]


@pytest.mark.parametrize(
    ("text", "tokens"),
    [
        ("red armchair", ["red</w>", "armch", "air</w>"]),
        ("  RED\n\tArmchair ", ["red</w>", "armch", "air</w>"]),  # white space and case
        ("reder", ["re", "d", "e", "r</w>"]),  # a merge with </w> only at the end of a word
        ("red2 12", ["red</w>", "2</w>", "1</w>", "2</w>"]),  # digits one by one
        ("red,!red", ["red</w>", ",", "!</w>", "red</w>"]),  # a run of symbols is one word
        ("it's", ["i", "t</w>", "'", "s</w>"]),
        ("", []),
        ("É", ["Ã", "©</w>"]),  # e acute as two bytes, lower case
        ("e\u0301", ["Ã", "©</w>"]),  # composed by NFC
        ("🪑", ["ð", "Ł", "ª", "ĳ</w>"]),  # four bytes f0 9f aa 91
    ],
)
def test_hand_checked_cases(folder: Path, text: str, tokens: list[str]) -> None:
    assert spelled(load_tokenizer(folder), text) == tokens


def test_ids_are_in_clips_order(folder: Path) -> None:
    tokenizer = load_tokenizer(folder)
    assert bytes_alphabet()[:3] == ["!", '"', "#"]
    ids = tokenizer.encode("! red")
    assert ids.dtype == np.int64
    # "!" ends a word: 256 + 0; the second merge: 512 + 1; begin and end come last, and padding is the end.
    assert ids.tolist() == [520, 256, 513] + [521] * 9
    assert (tokenizer.begin, tokenizer.end, tokenizer.pad, tokenizer.length) == (520, 521, 521, 12)


def test_the_pad_token_of_stable_diffusion_2(folder: Path) -> None:
    special = json.loads((folder / "special_tokens_map.json").read_text())
    special["pad_token"] = {"content": "!", "lstrip": False}
    (folder / "special_tokens_map.json").write_text(json.dumps(special))
    assert load_tokenizer(folder).encode("red").tolist() == [520, 513, 521] + [0] * 9


def test_an_absent_window_is_clips(folder: Path) -> None:
    (folder / "tokenizer_config.json").write_text('{"model_max_length": 1e30}')
    assert load_tokenizer(folder).length == 77
    (folder / "tokenizer_config.json").unlink()
    (folder / "special_tokens_map.json").unlink()
    tokenizer = load_tokenizer(folder)
    assert (tokenizer.length, tokenizer.pad) == (77, tokenizer.end)


def test_the_special_tokens_written_out_are_the_special_tokens(folder: Path) -> None:
    assert load_tokenizer(folder).encode(f"red {END} red").tolist()[:4] == [520, 513, 521, 513]


def test_the_one_file_format_means_the_same(folder: Path, tmp_path: Path) -> None:
    vocabulary = json.loads((folder / "vocab.json").read_text())
    merges = (folder / "merges.txt").read_text().splitlines()[1:]
    expected = load_tokenizer(folder).encode("a red armchair")
    for style in (merges, [line.split(" ") for line in merges]):
        (folder / "tokenizer.json").write_text(json.dumps({"model": {"vocab": vocabulary, "merges": style}}))
        for name in ("vocab.json", "merges.txt"):
            (folder / name).unlink(missing_ok=True)
        assert np.array_equal(load_tokenizer(folder).encode("a red armchair"), expected)


def test_a_long_text_fills_the_window_and_ends(folder: Path) -> None:
    assert load_tokenizer(folder).encode("red " * 50).tolist() == [520] + [513] * 10 + [521]


def test_a_long_prompt_is_cut_between_words_and_keeps_the_view(folder: Path) -> None:
    tokenizer = load_tokenizer(folder)
    suffixes = [", red", ", red red"]
    assert tokenizer.fit("red armchair", suffixes) == ("red armchair", "")
    kept, cut = tokenizer.fit("red armchair red armchair red armchair", suffixes)
    # Room for 10 tokens, the longer suffix takes 3: "red armch air red" is 4, one more word would be 6.
    assert (kept, cut) == ("red armchair red armchair red", " armchair")
    assert spelled(tokenizer, kept + suffixes[1])[-3:] == [",</w>", "red</w>", "red</w>"]


def test_one_endless_word_is_cut_inside(folder: Path) -> None:
    kept, cut = load_tokenizer(folder).fit("x" * 100, [", red"])
    assert kept + cut == "x" * 100
    assert len(kept) >= 6


def test_a_window_too_short_for_the_view_is_an_error(folder: Path) -> None:
    with pytest.raises(InputError, match="too short"):
        load_tokenizer(folder).fit("red " * 50, [", x x x x x x x x x"])


@settings(max_examples=100, deadline=None)
@given(text=st.text(max_size=100))
def test_any_text_encodes_and_fits(trained: ClipTokenizer, text: str) -> None:
    ids = trained.encode(text)
    assert ids.shape == (WINDOW,)
    assert ids[0] == trained.begin
    assert trained.end in ids[1:]
    suffix = ", overhead front view"
    kept, cut = trained.fit(text, [suffix])
    assert kept + cut == text
    whole = trained.engine.encode(kept + suffix, add_special_tokens=False).ids
    assert len(whole) <= WINDOW - 2
    assert trained.encode(kept + suffix).tolist()[1 : len(whole) + 1] == whole


@settings(max_examples=100, deadline=None)
@given(text=st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), max_size=40))
def test_bytes_come_back(trained: ClipTokenizer, text: str) -> None:
    """Decoding the tokens gives the normalised text: no character is lost, whatever its script."""
    normal = trained.engine.normalizer.normalize_str(text)
    letters = "".join(
        str(trained.engine.id_to_token(i)) for i in trained.engine.encode(text, add_special_tokens=False).ids
    )
    byte_of = {character: byte for byte, character in zip(byte_order(), bytes_alphabet(), strict=True)}
    back = bytes(byte_of[c] for c in letters.replace("</w>", "")).decode("utf-8")
    assert back == "".join(normal.split())


def byte_order() -> list[int]:
    first = [*range(33, 127), *range(161, 173), *range(174, 256)]
    return [*first, *(byte for byte in range(256) if byte not in first)]


def test_ten_thousand_characters_nul_and_line_breaks(trained: ClipTokenizer) -> None:
    for text in ("a red ball " * 1000, "a\0red\0ball", "a red\nball\r\n", "$(shell touch x)", "{x} ../ %s"):
        assert trained.encode(text).shape == (WINDOW,)


def test_a_lone_surrogate_is_an_input_error(trained: ClipTokenizer) -> None:
    with pytest.raises(InputError, match="Unicode"):
        trained.encode("red \udcff")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("merges.txt", b"#version: 0.2\nr e\nnot a pair\n", "line 3"),
        ("merges.txt", b"\xff\xfe\x00", "UTF-8"),
        ("merges.txt", b"#version: 0.2\nzz yy\n", "vocabulary"),
        ("vocab.json", b'{"a": 0}', "<|startoftext|>"),
        ("vocab.json", b'{"a": "b"}', "vocabulary"),
        ("vocab.json", b"{}", "vocabulary"),
        ("vocab.json", b"[", "JSON"),
        ("special_tokens_map.json", b'{"pad_token": "<pad>"}', "<pad>"),
        ("tokenizer_config.json", b"[]", "object"),
    ],
)
def test_garbage_is_named(folder: Path, name: str, content: bytes, said: str) -> None:
    (folder / name).write_bytes(content)
    with pytest.raises(InputError) as error:
        load_tokenizer(folder)
    assert str(folder) in str(error.value)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named(folder: Path) -> None:
    (folder / "merges.txt").unlink()
    with pytest.raises(InputError, match=r"merges\.txt: missing"):
        load_tokenizer(folder)


def test_unknown_words() -> None:
    known = {"a", "red", "armchair", "dish", "the"}
    assert unknown_words("A Red zorblax, armchairs & dishes of Zorblax 42!", known) == ["zorblax", "of"]
    assert unknown_words("the armchair's dragon 🐉", known) == ["dragon", "🐉"]
    assert unknown_words("anything goes", None) == []
    assert unknown_words("", known) == []


def test_a_trained_vocabulary_has_at_most_the_asked_size(tmp_path: Path) -> None:
    train_tokenizer(tmp_path, CAPTIONS, vocabulary_size=530, max_length=20)
    vocabulary = json.loads((tmp_path / "vocab.json").read_text())
    assert len(vocabulary) == 530
    assert sorted(vocabulary.values()) == list(range(530))
    assert vocabulary[BEGIN] == 528
    with pytest.raises(ValueError, match="514"):
        train_tokenizer(tmp_path, CAPTIONS, vocabulary_size=500, max_length=20)


def test_words_of_the_captions_become_single_tokens(trained: ClipTokenizer) -> None:
    assert spelled(trained, "a red armchair, front view") == [
        "a</w>", "red</w>", "armchair</w>", ",</w>", "front</w>", "view</w>",
    ]  # fmt: skip
