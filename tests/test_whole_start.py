"""From an asset instead of from nothing, through the front door, every real stage, with tiny models."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.files import file_sha256
from tests.fake_project import ROOT, clean_environment, kill_group
from tests.test_whole_run import OPTIONS
from tests.tiny_bundle import write_tiny_bundle

FIT = "start_fit: {views: 8, steps: 20, cells: 24}\n"
PAINT = "train_paint: {steps: 20, cameras_per_step: 2, views: 8, texture: 32, supersampling: 2}\n"


def command(folder: Path, out: str, target: str = "run", **more: str) -> list[str]:
    given = {
        "PROMPT": "a red ball",
        "MODEL": f"{folder / 'small'},{folder / 'large'}",
        "JOB": str(folder / "job.yaml"),
        "OUT": str(folder / out),
        "IN_VENV": sys.executable,
        "THREADS": "2",
        **more,
    }
    return ["make", "-o", ".venv/.runtime", target, *(f"{n}={value}" for n, value in given.items())]


def make(folder: Path, out: str, target: str = "run", **more: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        command(folder, out, target, **more),
        cwd=ROOT, env=clean_environment(), capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two models of different latents and an asset that one handed over to the other."""
    folder = tmp_path_factory.mktemp("start")
    for name in ("small", "large"):
        write_tiny_bundle(folder / name)
    (folder / "large" / "vae_decoder" / "note").write_text("other latents")
    (folder / "job.yaml").write_text(OPTIONS + FIT + PAINT + "bake_paint: {views: 6, texture: 128}\n")
    plan = make(folder, "runs", "plan")
    assert plan.returncode == 0, plan.stderr
    assert plan.stdout.count("about ") == 3, "of each model, and of both"
    assert "after a-red-ball-" in plan.stdout
    assert not (folder / "runs").exists()
    result = make(folder, "runs")
    assert result.returncode == 0, result.stderr
    assert len(list((folder / "runs").glob("*/asset.glb"))) == 3, "two runs, and latest"
    return folder


def test_the_second_model_starts_from_the_first_ones_views(folder: Path) -> None:
    latest = folder / "runs" / "latest"
    manifest = json.loads((latest / "manifest.json").read_text())
    stages = {entry["stage"]: entry["metrics"] for entry in manifest["stages"]}
    assert list(stages)[:3] == ["embed", "start", "train_nerf"]
    assert stages["start"]["fitted"]
    assert stages["train_nerf"]["steps"] == 10, "a quarter of 40"
    assert "start.npz" in manifest["files"]
    (before,) = stages["start"]["before"]
    assert before["calls"] == 40
    assert "What each model spent" in (latest / "report.html").read_text()


def test_again_is_nothing_and_plan_knows(folder: Path) -> None:
    assert make(folder, "runs").stderr.count("nothing to do") == 2
    assert "nothing would run" in make(folder, "runs", "plan").stdout


@pytest.mark.thorough  # killed in every stage: tests/faults/test_kills.py
def test_killed_on_the_way_and_continued_is_the_same_asset(folder: Path) -> None:
    process = subprocess.Popen(
        command(folder, "killed"), cwd=ROOT, env=clean_environment(), stderr=subprocess.PIPE,
        stdout=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    deadline = time.monotonic() + 300
    while not list((folder / "killed").glob("*/checkpoints/start/preview_training.png")):
        assert process.poll() is None, "ended before the fit began"
        assert time.monotonic() < deadline
        time.sleep(0.01)
    kill_group(process)
    result = make(folder, "killed")
    assert result.returncode == 0, result.stderr
    for name in ("start.npz", "field.npz", "asset.glb", "albedo.png"):
        one, other = (folder / out / "latest" / name for out in ("killed", "runs"))
        assert file_sha256(one) == file_sha256(other), name


def test_a_mesh_takes_the_colours_of_a_run(folder: Path) -> None:
    run = folder / "runs" / "latest"
    result = make(
        folder,
        "runs",
        MODEL=str(folder / "small"),
        MESH=str(run / "asset.obj"),
        START=str(run),
        STRENGTH="0.2",
    )
    assert result.returncode == 0, result.stderr
    painted = json.loads((folder / "runs" / "latest" / "manifest.json").read_text())
    stages = {entry["stage"]: entry["metrics"] for entry in painted["stages"]}
    assert list(stages)[:4] == ["embed", "prepare", "start_paint", "train_paint"]
    assert stages["train_paint"]["steps"] == 4
    assert "start_painted.npz" in painted["files"]


def test_a_fault_of_the_start_is_one_line(folder: Path) -> None:
    (folder / "plain.stl").write_text("solid a\nendsolid a\n")
    for start, fault in ((folder / "plain.stl", "no faces"), (folder, "is no run that has got as far")):
        result = make(folder, "runs", MODEL=str(folder / "small"), START=str(start))
        assert result.returncode == 2
        assert fault in result.stderr.strip().splitlines()[-2], result.stderr
