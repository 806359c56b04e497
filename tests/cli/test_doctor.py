"""What the doctor finds, and that it says what to do about it."""

import importlib
from pathlib import Path
from types import ModuleType

import pytest

from pipeline.cli import doctor
from pipeline.cli.doctor import Finding, checks, report


def test_every_part_of_a_machine_is_looked_at(tmp_path: Path) -> None:
    found = {finding.what: finding for finding in checks(tmp_path / "runs", 1)}
    assert {"Python", "packages", "processor", "memory", "disk", "onnxruntime", "locks"} <= set(found)
    assert found["locks"].state == found["disk"].state == "ok"
    assert not (tmp_path / "runs").exists(), "it only looks"


def test_a_library_that_does_not_load_is_wrong_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def load(name: str) -> ModuleType:
        if name == "pymeshlab":
            raise ImportError("libGL.so.1: cannot open shared object file")
        return importlib.import_module(name)

    assert "libraries" not in {finding.what for finding in checks(tmp_path, 1)}
    monkeypatch.setattr(doctor, "import_module", load)
    (lacking,) = [finding for finding in checks(tmp_path, 1) if finding.what == "libraries"]
    assert lacking.state == "wrong"
    assert "pymeshlab: libGL.so.1" in lacking.found
    assert "libgl1" in lacking.mend


@pytest.mark.parametrize(
    ("version", "bounds", "kept"),
    [
        ("2.13.0", "==2.13.0", True),
        ("2.13.0+cpu", "==2.13.0", True),
        ("2.12.1", ">=2.13", False),
        ("2025.7.post1", ">=2025.7", True),
        ("2.4.6", ">=2.2,<3", True),
        ("3.0", ">=2.2,<3", False),
    ],
)
def test_bounds_of_versions(version: str, bounds: str, kept: bool) -> None:
    assert doctor._within(version, bounds) is kept


def test_the_report_counts_what_is_wrong() -> None:
    said: list[str] = []
    findings = [Finding("ok", "disk", "9 GB"), Finding("wrong", "memory", "10 MB", "close programs")]
    assert report(iter(findings), said.append) == 1
    assert said == ["ok     disk: 9 GB", "wrong  memory: 10 MB", "       -> close programs"]
