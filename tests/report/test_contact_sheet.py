"""The sheet has a place a run, and the table a line."""

import csv
import io
import json
from pathlib import Path

import numpy as np
from PIL import Image, ImageFont

from pipeline.report.contact_sheet import GAP, TEXT, TILE, _caption, _wrapped, sheet, table, write_overview


def write_run(out: Path, name: str, colour: tuple[int, int, int]) -> Path:
    folder = out / name
    folder.mkdir()
    preview = np.zeros((96, 128, 3), np.uint8)
    preview[:32, :32] = colour
    Image.fromarray(preview).save(folder / "preview.png")
    for file in ("report.html", "asset.glb"):
        (folder / file).write_text("x")
    stages = [{"metrics": {"faces": 77, "warnings": ["a", "b"]}}, {"metrics": {"faces": 55}}]
    manifest = {"job": {"prompt": name}, "seconds": 12.5, "peak_memory_mb": 600.0, "stages": stages}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def test_every_picture_is_in_its_place() -> None:
    pictures = [Image.new("RGB", (8, 8), colour) for colour in ("red", "green", "blue")]
    page = sheet(
        [*pictures, None] * 3,
        [f"seed {n} and a caption that is much too long for its place" for n in range(12)],
    )
    assert page.size == (8 * (TILE + GAP) + GAP, 2 * (TILE + TEXT + GAP) + GAP)
    middle = [page.getpixel((GAP + n * (TILE + GAP) + TILE // 2, GAP + 20)) for n in range(4)]
    assert middle == [(255, 0, 0), (0, 128, 0), (0, 0, 255), (255, 255, 255)]


def test_captions_are_drawn_in_glyphs_that_the_font_has() -> None:
    font = ImageFont.load_default(13)
    lacking = bytes(font.getmask("\ue000"))
    lines = _wrapped(_caption({"prompt": "a chair " * 20, "seed": 3, "clean.faces": 5000}), font)
    assert len(lines) == 2
    short = _wrapped(_caption({"prompt": "a chair", "seed": 3}), font)
    assert short == ["a chair, seed 3"]
    assert all(bytes(font.getmask(letter)) != lacking for line in lines + short for letter in line)


def test_an_overview_shows_what_was_made_and_says_what_was_not(tmp_path: Path) -> None:
    red, blue = (
        write_run(tmp_path, name, colour) for name, colour in (("red", (255, 0, 0)), ("blue", (0, 0, 255)))
    )
    rows = [
        (red, {"prompt": "=red()", "clean.faces": 55}, ""),
        (blue, {"prompt": "blue", "clean.faces": 66}, "a stage failed, twice"),
    ]
    picture, listed, page = write_overview(tmp_path / "sweeps" / "it-1", "it", rows)
    with Image.open(picture) as image:
        assert image.getpixel((GAP + TILE // 2, GAP + TILE // 2)) == (255, 0, 0)
        assert image.getpixel((2 * GAP + TILE + 10, GAP + 10)) == (255, 255, 255)
    first, second = csv.DictReader(io.StringIO(listed.read_text()))
    assert first == {
        "run": "red", "prompt": "'=red()", "clean.faces": "55", "seconds": "12.5", "peak_memory_mb": "600.0",
        "faces": "55", "warnings": "2", "failed": "",
    }  # fmt: skip
    assert (second["run"], second["seconds"], second["failed"]) == ("blue", "", "a stage failed, twice")
    text = page.read_text()
    assert 'href="../../red/report.html"' in text
    assert "blue/report.html" not in text


def test_a_table_of_nothing_is_a_head() -> None:
    assert table([]) == "run,seconds,peak_memory_mb,faces,warnings,failed\n"
