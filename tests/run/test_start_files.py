"""What a run that another starts from has spent: told by its manifest, believed only as far as it holds."""

import json
from pathlib import Path

import pytest

from pipeline.run.start_files import spent_before

TRAINING = {"stage": "train_nerf", "seconds": 2.0, "metrics": {"steps": 50}}


def manifest(**metrics: object) -> str:
    rows = [{"stage": "start", "seconds": 1.0, "metrics": metrics}, TRAINING]
    return json.dumps({"job": {"model": "tiny"}, "stages": rows})


def test_rows_of_earlier_runs_come_first(tmp_path: Path) -> None:
    before = {"run": "first", "model": "small", "calls": 7, "training_seconds": 1.5, "seconds": 3.0}
    (tmp_path / "manifest.json").write_text(manifest(before=[before]))
    earlier, own = spent_before(tmp_path / "scene.npz")
    assert earlier == before
    assert own == {
        "run": tmp_path.name, "model": "tiny", "calls": 50, "training_seconds": 2.0, "seconds": 3.0
    }  # fmt: skip


@pytest.mark.parametrize("text", [
    "[" * 200_000, "", "[]", "{}", manifest(before=["x"]), manifest(before=3), manifest(before=[{"run": 1}]),
])  # fmt: skip
def test_a_damaged_manifest_tells_nothing(text: str, tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text(text)
    assert spent_before(tmp_path / "scene.npz") == []
