"""The wheel works from any folder: it brings the model, and the program with it."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.fake_project import ROOT, clean_environment

BUILD = "import sys, setuptools.build_meta as b; print(b.build_wheel(sys.argv[1]))"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from a copy, without a network."""
    pytest.importorskip("setuptools", minversion="77")
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    skipped = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in ("pipeline", "export", "onnx_models"):
        shutil.copytree(ROOT / name, source / name, ignore=skipped)
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE", "MANIFEST.in"):
        shutil.copy2(ROOT / name, source / name)
    command = [sys.executable, "-W", "ignore", "-c", BUILD, str(folder)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (made,) = folder.glob("*.whl")
    return made


def test_it_holds_the_model_and_everything_that_is_no_module(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    files = [
        f
        for f in (ROOT / "pipeline").rglob("*")
        if f.is_file() and "__pycache__" not in f.parts and "onnx_models" not in f.parts
    ]
    for file in files:
        assert file.relative_to(ROOT).as_posix() in names
    for file in (ROOT / "onnx_models" / "everyday-objects").rglob("*"):
        if file.is_file():
            assert f"pipeline/{file.relative_to(ROOT).as_posix()}" in names
    assert {name.partition("/")[0] for name in names if "dist-info" not in name} == {"pipeline", "export"}


def test_it_runs_from_any_folder(wheel: Path, tmp_path: Path) -> None:
    site, elsewhere = tmp_path / "site", tmp_path / "else where"
    elsewhere.mkdir()
    zipfile.ZipFile(wheel).extractall(site)  # as installers do; dependencies are those of the tests
    environment = {
        **clean_environment(),
        "PYTHONPATH": str(site),
        "XDG_DATA_HOME": str(tmp_path / "data"),
        "PROMPT": "nothing that anybody typed",
    }

    def program(*words: str) -> "subprocess.CompletedProcess[str]":
        start = "from pipeline.__main__ import console; console()"
        return subprocess.run(
            [sys.executable, "-c", start, *words],
            cwd=elsewhere,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )

    planned = program("plan", "a red armchair", "--quality", "draft")
    assert planned.returncode == 0, planned.stderr
    assert planned.stdout.startswith("runs/a-red-armchair-")
    assert "train_nerf    run" in planned.stdout
    assert list(elsewhere.iterdir()) == []
    models = program("models", "--verify")
    assert "files as made" in models.stdout
    assert f"goes to {tmp_path / 'data' / 'latent-nerf' / 'onnx_models'}" in models.stdout
    missing = program("run", "a chair", "--model", "mine")
    assert missing.returncode == 2
    assert str(tmp_path / "data" / "latent-nerf" / "onnx_models") in missing.stderr
    shutil.copytree(
        site / "pipeline" / "onnx_models" / "everyday-objects",
        tmp_path / "data" / "latent-nerf" / "onnx_models" / "mine",
    )
    assert program("plan", "a chair", "--model", "mine").returncode == 0


def test_the_models_it_brings_are_those_of_the_clone(wheel: Path) -> None:
    name = "onnx_models/everyday-objects/bundle.json"
    with zipfile.ZipFile(wheel) as archive:
        assert archive.read(f"pipeline/{name}") == (ROOT / name).read_bytes()
    assert os.path.getsize(wheel) < 60e6
