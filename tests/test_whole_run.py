"""From a prompt to an asset through the front door, every real stage, with a tiny model."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.files import file_sha256
from tests.fake_project import ROOT, clean_environment, kill_group
from tests.tiny_bundle import write_tiny_bundle

PROMPT = "a red ball"
OPTIONS = """
train_nerf: {steps: 40, cameras_per_step: 2, samples_per_ray: 32, checkpoint_every: 5, preview_every: 20}
refinement: {fit_steps: 4, steps: 6, cameras_per_step: 2}
extract: {resolution: 32, views: 6}
clean: {faces: 600}
unwrap: {resolution: 128, padding: 2}
bake: {views: 6, texture: 128}
publish: {preview_size: 48, turntable_size: 48, turntable_frames: 6}
"""


def command(folder: Path, out: str, **more: str) -> list[str]:
    given = {
        "PROMPT": PROMPT,
        "MODEL": str(folder / "model"),
        "JOB": str(folder / "job.yaml"),
        "OUT": str(folder / out),
        **more,
    }
    arguments = [
        f"{name}={value}" for name, value in {"IN_VENV": sys.executable, "THREADS": "2", **given}.items()
    ]
    return ["make", "-o", ".venv/.runtime", "run", *arguments]


def make(folder: Path, out: str, **more: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        command(folder, out, **more),
        cwd=ROOT,
        env=clean_environment(),
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a model, a job and a finished run in `runs`."""
    folder = tmp_path_factory.mktemp("whole")
    write_tiny_bundle(folder / "model")
    (folder / "job.yaml").write_text(OPTIONS)
    result = make(folder, "runs")
    assert result.returncode == 0, result.stderr
    paths = [Path(line) for line in result.stdout.splitlines()[-2:]]
    assert [path.name for path in paths] == ["asset.glb", "report.html"]
    assert all(path.is_file() for path in paths)
    return folder


def test_the_asset_is_one_textured_manifold_mesh(folder: Path) -> None:
    scene = trimesh.load_scene(folder / "runs" / "latest" / "asset.glb")
    (mesh,) = scene.geometry.values()
    assert 50 < len(mesh.faces) <= 600
    merged = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    merged.merge_vertices(merge_tex=True, merge_norm=True)
    assert merged.is_watertight
    assert np.isfinite(mesh.vertices).all()
    assert np.abs(mesh.vertices).max() <= 1
    uv = mesh.visual.uv
    assert uv.min() >= 0
    assert uv.max() <= 1
    assert mesh.visual.material.baseColorTexture.size == (128, 128)
    # the tiny model's ideal image is a disc of a quarter of the view: the mesh is a ball around the centre
    extents = merged.extents
    assert extents.min() > 0.6 * extents.max()


def test_the_manifest_tells_the_seconds_and_memory_of_every_stage(folder: Path) -> None:
    manifest = json.loads((folder / "runs" / "latest" / "manifest.json").read_text())
    assert [entry["stage"] for entry in manifest["stages"]] == [
        "embed", "train_nerf", "extract", "clean", "unwrap", "bake", "publish"]  # fmt: skip
    for entry in manifest["stages"]:
        assert entry["seconds"] > 0
        assert 20 < entry["peak_memory_mb"] < 4096
        assert entry["threads"] == 2


