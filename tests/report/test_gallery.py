"""The gallery finds what is finished, and lets no name or prompt out of its place."""

import json
import os
from pathlib import Path

from pipeline.__main__ import main
from pipeline.report.gallery import find_runs, render
from tests.report.test_page import Reader

PROMPT = 'a "red" <script>alert(1)</script> & chair'


def write_run(out: Path, name: str, prompt: str, finished: float) -> Path:
    """Write what a gallery looks for in a run."""
    folder = out / name
    folder.mkdir(parents=True)
    for file in ("report.html", "asset.glb", "preview.png"):
        (folder / file).write_text("x")
    job = {"prompt": prompt, "quality": "draft", "seed": 7, "mesh": "/data/fish.obj", "sketch": ""}
    (folder / "manifest.json").write_text(json.dumps({"job": job, "seconds": 65.2}))
    os.utime(folder / "manifest.json", (finished, finished))
    return folder


def test_finished_runs_are_found_newest_first(tmp_path: Path) -> None:
    write_run(tmp_path, "older-1", "a mug", 1000)
    write_run(tmp_path, "newer-2", PROMPT, 2000)
    (write_run(tmp_path, "half-3", "half", 3000) / "asset.glb").unlink()
    (write_run(tmp_path, "broken-4", "broken", 3000) / "manifest.json").write_text('{"job": 3}')
    (tmp_path / "latest").symlink_to("newer-2")
    assert [card.name for card in find_runs(tmp_path)] == ["newer-2", "older-1"]


def test_text_and_names_arrive_as_text(tmp_path: Path) -> None:
    write_run(tmp_path, "it's a #1? <b>", PROMPT, 1000)
    reader = Reader()

    reader.feed(render(find_runs(tmp_path)))
    assert PROMPT in reader.text
    assert "draft · seed 7 · mesh fish.obj · 65 s" in reader.text
    links = [attrs["href"] for tag, attrs in reader.tags if tag == "a"]
    place = "it%27s%20a%20%231%3F%20%3Cb%3E"
    assert links == [f"{place}/report.html", f"{place}/report.html", f"{place}/asset.glb"]
    assert len(reader.scripts) == 1


def test_make_gallery_writes_the_page(tmp_path: Path) -> None:
    assert main(["gallery"], {"OUT": str(tmp_path)}) == 2
    write_run(tmp_path, "one-1", "a mug", 1000)
    assert main(["gallery"], {"OUT": str(tmp_path)}) == 0
    assert "a mug" in (tmp_path / "gallery.html").read_text()
