"""Stages forked by a server do what stages that start by themselves do, and end with whoever called them."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.run.stage_server import ADDRESS
from tests.fake_project import Project, clean_environment

RAW = "a mesh"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Project:
    return Project(tmp_path_factory.mktemp("warm"))


@pytest.fixture
def run(project: Project) -> Path:
    """A run's folder with the input of the stage `clean`."""
    folder = project.root / "run"
    folder.mkdir(exist_ok=True)
    (folder / "job.yaml").write_text("prompt: a red ball\n")
    (folder / "mesh_raw.ply").write_text(RAW)
    for made in ("mesh.ply", "stages/clean.json", "stages/clean.error"):
        (folder / made).unlink(missing_ok=True)
    return folder


@pytest.fixture
def server(project: Project, run: Path) -> Iterator[dict[str, str]]:
    """The environment in which a server of `clean` and `train_nerf` is found."""
    environment = {**clean_environment(), "PYTHONPATH": str(project.root)}
    serving = subprocess.Popen(
        [sys.executable, "-m", "pipeline.run.stage_server", "--serve", ".warm", "clean", "train_nerf"],
        cwd=run, env=environment,
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while not (run / ".warm").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    yield {**environment, ADDRESS: ".warm"}
    serving.kill()
    serving.wait()
    (run / ".warm").unlink()


def arguments(stage: str, source: str, target: str) -> list[str]:
    files = [f"--input=mesh={source}", f"--output=mesh={target}"]
    return [sys.executable, "-m", "pipeline.run.stage_server", stage, "--job", "job.yaml", *files]


def clean(run: Path, environment: dict[str, str]) -> "subprocess.CompletedProcess[str]":
    command = arguments("clean", "mesh_raw.ply", "mesh.ply")
    return subprocess.run(command, cwd=run, env=environment, capture_output=True, text=True, check=False)


def test_a_fork_of_the_server_does_what_the_stage_does(
    project: Project, run: Path, server: dict[str, str]
) -> None:
    served = clean(run, server)
    assert (served.returncode, served.stdout.splitlines()[:2]) == (0, ["clean ...", "ran clean"])
    made = (run / "mesh.ply").read_text()
    (run / "stages" / "clean.json").unlink()
    alone = clean(run, {name: value for name, value in server.items() if name != ADDRESS})
    assert (alone.returncode, alone.stdout.splitlines()[:2]) == (0, ["clean ...", "ran clean"])
    assert (run / "mesh.ply").read_text() == made


def test_the_server_has_imported_the_stage_before_it_is_called(
    project: Project, run: Path, server: dict[str, str]
) -> None:
    assert clean(run, server).returncode == 0  # by now it has
    source = project.root / "pipeline" / "stages" / "clean.py"
    text = source.read_text()
    (run / "stages" / "clean.json").unlink()
    try:
        source.write_text("raise RuntimeError('imported anew')\n" + text)
        assert clean(run, server).returncode == 0
        (run / "stages" / "clean.json").unlink()
        alone = clean(run, {name: value for name, value in server.items() if name != ADDRESS})
        assert "imported anew" in alone.stderr
    finally:
        source.write_text(text)


@pytest.mark.parametrize(("kind", "status"), [("input", 2), ("fault", 1)])
def test_failures_come_back(
    project: Project, run: Path, server: dict[str, str], kind: str, status: int
) -> None:
    fail = project.root / "fail-clean"
    fail.write_text(kind)
    try:
        assert clean(run, server).returncode == status
        assert (run / "stages" / "clean.error").read_text().startswith(f"{status} ")
    finally:
        fail.unlink()


def test_a_stage_ends_with_its_caller(project: Project, run: Path, server: dict[str, str]) -> None:
    (project.root / "slow").write_text("0.1")
    step = run / "checkpoints" / "train_nerf" / "step.checkpoint"
    step.unlink(missing_ok=True)
    caller = subprocess.Popen(arguments("train_nerf", "mesh_raw.ply", "field.npz"), cwd=run, env=server)
    try:
        deadline = time.monotonic() + 60
        while not step.exists() and time.monotonic() < deadline:
            time.sleep(0.02)
        assert caller.poll() is None
        os.kill(caller.pid, signal.SIGKILL)
        caller.wait()
        reached: list[str] = []
        while reached[-1:] != reached[-2:-1] or not reached:  # the server may be in the middle of an import
            assert len(reached) < 20
            time.sleep(0.5)
            reached.append(step.read_text())
        assert not (run / "field.npz").exists()
        # The server goes on serving.
        assert clean(run, server).returncode == 0
    finally:
        (project.root / "slow").unlink()


def test_a_server_that_is_told_to_end_while_it_imports_ends(project: Project, run: Path) -> None:
    """Some libraries catch everything while they are imported, the interrupt with it."""
    stage = project.root / "pipeline" / "stages" / "catches.py"
    started = run / "started"
    stage.write_text(
        f"import pathlib, time\ntry:\n    pathlib.Path({str(started)!r}).touch()\n    time.sleep(60)\n"
        "except BaseException:\n    pass\n"
    )
    serving = subprocess.Popen(
        [sys.executable, "-m", "pipeline.run.stage_server", "--serve", ".catches", "catches"],
        cwd=run, env={**clean_environment(), "PYTHONPATH": str(project.root)},
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while not started.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    serving.terminate()
    try:
        assert serving.wait(30) == 0
    finally:
        serving.kill()
        stage.unlink()


def test_without_an_answering_server_the_stage_starts_by_itself(project: Project, run: Path) -> None:
    environment = {**clean_environment(), "PYTHONPATH": str(project.root), ADDRESS: "nobody"}
    assert clean(run, environment).returncode == 0
    assert (run / "mesh.ply").is_file()
