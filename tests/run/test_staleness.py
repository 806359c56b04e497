"""Keys that change when, and only when, something that matters changes."""

import ast
import importlib.metadata
import json
import os
from pathlib import Path

import pytest

from pipeline.files import file_sha256, path_sha256
from pipeline.run import staleness
from pipeline.run.chain import STAGES


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package: p.a imports p.b lazily, p.b imports from p.sub relatively, p.sub.d imports p.a (a cycle)."""
    files = {
        "p/__init__.py": "",
        "p/a.py": "import numpy as np\ndef f():\n    from p import b\n",
        "p/b.py": "from .sub import c, VALUE\n",
        "p/sub/__init__.py": "VALUE = 1\n",
        "p/sub/c.py": "from ..sub.d import thing\nimport os.path\n",
        "p/sub/d.py": "import p.a\nthing = 1\n",
        "p/alone.py": "import yaml\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_the_closure_holds_every_module_that_is_imported(package: Path) -> None:
    files, packages = staleness.sources("p.a", package)
    names = {path.relative_to(package).as_posix() for path in files}
    assert names == {"p/__init__.py", "p/a.py", "p/b.py", "p/sub/__init__.py", "p/sub/c.py", "p/sub/d.py"}
    assert packages == {"numpy"}


def code_hash(root: Path) -> str:
    staleness.code.cache_clear()
    return staleness.code("p.a", root)[0]


def test_the_code_hash_follows_the_closure_only(package: Path) -> None:
    before = code_hash(package)
    (package / "p/alone.py").write_text("import yaml, os\n")
    assert code_hash(package) == before
    for name in ("p/sub/d.py", "p/sub/__init__.py", "p/a.py"):
        path = package / name
        path.write_text(path.read_text() + "# changed\n")
        assert code_hash(package) != before
        before = code_hash(package)


def test_every_stage_knows_the_versions_of_what_it_imports() -> None:
    for stage in STAGES:
        source, versions = staleness.code(f"pipeline.stages.{stage}")
        assert len(source) == 64
        assert all(versions.values())
    assert {"torch", "numba", "numpy", "onnxruntime"} <= set(staleness.code("pipeline.stages.train_nerf")[1])
    assert "torch" not in staleness.code("pipeline.stages.report")[1]


def test_another_wheel_in_a_packages_stead_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.metadata.version

    def version(name: str) -> str:
        if name == "onnxruntime":
            raise importlib.metadata.PackageNotFoundError(name)
        return "9.8" if name == "onnxruntime-gpu" else real(name)

    monkeypatch.setattr(importlib.metadata, "version", version)
    monkeypatch.setattr(
        importlib.metadata, "packages_distributions", lambda: {"onnxruntime": ["onnxruntime-gpu"]}
    )
    staleness._version.cache_clear()
    try:
        assert staleness._version("onnxruntime") == "onnxruntime-gpu 9.8"
    finally:
        staleness._version.cache_clear()


def test_every_part_of_a_key_counts() -> None:
    def key(
        options: int = 1, module: str = "pipeline.stages.report", name: str = "mesh", sha: str = "0"
    ) -> str:
        return staleness.key({"faces": options}, module, {name: sha})

    keys = [key(), key(options=2), key(module="pipeline.stages.clean"), key(name="scene"), key(sha="1")]
    assert len(set(keys)) == 5
    assert key() == key()


def test_stages_read_only_the_options_that_they_declare() -> None:
    """An option read but not declared would not be in the key, and a change of it would be overlooked."""
    for stage, known in STAGES.items():
        source = (staleness.ROOT / "pipeline" / "stages" / f"{stage}.py").read_text()
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Attribute) and ast.unparse(node.value).endswith(("context.job", "job")):
                assert node.attr in known.options, f"{stage} reads job.{node.attr}"


def test_folders_are_hashed_by_names_and_contents(tmp_path: Path) -> None:
    (tmp_path / "m" / "sub").mkdir(parents=True)
    (tmp_path / "m" / "a").write_text("1")
    (tmp_path / "m" / "sub" / "b").write_text("2")
    before = path_sha256(tmp_path / "m")
    os.utime(tmp_path / "m" / "a", (0, 0))
    (tmp_path / "m" / ".DS_Store").write_text("x")
    assert path_sha256(tmp_path / "m") == before
    (tmp_path / "m" / "a").rename(tmp_path / "m" / "c")
    assert path_sha256(tmp_path / "m") != before


def test_entries_that_cannot_be_read_count_as_absent(tmp_path: Path) -> None:
    path = staleness.entry_path(tmp_path, "clean")
    assert staleness.read_entry(tmp_path, "clean") is None
    path.parent.mkdir()
    for text in ("", "{", "[]", "null", '{"key": "k"}'):
        path.write_text(text)
        assert staleness.read_entry(tmp_path, "clean") is None


FIGURES = {"seconds": 1.0, "peak_memory_mb": 100.0}


def test_damage_is_named(tmp_path: Path) -> None:
    for name in ("whole", "empty", "other"):
        (tmp_path / name).write_text("content")
    entry = {
        "outputs": {
            name: {"path": name, "sha256": file_sha256(tmp_path / "whole")}
            for name in ("whole", "empty", "other", "gone")
        }
    }
    (tmp_path / "empty").write_text("")
    (tmp_path / "other").write_text("contenT")
    assert staleness.damaged(tmp_path, entry) == ["empty is empty", "other was changed", "gone is missing"]


def test_a_twin_is_the_newest_intact_run_and_broken_ones_are_passed_over(tmp_path: Path) -> None:
    def sibling(name: str, key: object, outputs: object, age: float) -> Path:
        path = staleness.entry_path(tmp_path / name, "bake")
        path.parent.mkdir(parents=True)
        path.write_text(json.dumps({"key": key, "outputs": outputs, "inputs": {}, "metrics": {}, **FIGURES}))
        os.utime(path, (1e9 - age, 1e9 - age))
        (tmp_path / name / "a.png").write_bytes(b"picture")
        return tmp_path / name

    whole = {"a": {"path": "a.png", "sha256": file_sha256(sibling("own", "k", {}, 0) / "a.png")}}
    older = sibling("older", "k", whole, 20)
    newer = sibling("newer", "k", whole, 10)
    sibling("another-key", "other", whole, 1)
    sibling("changed", "k", {"a": {**whole["a"], "sha256": "0"}}, 1)
    for row, outputs in enumerate([["a"], 3, {"a": {}}, {"a": {"path": 7}}, {"a": {"path": "x" * 300}}]):
        sibling(f"broken{row}", "k", outputs, 1)
    (tmp_path / "latest").symlink_to(tmp_path / "own")
    assert staleness.twin(tmp_path / "own", "bake", "k") == newer
    (newer / "a.png").write_bytes(b"")
    assert staleness.twin(tmp_path / "own", "bake", "k") == older
    assert staleness.twin(older, "bake", "none") is None
