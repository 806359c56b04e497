"""What a stranger, or a disk, left where a run keeps its files: said in one line, and nothing of it lost."""

import json
import os
import re
import shutil
import socket
from pathlib import Path

import pytest

from tests.faults.door import Door

PRECIOUS = "the only copy of a thesis"


@pytest.fixture(scope="module")
def run(door: Door) -> Path:
    """Return the folder of the run that `door` asks for, made once."""
    answer = door.ask("run")
    assert answer.status == 0, answer.stderr
    return door.folder / Path(answer.stdout.splitlines()[-1]).parent


@pytest.fixture
def place(door: Door, run: Path, tmp_path: Path) -> tuple[Door, Path]:
    """A door of its own, whose run is finished; paths are short, for a socket's address has to hold one."""
    copy = Door.__new__(Door)
    copy.folder, copy.given, copy.out = tmp_path, tmp_path / "given", tmp_path / "out"
    copy.given.mkdir()
    shutil.copytree(door.folder / "model", tmp_path / "model")
    shutil.copy(door.folder / "job.yaml", tmp_path / "job.yaml")
    shutil.copytree(run, copy.out / run.name)
    (copy.given / "thesis.txt").write_text(PRECIOUS)
    return copy, copy.out / run.name


def test_a_lock_that_is_a_link_is_not_followed(place: tuple[Door, Path]) -> None:
    door, run = place
    (run / ".lock").unlink()
    (run / ".lock").symlink_to(door.given / "thesis.txt")
    door.refused("run", ".lock is a link", "move it away")
    (run / ".lock").unlink()
    (run / ".lock").hardlink_to(door.given / "thesis.txt")
    door.refused("run", ".lock is a file", "expected the lock")


def test_a_lock_that_is_no_lock(place: tuple[Door, Path]) -> None:
    door, run = place
    (run / ".lock").unlink()
    (run / ".lock").mkdir()
    door.refused("run", ".lock is a folder")
    (run / ".lock").rmdir()
    os.mkfifo(run / ".lock")
    door.refused("run", ".lock is a pipe")
    (run / ".lock").unlink()
    (run / ".lock").write_text(PRECIOUS)
    door.refused("run", ".lock is a file")
    assert (run / ".lock").read_text() == PRECIOUS


def test_a_socket_that_is_none(place: tuple[Door, Path]) -> None:
    door, run = place
    (run / "asset.glb").unlink()  # a run that has nothing to do serves no stages
    (run / ".warm").symlink_to(door.given / "thesis.txt")
    door.refused("run", ".warm is a link")
    (run / ".warm").unlink()
    (run / ".warm").mkdir()
    door.refused("run", ".warm is a folder")
    (run / ".warm").rmdir()
    with socket.socket(socket.AF_UNIX) as left:  # by a run that was killed
        left.bind(str(run / ".warm"))
        assert door.ask("run").status == 0


@pytest.mark.parametrize("target", ["plan", "run"])
@pytest.mark.parametrize(("name", "words"), [
    ("logs", "logs is a file, expected a folder"),
    ("stages", "stages is a file, expected a folder"),
    ("checkpoints", "checkpoints is a file, expected a folder"),
    ("asset.glb", "asset.glb is a folder, expected a file"),
    ("job.yaml", "job.yaml is a folder, expected a file"),
])  # fmt: skip
def test_something_else_stands_there(place: tuple[Door, Path], name: str, words: str, target: str) -> None:
    door, run = place
    others = {path: path.read_bytes() for path in run.iterdir() if path.is_file() and path.name != name}
    path = run / name
    if path.is_dir() or not path.exists():
        shutil.rmtree(path, ignore_errors=True)
        path.write_text(PRECIOUS)
    else:
        path.unlink()
        path.mkdir()
        (path / "thesis.txt").write_text(PRECIOUS)
    door.refused(target, words, "move it away")
    mine = path if path.is_file() else path / "thesis.txt"
    assert mine.read_text() == PRECIOUS
    assert all(path.read_bytes() == data for path, data in others.items() if path.name != ".lock")


@pytest.mark.parametrize("name", ["logs", "stages", "checkpoints"])
def test_folders_are_no_links(place: tuple[Door, Path], name: str) -> None:
    door, run = place
    shutil.rmtree(run / name, ignore_errors=True)
    (run / name).symlink_to(door.given)
    door.refused("run", f"{name} is a link")


