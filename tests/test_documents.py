"""JSON from strangers: what is no JSON, and what `json` takes for one."""

import json
from pathlib import Path

import pytest

from pipeline.documents import MOST_BYTES, parse_json, parse_object, read_json, whole_number
from pipeline.errors import InputError


def test_values_are_those_of_json() -> None:
    text = '{"a": [1, -2.5, 1e300, 9223372036854775807, null, true, "\\u00e9 \\ud83d\\ude00"], "b": {}}'
    assert parse_json(text) == json.loads(text)
    assert parse_object(text.encode()) == json.loads(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "Expecting property name"),
        ("[NaN]", "NaN, expected finite numbers"),
        ("[-Infinity]", "-Infinity, expected finite numbers"),
        ("[-1e400]", "-1e400, expected finite numbers"),
        ("[9223372036854775808]", "9223372036854775808, expected finite numbers"),
        (f"[1{'0' * 400}]", "10000000000000000000, expected finite numbers"),
        (f"[1{'0' * 5000}]", "limit"),
        ("[" * 100_000, "nested too deeply"),
        ('["\\ud83d"]', "half of a character"),
    ],
)
def test_damage_is_a_value_error(text: str, said: str) -> None:
    for given in (text, text.encode()):
        with pytest.raises(ValueError, match=said):
            parse_json(given)


def test_other_values_are_no_objects() -> None:
    with pytest.raises(ValueError, match="a JSON list instead of an object"):
        parse_object("[]")


@pytest.mark.parametrize("data", [b"", b"[]", b"\xff\xfe", b'{"a": 1e999}', b"{}" + b" " * MOST_BYTES])
def test_a_damaged_file_is_named_with_what_to_do(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "file.json"
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"file\.json: .*; export it again"):
        read_json(path, "export it again")


def test_what_is_no_file_is_named(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "absent.json"):
        with pytest.raises(InputError, match="missing, expected a JSON file"):
            read_json(path, "export it again")


@pytest.mark.parametrize("text", ["", " 1", "1 ", "+1", "-1", "1_0", "1.0", "²", "٣", "9" * 19, "9" * 5000])
def test_what_only_looks_like_a_number_is_none(text: str) -> None:
    assert whole_number(text) is None


def test_numbers_are_read_of_text_and_of_bytes() -> None:
    assert whole_number("9" * 18) == 10**18 - 1
    assert whole_number(b"007") == 7
