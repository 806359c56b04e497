"""The figures that are published are those that were asked for: a worse result cannot be committed unseen."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.fake_project import ROOT

RESULTS = ROOT / "benchmarks" / "results"


def summary(name: str) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
    found: dict[str, Any] = document["summary"]
    return found


def test_the_oracle_reaches_the_papers_error_in_a_tenth_of_its_calls() -> None:
    oracle = summary("oracle")
    assert oracle["calls_for_paper_error"] <= 500
    plain = oracle["plain_scenes"]
    assert plain["standard"]["psnr"] >= plain["paper"]["psnr"]


def test_training_never_ends_before_every_error_is_within_a_twentieth_of_its_final_value() -> None:
    convergence = summary("oracle")["convergence"]
    assert convergence["worst_error_ratio"] <= 1.05
    assert convergence["worst_normal_error_ratio"] <= 1.05
    assert convergence["worst_chamfer_ratio"] <= 1.05
    assert convergence["ended_early"] >= 4, "hardly anything ended early, so hardly anything was proven"
    assert convergence["steps_saved"] >= 0.1


def test_the_kernels_are_as_much_faster_as_asked() -> None:
    field = summary("field")
    assert field["speedup_encoding"] >= 15
    assert field["speedup_step"] >= 8
    assert field["speedup_skipping"] >= 25
    assert field["psnr_drop_db"] <= 0.1


MEASURED = sorted(path for path in RESULTS.glob("*.json") if path.name != "paper-remarks.json")
"""The remarks are written by hand, see benchmarks/paper.py."""


@pytest.mark.parametrize("path", MEASURED, ids=lambda path: Path(path).stem)
def test_every_result_names_its_machine_and_versions(path: Path) -> None:
    document = json.loads(path.read_text(encoding="utf-8"))
    assert document["summary"]
    assert document["machine"]
    assert document["versions"]["torch"].startswith("2.")
