"""Strangers' checkpoints for `make export` and pictures for `make learn-token`: refused in one line.

One of each goes through make; the others go to the same mains here, which imports torch and diffusers once.
"""

import json
import pickle
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

import export.__main__ as export
from export.everyday_objects.train import learn_token
from pipeline.files import path_sha256
from tests.faults import hostile
from tests.faults.door import Door


class Attack:
    """Executes where a pickle is loaded."""

    def __reduce__(self) -> tuple[Callable[..., object], tuple[str]]:
        import os

        return os.system, ("touch executed",)


def _folder(**files: str | bytes) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        path.mkdir()
        for name, content in files.items():
            file = path / name.replace("__", "/").replace("_dot_", ".")
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content if isinstance(content, bytes) else content.encode())

    return make


def _file(content: bytes) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        path.write_bytes(content)

    return make


INDEX = json.dumps({"_class_name": "StableDiffusionPipeline", "unet": ["os", "system"]})
CHECKPOINTS: dict[str, Callable[[Path], None]] = {
    "empty": _folder(),
    "cut": _folder(model_index_dot_json="{"),
    "deep": _folder(model_index_dot_json="[" * 200_000),
    "classes": _folder(model_index_dot_json=INDEX),
    "pickle": _folder(
        model_index_dot_json=json.dumps({"_class_name": "StableDiffusionPipeline"}),
        unet__diffusion_pytorch_model_dot_bin=pickle.dumps(Attack()),
    ),
    "header.safetensors": _file(struct.pack("<Q", 2**63 - 1) + b"{}"),
    "nothing.safetensors": _file(b""),
    "page.safetensors": _file(b"<!doctype html>" + bytes(100)),
    "old.ckpt": _file(pickle.dumps(Attack())),
}
PICTURES: dict[str, tuple[str, bytes]] = {
    "bomb": ("a.png", hostile.png(20_000, 20_000)),
    "cut": ("a.png", hostile.png(64, 64)[:44]),
    "gif": ("a.png", b"GIF89a" + bytes(60)),
    "page": ("a.jpg", b"<!doctype html>"),
    "empty": ("a.webp", b""),
}


def write_pictures(folder: Path, name: str) -> None:
    folder.mkdir(parents=True)
    file, content = PICTURES[name]
    for number in range(3):
        (folder / f"{number}{file}").write_bytes(content)


def refused(main: Callable[[], int], folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """Return the line by which a main refuses what lies in a folder, where nothing changes."""
    before = path_sha256(folder)
    assert main() == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert error.startswith("error: ")
    assert path_sha256(folder) == before
    assert not Path("executed").exists(), "something was executed"
    return error


def test_through_make(door: Door) -> None:
    CHECKPOINTS["pickle"](door.given / "pickle")
    assert "pickle" in door.refused("export", CHECKPOINT="given/pickle", NAME="of-a-test-of-faults")
    write_pictures(door.given / "cut", "cut")
    assert "given/cut" in door.refused("learn-token", IMAGES="given/cut", NAME="of-a-test-of-faults")


@pytest.mark.parametrize("name", CHECKPOINTS)
def test_a_checkpoint(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("given").mkdir()
    CHECKPOINTS[name](Path("given") / name)
    asked = {"CHECKPOINT": f"given/{name}", "NAME": "x"}
    assert name in refused(lambda: export.main(asked, tmp_path / "models"), Path("given"), capsys)
    assert not Path("models").exists() or not list(Path("models").iterdir())


def test_line_breaks_are_written_as_such(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    asked = {"CHECKPOINT": "a\nb\x1b[2J", "NAME": "x"}
    assert "a\\nb\\x1b[2J" in refused(lambda: export.main(asked, tmp_path / "models"), tmp_path, capsys)
    monkeypatch.setenv("IMAGES", "a\nb")
    monkeypatch.setenv("NAME", "x")
    monkeypatch.setattr("sys.argv", ["learn_token"])
    assert "a\\nb" in refused(learn_token.main, tmp_path, capsys)


@pytest.mark.parametrize("name", PICTURES)
def test_pictures(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_pictures(Path("given") / name, name)
    monkeypatch.setenv("IMAGES", f"given/{name}")
    monkeypatch.setenv("NAME", "x")
    monkeypatch.setattr("sys.argv", ["learn_token"])
    assert f"given/{name}" in refused(learn_token.main, Path("given"), capsys)
    assert not Path("tokens").exists()
