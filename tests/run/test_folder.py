"""The folder of a run as a place: what is dated back in it."""

import os
import time
from pathlib import Path

from pipeline.run.folder import date_back


def test_what_is_from_the_future_is_dated_to_now_and_nothing_else(tmp_path: Path) -> None:
    stranger = tmp_path / "stranger"
    stranger.write_text("theirs")
    run = tmp_path / "run"
    (run / "stages").mkdir(parents=True)
    for name in ("mesh.ply", "stages/bake.json", "old.ply"):
        (run / name).write_text("ours")
    (run / "link").symlink_to(stranger)
    for path in (run / "mesh.ply", run / "stages" / "bake.json", stranger):
        os.utime(path, (4e9, 4e9))
    os.utime(run / "old.ply", (1e9, 1e9))
    before = time.time()
    date_back(run)
    for path in (run / "mesh.ply", run / "stages" / "bake.json"):
        assert before - 1 <= path.stat().st_mtime <= time.time()
    assert (run / "old.ply").stat().st_mtime == 1e9
    assert stranger.stat().st_mtime == 4e9


def test_a_run_that_is_not_there_yet(tmp_path: Path) -> None:
    date_back(tmp_path / "none")
