"""Models of strangers: every damage to a file is one line that names it."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.faults.door import Door


def _json(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], None]:
    def damage(path: Path) -> None:
        value = json.loads(path.read_text()) if path.exists() else {}
        path.write_text(json.dumps(change(value)))

    return damage


def _text(text: str | bytes) -> Callable[[Path], None]:
    def damage(path: Path) -> None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())

    return damage


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:200])


def _without_bias(described: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in described.items() if name != "latent_to_rgb_bias"}


DAMAGE: dict[str, tuple[str, Callable[[Path], None], str]] = {
    "deep": ("bundle.json", _text("[" * 200_000), "nested too deeply"),
    "number": ("bundle.json", _text("3"), "expected an object"),
    "empty": ("bundle.json", _text(""), "0 bytes"),
    "latin": ("bundle.json", _text(b'{"name": "\xe9"}'), "no valid JSON"),
    "no bias": ("bundle.json", _json(_without_bias), "latent_to_rgb_bias"),
    "huge bias": (
        "bundle.json",
        _json(lambda v: {**v, "latent_to_rgb_bias": [10**400, 0, 0]}),
        "finite numbers",
    ),
    "key": ("bundle.json", _json(lambda v: {**v, "distillation": {"setps": 3}}), "setps"),
    "section": ("bundle.json", _json(lambda v: {**v, "distillation": [3]}), "bundle.json"),
    "outside": (
        "bundle.json",
        _json(lambda v: {**v, "files": {"../../etc/passwd": "0"}}),
        "inside the bundle",
    ),
    "sum": ("bundle.json", _json(lambda v: {**v, "files": {"unet/model.onnx": "0"}}), "checksum"),
    "camera": ("bundle.json", _json(lambda v: {**v, "camera": [["azimuth"]]}), "camera"),
    "negative id": ("tokenizer/vocab.json", _json(lambda v: {**v, "a</w>": -1}), "token numbers run from -1"),
    "huge id": ("tokenizer/vocab.json", _json(lambda v: {**v, "a</w>": 2**41}), "token numbers"),
    "surrogate": ("tokenizer/vocab.json", _text('{"\\ud800": 1}'), "half of a character"),
    "no end": ("tokenizer/vocab.json", _text('{"a": 1}'), "<|startoftext|>"),
    "merges": ("tokenizer/merges.txt", _text("#version\na b c\n"), "line 2"),
    "foreign merges": ("tokenizer/merges.txt", _text("#version\nqqq zzz\n"), "merges"),
    "schedule": ("scheduler/scheduler_config.json", _text("{"), "scheduler_config.json"),
    "betas": ("scheduler/scheduler_config.json", _json(lambda v: {**v, "beta_start": "NaN"}), "beta_start"),
    "pointer": ("unet/model.onnx", _text("version https://git-lfs.github.com/spec/v1\n"), "git lfs pull"),
    "page": ("unet/model.onnx", _text("<!doctype html>"), "a web page"),
    "cut": ("unet/model.onnx", _cut, "break off"),
    "nothing": ("vae_decoder/model.onnx", _text(""), "0 bytes"),
    "gone": ("text_encoder/model.onnx", Path.unlink, "missing"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_named(door: Door, name: str, tmp_path: Path) -> None:
    place, damage, words = DAMAGE[name]
    model = tmp_path / "model"
    shutil.copytree(door.folder / "model", model)
    if place != "bundle.json" and (model / "bundle.json").exists():
        described = json.loads((model / "bundle.json").read_text())
        (model / "bundle.json").write_text(json.dumps({**described, "files": {}}))
    damage(model / place)
    said = door.refused("plan", words, MODEL=str(model))
    assert place.rpartition("/")[2] in said
    assert str(tmp_path) in said, "as it was typed"


@pytest.mark.parametrize("merges", [None, [1, 2], [[1, 2]], "ab", [["a"]]])
def test_the_merges_of_one_file(door: Door, merges: object, tmp_path: Path) -> None:
    model = tmp_path / "model"
    shutil.copytree(door.folder / "model", model)
    described = json.loads((model / "bundle.json").read_text())
    (model / "bundle.json").write_text(json.dumps({**described, "files": {}}))
    vocabulary = json.loads((model / "tokenizer" / "vocab.json").read_text())
    for name in ("vocab.json", "merges.txt"):
        (model / "tokenizer" / name).unlink()
    whole = {"model": {"vocab": vocabulary, "merges": merges}}
    (model / "tokenizer" / "tokenizer.json").write_text(json.dumps(whole))
    door.refused("plan", "tokenizer.json", "merges", MODEL=str(model))
