"""Strangers' checkpoints for `make export` and pictures for `make learn-token`: refused in one line."""

import json
import pickle
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

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


@pytest.mark.parametrize("name", CHECKPOINTS)
def test_a_checkpoint(door: Door, name: str) -> None:
    CHECKPOINTS[name](door.given / name)
    said = door.refused("export", CHECKPOINT=f"given/{name}", NAME="of-a-test-of-faults")
    assert name in said


@pytest.mark.parametrize("name", PICTURES)
def test_pictures(door: Door, name: str) -> None:
    folder = door.given / f"pictures-{name}"
    folder.mkdir()
    file, content = PICTURES[name]
    for number in range(3):
        (folder / f"{number}{file}").write_bytes(content)
    said = door.refused("learn-token", IMAGES=f"given/pictures-{name}", NAME="of-a-test-of-faults")
    assert f"given/pictures-{name}" in said
