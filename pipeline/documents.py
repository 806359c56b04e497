"""JSON and numbers from strangers: every damage is one error.

`json.loads` raises four kinds of error for damaged text, and takes `NaN`, infinities, numbers of any length
and halves of characters, which break whatever reads the values later.
"""

import json
import math
from pathlib import Path
from typing import Any, NoReturn

from pipeline.errors import InputError
from pipeline.files import read_at_most

MOST_BYTES = 64 * 2**20
"""Of a JSON file: a vocabulary takes one megabyte."""


def parse_json(text: str | bytes) -> Any:
    """Return the value that JSON text stands for.

    Raises:
        ValueError: no JSON, no UTF-8, nested too deeply, a number that is none, a character that is none.
    """
    try:
        value = json.loads(text, parse_constant=_refuse, parse_float=_finite, parse_int=_whole)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    escapes = b"\\ud" if isinstance(text, bytes) else "\\ud"
    if escapes in text.lower():  # type: ignore[operator]  # both are of one type
        try:
            json.dumps(value, ensure_ascii=False).encode("utf-8")
        except UnicodeEncodeError:
            raise ValueError("half of a character (a lone surrogate)") from None
    return value


def parse_object(text: str | bytes) -> dict[str, Any]:
    """Return the JSON object that text stands for; raises ValueError as `parse_json`, and for
    other values."""
    value = parse_json(text)
    if not isinstance(value, dict):
        raise ValueError(f"a JSON {type(value).__name__} instead of an object")
    return value


def whole_number(text: str | bytes) -> int | None:
    """Return the number that up to 18 digits write; None for anything else. `int` takes spaces, signs, lines,
    underscores and other scripts' digits, and fails beyond 4300; `isdigit` takes superscripts."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 18 else None


def read_json(path: Path, mend: str) -> dict[str, Any]:
    """Return the JSON object in a file.

    Args:
        mend: what the user can do about a damaged file, for the error.

    Raises:
        InputError: the file is absent, empty, no regular file, unreadable, too large, or holds anything else.
    """
    if not path.is_file():
        raise InputError(f"{path}: missing, expected a JSON file; {mend}")
    try:
        data = read_at_most(path, MOST_BYTES)
        if not data:
            raise ValueError("0 bytes")
        return parse_object(data)
    except ValueError as error:
        said = str(error).splitlines()[0][:120]
        raise InputError(f"{path}: no valid JSON ({said}), expected an object; {mend}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); {mend}") from None


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant[:20]}, expected finite numbers")


def _finite(number: str) -> float:
    return value if math.isfinite(value := float(number)) else _refuse(number)


def _whole(number: str) -> int:
    return value if abs(value := int(number)) < 2**63 else _refuse(number)
