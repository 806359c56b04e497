"""A short run of the fuzzer, and that it would notice."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InputError
from tests.faults import fuzz
from tests.faults.mutate import mutate
from tests.faults.targets import Target, targets

CASES = 125
"""Five of every format."""


def test_damaged_files_are_read_or_refused_in_one_line(tmp_path: Path) -> None:
    known = targets(tmp_path / "whole")
    results = fuzz.fuzz(known, 0, 0, lambda case: case < CASES, tmp_path, tmp_path / "kept")
    failed = [one for one in results if one.status not in ("read", "refused")]
    assert not failed, [p.read_text() for p in (tmp_path / "kept").glob("*/said.txt")]
    assert {one.target for one in results} == {*known}
    assert {one.status for one in results} == {"read", "refused"}


def test_whole_files_are_read(tmp_path: Path) -> None:
    for number, (name, target) in enumerate(targets(tmp_path / "whole").items()):
        for row, data in enumerate(target.seeds):
            folder = tmp_path / f"{number}-{row}"
            folder.mkdir()
            if name != "manifest":  # its files are not there
                assert fuzz.read_case(target, data, folder) == fuzz.READ, name


@pytest.mark.parametrize(("read", "word"), [
    (lambda path: 1 / 0, "no InputError"),
    (lambda path: bytearray(1 << 40), "no InputError"),
    (lambda path: __import__("os").abort(), "SIGABRT"),
    (lambda path: __import__("time").sleep(9), "more than"),
])  # fmt: skip
def test_what_goes_wrong_is_seen_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: object, word: str
) -> None:
    monkeypatch.setattr(fuzz, "WAIT", 0.5)
    known = {"thing": Target("case.thing", [b"thing"], read)}
    (ended,) = fuzz.fuzz(known, 0, 0, lambda case: case < 1, tmp_path, tmp_path / "kept")
    assert word in ended.status
    (kept,) = (tmp_path / "kept").iterdir()
    assert (kept / "case.thing").read_bytes() == fuzz.make_case(known, 0, 0)[1]


def test_errors_of_several_lines_fail(tmp_path: Path) -> None:
    def read(path: Path) -> None:
        raise InputError("two\nlines")

    assert fuzz.read_case(Target("x", [b""], read), b"", tmp_path) == fuzz.FAILED


def test_a_case_is_made_of_its_seed_and_number() -> None:
    known = {name: Target(name, [bytes(range(256)) * 4], lambda path: None) for name in "ab"}
    cases = [fuzz.make_case(known, 3, number) for number in range(40)]
    assert cases == [fuzz.make_case(known, 3, number) for number in range(40)]
    assert len({data for _, data in cases}) > 30
    rng = np.random.default_rng(0)
    for data in (b"", b"1", b"a 12 b"):
        for _ in range(200):
            mutate(data, b"", rng)
