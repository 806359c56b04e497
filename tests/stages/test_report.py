"""The report's files agree with the run they describe."""

import json
import os
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.files import file_sha256
from pipeline.options.job import Job, to_yaml
from pipeline.run.stage import Context
from pipeline.run.verify import verify
from pipeline.stages.report import main

JOB = Job(prompt="a red ball", seed=3)
OUTPUTS = {
    "publish": ["asset.glb", "asset.obj", "asset.mtl", "albedo.png", "preview.png", "turntable.mp4"],
    "clean": ["mesh.ply"],
}


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run whose stages have been made, and its report."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "job.yaml").write_text(to_yaml(JOB))
    (tmp_path / "stages").mkdir()
    for stage, names in OUTPUTS.items():
        for name in names:
            (tmp_path / name).write_text(f"content of {name}")
        entry = {
            "stage": stage,
            "seconds": 1.25,
            "peak_memory_mb": 100.0 if stage == "clean" else 200.0,
            "outputs": {name: {"path": name, "sha256": file_sha256(Path(name))} for name in names},
            "versions": {},
            "metrics": {},
        }
        Path(f"stages/{stage}.json").write_text(json.dumps(entry))
    inputs = {stage: Path(f"stages/{stage}.json") for stage in OUTPUTS}
    inputs |= {"glb": Path("asset.glb"), "preview": Path("preview.png"), "turntable": Path("turntable.mp4")}
    Path("partial").mkdir()
    outputs = {"report": Path("partial/report.html"), "manifest": Path("partial/manifest.json")}
    main(Context(JOB, inputs, outputs, tmp_path / "scratch"))
    for path in outputs.values():
        os.replace(path, path.name)
    return tmp_path


def test_the_manifest_holds_every_file_of_the_run(run: Path) -> None:
    manifest = json.loads((run / "manifest.json").read_text())
    present = {p.relative_to(run).as_posix() for p in run.rglob("*") if p.is_file()} - {"manifest.json"}
    assert set(manifest["files"]) == present
    for name, facts in manifest["files"].items():
        assert facts == {"bytes": (run / name).stat().st_size, "sha256": file_sha256(run / name)}
    assert manifest["seconds"] == 2.5
    assert manifest["peak_memory_mb"] == 200.0
    assert manifest["job"]["seed"] == 3
    assert "a red ball" in (run / "report.html").read_text()


def test_verify_names_exactly_what_differs(run: Path) -> None:
    assert verify(run) == (11, [])
    (run / "asset.glb").write_text("Content of asset.glb")
    (run / "report.html").write_text("")
    (run / "mesh.ply").unlink()
    assert verify(run) == (11, ["asset.glb differs", "mesh.ply is missing", "report.html differs"])
    (run / "manifest.json").unlink()
    with pytest.raises(InputError, match=r"manifest\.json"):
        verify(run)
