"""Damage to bytes, as transfers, editors and attackers do it. Everything comes from one generator."""

import re

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
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def mutate(data: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """Return the data after one damage, or a few; `other` is a file to take pieces from."""
    for _ in range(int(rng.geometric(0.6))):
        data = _DAMAGES[rng.integers(len(_DAMAGES))](data, other, rng)
    return data


def _place(data: bytes, rng: np.random.Generator) -> int:
    """Return a position; half of the time near the beginning, where headers are."""
    return int(rng.integers(0, min(len(data), 128) + 1 if rng.random() < 0.5 else len(data) + 1))


def _piece(data: bytes, rng: np.random.Generator) -> bytes:
    start = _place(data, rng)
    return data[start : start + int(2 ** rng.uniform(0, 10))]


def _flip(data: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for _ in range(int(2 ** rng.uniform(0, 5))):
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
