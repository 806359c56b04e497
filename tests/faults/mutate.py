"""Damage to bytes, as transfers, editors and attackers do it. Everything comes from one generator.

Half of the damages to files with a JSON document in them (glTF, GLB, safetensors) are to a value of it, and
half of those to PNG keep its checksums right: what reads the values is to be reached.
"""

import json
import re
import struct
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

NUMBERS = [
    b"-1", b"0", b"1", b"255", b"65536", b"2147483647", b"2147483648", b"4294967295",
    b"-9223372036854775808", b"18446744073709551616", b"1e-320", b"1e308", b"-1e400", b"nan", b"NaN", b"inf",
    b"Infinity", b"0x10", b"",
]  # fmt: skip
WORDS = [
    b"[" * 3000, b'{"a":' * 3000, b"<g>" * 300, b"null", b"true", b'""', b"[]", b"{}", b"\\ud800", b"\0",
    b"\xff", b"\n", b"../../etc/passwd", b"!!python/object/apply:os.system [touch executed]", b"&a [*a]",
    b"99999999999",
]  # fmt: skip
VALUES: list[Any] = [
    -1, 0, 1, 2, 255, 2**31, 2**32, 2**63, 10**30, 0.5, -1e-30, 1e308, None, True, False, "", "x", "../x",
    "SCALAR", "VEC3", [], {}, [0], [[]], {"a": {}}, 5121, 5126,
]  # fmt: skip
_PNG = b"\x89PNG\r\n\x1a\n"
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def mutate(data: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """Return the data after one damage, or a few; `other` is a file to take pieces from."""
    for _ in range(int(rng.geometric(0.6))):
        parts = _document(data) if rng.random() < 0.5 else None
        if parts:
            value, pack = parts
            data = pack(_change(value, rng))
        else:
            data = _DAMAGES[rng.integers(len(_DAMAGES))](data, other, rng)
    return _with_checksums(data) if data.startswith(_PNG) and rng.random() < 0.5 else data


def _document(data: bytes) -> tuple[Any, Callable[[Any], bytes]] | None:
    """Return the JSON document of a file, and what packs another one in its place; None: there is none."""
    try:
        if data.startswith(b"glTF"):
            end = 20 + int(struct.unpack_from("<I", data, 12)[0])
            return json.loads(data[20:end]), lambda value: _glb(json.dumps(value).encode(), data[end:])
        if data[8:9] == b"{":
            end = 8 + int(struct.unpack_from("<Q", data)[0])
            return json.loads(data[8:end]), lambda value: _tensors(json.dumps(value).encode(), data[end:])
        if data.startswith(b"{"):
            return json.loads(data), lambda value: json.dumps(value).encode()
    except (ValueError, RecursionError, struct.error):
        pass
    return None


def _glb(text: bytes, rest: bytes) -> bytes:
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + rest


def _tensors(text: bytes, rest: bytes) -> bytes:
    return struct.pack("<Q", len(text)) + text + rest


def _change(value: Any, rng: np.random.Generator) -> Any:
    """Return a document with one value somewhere in it exchanged, removed, or put elsewhere too."""
    if rng.random() < 0.15 or not isinstance(value, dict | list) or not value:
        return VALUES[rng.integers(len(VALUES))]
    keys = list(value) if isinstance(value, dict) else [*range(len(value))]
    key = keys[rng.integers(len(keys))]
    kind = rng.random()
    if kind < 0.1:
        del value[key]
    elif kind < 0.2:
        value[key] = value[keys[rng.integers(len(keys))]]
    else:
        value[key] = _change(value[key], rng)
    return value


def _with_checksums(data: bytes) -> bytes:
    """Return a PNG whose chunks have right checksums, as far as it has chunks."""
    fixed, at = bytearray(data), len(_PNG)
    while at + 12 <= len(data):
        end = at + 8 + int(struct.unpack_from(">I", data, at)[0])
        if end + 4 > len(data):
            break
        fixed[end : end + 4] = struct.pack(">I", zlib.crc32(data[at + 4 : end]))
        at = end + 4
    return bytes(fixed)


def _place(data: bytes, rng: np.random.Generator) -> int:
    """Return a position; half of the time near the beginning, where headers are."""
    return int(rng.integers(0, min(len(data), 128) + 1 if rng.random() < 0.5 else len(data) + 1))


def _piece(data: bytes, rng: np.random.Generator) -> bytes:
    start = _place(data, rng)
    return data[start : start + int(2 ** rng.uniform(0, 10))]


def _flip(data: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for _ in range(int(2 ** rng.uniform(0, 3))):
        if changed:
            changed[min(_place(data, rng), len(changed) - 1)] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _extreme(data: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """Set an aligned word to the ends of integers and floats."""
    values = [b"\0" * 4, b"\xff" * 4, b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0\0\xc0\x7f", b"\0\0\x80\x7f"]
    start = _place(data, rng) & ~3
    return data[:start] + values[rng.integers(len(values))] + data[start + 4 :]


def _cut(data: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    return data[: _place(data, rng)]


def _remove(data: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    start = _place(data, rng)
    return data[:start] + data[start + int(2 ** rng.uniform(0, 10)) :]


def _repeat(data: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    start, times = _place(data, rng), int(2 ** rng.uniform(0, 8))
    return data[:start] + _piece(data, rng)[: 1 << 16] * times + data[start:]


def _graft(data: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    start = _place(data, rng)
    return data[:start] + _piece(other, rng) + data[start:]


def _word(data: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    start = _place(data, rng)
    return data[:start] + WORDS[rng.integers(len(WORDS))] + data[start + int(rng.integers(0, 9)) :]


def _number(data: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """Exchange a number that is written out."""
    found = list(_NUMBER.finditer(data[: 1 << 16]))
    if not found:
        return _extreme(data, other, rng)
    one = found[rng.integers(len(found))]
    return data[: one.start()] + NUMBERS[rng.integers(len(NUMBERS))] + data[one.end() :]


_DAMAGES = (_flip, _extreme, _cut, _remove, _repeat, _graft, _word, _number, _number)
