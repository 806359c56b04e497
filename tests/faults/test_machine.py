"""What the machine refuses: memory, disk, a terminal that goes away."""

import os
import resource
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.faults.door import Door


def start(door: Door, limit: Callable[[], None], **variables: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        door.command("run", **variables),
        cwd=door.folder,
        env=door.environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        preexec_fn=limit,
    )


def errors_of(said: str) -> list[str]:
    assert "Traceback" not in said
    return [line for line in said.splitlines() if line.startswith("error: ")]


@pytest.mark.parametrize("megabytes", [350, 1000])
def test_a_limit_of_memory_is_named(door: Door, megabytes: int, tmp_path: Path) -> None:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))

    process = start(door, limit, OUT=str(tmp_path))
    _, said = process.communicate()
    if process.returncode == 0:
        pytest.skip("it was enough")
    (error,) = errors_of(said)
    assert "memory" in error
    assert f"ulimit -v allows {megabytes} MB" in error


@pytest.mark.parametrize(
    "kilobytes", [30, *(pytest.param(size, marks=pytest.mark.thorough) for size in (1, 300))]
)
def test_a_file_that_may_not_grow(door: Door, kilobytes: int, tmp_path: Path) -> None:
    """The limit on a file's size stands for a full disk, at whatever stage first meets it."""

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (kilobytes << 10, kilobytes << 10))

    process = start(door, limit, OUT=str(tmp_path))
    _, said = process.communicate()
    if process.returncode == 0:
        pytest.skip("it was enough")
    (error,) = errors_of(said)
    assert "exceed the allowed size" in error
    if kilobytes == 30:
        assert door.ask("run", OUT=str(tmp_path)).status == 0, "goes on once there is room"


@pytest.mark.parametrize("number", [pytest.param(signal.SIGTERM, marks=pytest.mark.thorough), signal.SIGHUP])
def test_a_terminal_that_goes_away(door: Door, number: signal.Signals, tmp_path: Path) -> None:
    def default() -> None:
        signal.signal(number, signal.SIG_DFL)

    process = start(door, default, OUT=str(tmp_path))
    deadline = time.monotonic() + 60
    while not (locks := list(tmp_path.glob("*/stages/embed.json"))):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    run = locks[0].parents[1]
    os.kill(int((run / ".lock").read_text()), number)
    _, said = process.communicate(timeout=60)
    assert process.returncode != 0
    assert "the same command goes on from here" in said
    answer = door.ask("run", OUT=str(tmp_path))
    assert answer.status == 0, answer.stderr
    assert door.ask("verify", RUN=str(run)).status == 0


def test_a_clock_that_was_set_back(door: Door, tmp_path: Path) -> None:
    assert door.ask("run", OUT=str(tmp_path)).status == 0
    (run,) = (path for path in tmp_path.iterdir() if not path.is_symlink())
    for path in (run / "mesh.ply", run / "stages" / "bake.json"):
        os.utime(path, (4e9, 4e9))
    assert "nothing to do" in door.ask("run", OUT=str(tmp_path)).stderr
    (run / "asset.glb").unlink()
    assert door.ask("run", OUT=str(tmp_path)).status == 0
    assert door.ask("verify", RUN=str(run)).status == 0


def test_a_folder_that_is_deleted_meanwhile(door: Door, tmp_path: Path) -> None:
    """Whatever happens is one line: nothing can be promised."""
    process = start(door, lambda: None, OUT=str(tmp_path / "out"))
    deadline = time.monotonic() + 60
    while not list((tmp_path / "out").glob("*/stages/embed.json")):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    shutil.rmtree(tmp_path / "out", ignore_errors=True)
    _, said = process.communicate(timeout=120)
    assert process.returncode != 0
    assert len(errors_of(said)) == 1