def test_again_is_nothing_and_quick(folder: Path) -> None:
    """Under 5 s on an idle machine; processor time says the same on a busy one."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    result = make(folder, "runs")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert "nothing to do" in result.stderr
    assert after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime < 5


@pytest.mark.thorough  # and killed in every stage: tests/faults/test_kills.py
def test_killed_in_training_and_continued_is_the_same_asset(folder: Path) -> None:
    process = subprocess.Popen(
        command(folder, "killed"),
        cwd=ROOT,
        env=clean_environment(),
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 120
    while not list(folder.glob("killed/*/checkpoints/train_nerf/*.checkpoint")):
        assert process.poll() is None, "ended before the first checkpoint"
        assert time.monotonic() < deadline
        time.sleep(0.01)
    kill_group(process)
    assert not list(folder.glob("killed/*/field.npz")), "killed too late to test anything"
    result = make(folder, "killed")
    assert result.returncode == 0, result.stderr
    for name in ("field.npz", "asset.glb", "albedo.png", "preview.png"):
        assert file_sha256(folder / "killed" / "latest" / name) == file_sha256(
            folder / "runs" / "latest" / name
        ), name


def test_ctrl_c_in_training_keeps_the_step_that_it_is_in(folder: Path) -> None:
    """Without a checkpoint due: steps are many, and so are those between checkpoints."""
    often, never = "checkpoint_every: 5, preview_every: 20", "checkpoint_every: 100000, preview_every: 5"
    (folder / "long.yaml").write_text(OPTIONS.replace(often, never).replace("steps: 40", "steps: 100000"))

    def start() -> "subprocess.Popen[str]":
        return subprocess.Popen(
            command(folder, "long", JOB=str(folder / "long.yaml")), cwd=ROOT, env=clean_environment(),
            stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, start_new_session=True,
            # Tests that run in the background ignore it, and so would this.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )  # fmt: skip

    process = start()
    deadline = time.monotonic() + 120
    shown: set[int] = set()
    while len(shown) < 2:  # the first is of what training begins with
        shown |= {path.stat().st_ino for path in folder.glob("long/*/checkpoints/train_nerf/preview_*.png")}
        assert process.poll() is None, "ended before the second preview"
        assert time.monotonic() < deadline
        time.sleep(0.01)
    (scratch,) = folder.glob("long/*/checkpoints/train_nerf")
    assert not list(scratch.glob("*.checkpoint"))
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert "stopped; the same command goes on from here" in said
    (kept,) = scratch.glob("*.checkpoint")
    again = start()
    assert again.stderr is not None
    line = next(line for line in again.stderr if "continues after step" in line)
    assert int(line.split()[-1]) == int(kept.stem) >= 5
    kill_group(again)


def test_a_wrong_number_of_threads_in_the_caller_changes_nothing(folder: Path) -> None:
    """Threads come from THREADS or the machine, never from the caller's environment."""
    from pipeline.run.snakemake_process import environment

    made = environment(2, {**os.environ, "OMP_NUM_THREADS": "7", "PYTHONHASHSEED": "9"})
    assert (made["OMP_NUM_THREADS"], made["NUMBA_NUM_THREADS"], made["PYTHONHASHSEED"]) == ("2", "2", "0")


def test_termination_stops_everything(folder: Path) -> None:
    process = subprocess.Popen(
        command(folder, "stopped"),
        cwd=ROOT,
        env=clean_environment(),
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60
    while not (logs := list(folder.glob("stopped/*/logs/embed.log"))):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    os.kill(int((logs[0].parents[1] / ".lock").read_text()), signal.SIGTERM)
    _, errors = process.communicate(timeout=30)
    assert process.returncode != 0
    assert "the same command goes on from here" in errors
    assert "Traceback" not in errors


def test_refined_goes_on_from_the_trained_scene(folder: Path) -> None:
    result = make(folder, "runs", REFINE="1", FORMATS="stl,3mf")
    assert result.returncode == 0, result.stderr
    latest = folder / "runs" / "latest"
    reused = [line for line in result.stderr.splitlines() if "reused from" in line]
    assert [line.split(":")[0] for line in reused] == ["embed", "train_nerf"]
    assert "vae_encoder_vjp" in result.stderr, "the tiny bundle lacks it, which is said"
    stages = [entry["stage"] for entry in json.loads((latest / "manifest.json").read_text())["stages"]]
    made = ["extract", "clean", "unwrap", "bake", "publish", "formats"]
    assert stages == ["embed", "train_nerf", "refine", *made]
    assert trimesh.load_mesh(latest / "asset.stl").is_watertight
    assert 'href="asset.3mf"' in (latest / "report.html").read_text()
    (mesh,) = trimesh.load_scene(latest / "asset.glb").geometry.values()
    assert mesh.visual.material.baseColorTexture.size == (128, 128)