def test_logs_and_outputs_that_are_links_are_replaced_not_followed(place: tuple[Door, Path]) -> None:
    door, run = place
    for name in ("logs/publish.log", "logs/snakemake.log", "asset.glb", "job.yaml"):
        (run / name).unlink(missing_ok=True)
        (run / name).symlink_to(door.given / "thesis.txt")
    answer = door.ask("run")
    assert answer.status == 0, answer.stderr
    assert (door.given / "thesis.txt").read_text() == PRECIOUS
    assert not (run / "asset.glb").is_symlink()


@pytest.mark.parametrize("kind", ["a file", "a link", "a loop", "proc"])
@pytest.mark.parametrize("target", ["plan", "run"])
def test_an_out_that_cannot_be(door: Door, kind: str, target: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    if kind == "a file":
        out.write_text(PRECIOUS)
    elif kind != "proc":
        out.symlink_to(out if kind == "a loop" else tmp_path / "nowhere")
    door.refused(target, "OUT=", OUT="/proc/here" if kind == "proc" else str(out))
    assert not (tmp_path / "nowhere").exists()


def test_a_run_whose_name_is_taken(place: tuple[Door, Path]) -> None:
    door, run = place
    shutil.rmtree(run)
    run.write_text(PRECIOUS)
    door.refused("run", f"{run.name} is a file", "OUT=")
    assert run.read_text() == PRECIOUS
    run.unlink()
    (door.folder / "mine").mkdir()
    run.symlink_to(door.folder / "mine")
    door.refused("run", f"{run.name} is a link", "OUT=")
    assert not list((door.folder / "mine").iterdir()), "not even a lock"


@pytest.mark.parametrize("text", [
    "[" * 200_000, "null", "{", '{"key": 3}', '{"key": "k", "outputs": [], "inputs": {}}', "\udcff",
    '{"key": "k", "outputs": {"a": 3}, "inputs": {}, "metrics": {}, "seconds": 1, "peak_memory_mb": 1}',
    '{"key": "k", "outputs": {"a": {"path": "../../given/thesis.txt", "sha256": ""}}, "inputs": {},'
    ' "metrics": {}, "seconds": 1, "peak_memory_mb": 1}',
], ids=["deep", "null", "cut", "number", "list", "bytes", "entry", "outside"])  # fmt: skip
def test_damaged_entries_count_for_nothing_and_break_no_run(place: tuple[Door, Path], text: str) -> None:
    door, run = place
    entry = run / "stages" / "publish.json"
    key = json.loads(entry.read_text())["key"]
    entry.write_bytes(text.replace('"k"', f'"{key}"').encode("utf-8", "surrogateescape"))
    assert door.ask("plan", SEED="1").status == 0, "a sibling that is damaged is passed over"
    answer = door.ask("plan")
    assert re.search(r"^publish +run ", answer.stdout, re.MULTILINE), answer.stdout
    assert (door.given / "thesis.txt").read_text() == PRECIOUS


def test_damaged_entries_are_made_again(place: tuple[Door, Path]) -> None:
    door, run = place
    asset = (run / "asset.glb").read_bytes()
    for stage, text in (("clean", "null"), ("bake", "{"), ("publish", "[" * 200_000)):
        (run / "stages" / f"{stage}.json").write_text(text)
    answer = door.ask("run")
    assert answer.status == 0, answer.stderr
    assert (run / "asset.glb").read_bytes() == asset
    assert door.ask("verify", RUN=f"out/{run.name}").status == 0


@pytest.mark.parametrize(
    "text", ["[" * 200_000, "{}", '{"files": {"a": 1}}', '{"files": {"a\\nb": {"sha256": "0"}}}']
)
def test_damaged_manifests(door: Door, tmp_path: Path, text: str) -> None:
    (tmp_path / "manifest.json").write_text(text)
    door.refused("verify", str(tmp_path), RUN=str(tmp_path))


def test_latest_is_the_newest_run_that_succeeded(place: tuple[Door, Path]) -> None:
    door, run = place
    assert door.ask("run").status == 0
    (door.given / "apart.obj").write_text("v 0 0 0\nv 1e6 0 0\nv 0 1e-6 0\nf 1 2 3\n")
    door.refused("run", "lost in its extent", MESH="given/apart.obj")
    assert (door.out / "latest").resolve() == run.resolve()
    assert door.ask("verify", RUN="out/latest").status == 0


def test_no_home_and_no_cache(place: tuple[Door, Path]) -> None:
    door, run = place
    (run / "asset.glb").unlink()
    nowhere = dict.fromkeys(("HOME", "XDG_CACHE_HOME"), "/proc/nowhere")
    answer = door.ask("run", environment=nowhere)
    assert answer.status == 0, answer.stderr
