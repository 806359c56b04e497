"""What came of a sweep: a picture of all assets, a table, and a page with the viewer."""

import csv
import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pipeline.documents import parse_object
from pipeline.files import publish, write_text
from pipeline.report import gallery

TILE, TEXT, GAP = 192, 40, 8
"""Of the sheet: sides of a picture, height of its caption, space between [pixels]."""
COLUMNS = 8
MOST = 400
"""Pictures on the sheet; the page and the table have all."""
Row = tuple[Path, dict[str, Any], str]
"""Of a run: its folder, what it has of the varied options, why it failed (empty: it did not)."""


def write_overview(folder: Path, title: str, rows: Sequence[Row]) -> list[Path]:
    """Write sheet.png, table.csv and index.html into a folder of the runs' `sweeps/`; return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = [_picture(run) if not reason else None for run, _, reason in rows[:MOST]]
    captions = [_caption(values) for _, values, _ in rows[:MOST]]
    partial = folder / ".sheet.png"
    sheet(pictures, captions).save(partial, "PNG")
    publish([(partial, folder / "sheet.png")])
    write_text(folder / "table.csv", table(rows))
    cards = {card.name: card for run in {run.parent for run, _, _ in rows} for card in gallery.find_runs(run)}
    shown = [cards[run.name] for run, _, reason in rows if not reason and run.name in cards]
    write_text(folder / "index.html", gallery.render(shown, title, "../../"))
    return [folder / name for name in ("sheet.png", "table.csv", "index.html")]


def sheet(pictures: Sequence[Image.Image | None], captions: Sequence[str]) -> Image.Image:
    """Return the pictures in rows, captions below; None: an empty place for what was not made."""
    columns = max(1, min(COLUMNS, len(pictures)))
    lines = -(-len(pictures) // columns)
    size = columns * (TILE + GAP) + GAP, lines * (TILE + TEXT + GAP) + GAP
    page = Image.new("RGB", size, "white")
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(13)
    for place, (picture, caption) in enumerate(zip(pictures, captions, strict=True)):
        left, top = GAP + place % columns * (TILE + GAP), GAP + place // columns * (TILE + TEXT + GAP)
        if picture is None:
            draw.rectangle((left, top, left + TILE - 1, top + TILE - 1), outline="#bbbbbb")
            draw.text((left + TILE / 2, top + TILE / 2), "not made", "#555555", font, anchor="mm")
        else:
            page.paste(picture.resize((TILE, TILE), Image.Resampling.LANCZOS), (left, top))
        for number, line in enumerate(_wrapped(caption, font)):
            draw.text((left, top + TILE + 3 + 17 * number), line, "#222222", font)
    return page


def table(rows: Sequence[Row]) -> str:
    """Return a line a run as CSV: its folder, the varied options, seconds, memory, faces, why it failed."""
    stream = io.StringIO()
    names = list(rows[0][1]) if rows else []
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["run", *names, "seconds", "peak_memory_mb", "faces", "warnings", "failed"])
    for run, values, reason in rows:
        facts = _facts(run) if not reason else ["", "", "", ""]
        writer.writerow([run.name, *(_harmless(values[name]) for name in names), *facts, reason])
    return stream.getvalue()


def _harmless(value: Any) -> Any:
    """Return a value that spreadsheets take for text: they run what begins as a formula."""
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r") else value


def _facts(run: Path) -> list[Any]:
    """Return seconds, memory, faces and the number of warnings as the manifest has them; empty where it
    lacks.
    """
    try:
        manifest = parse_object((run / "manifest.json").read_bytes())
        metrics = [entry["metrics"] for entry in manifest["stages"]]
        faces = [one["faces"] for one in metrics if isinstance(one.get("faces"), int)]
        warnings = sum(len(one.get("warnings", ())) for one in metrics)
        return [manifest["seconds"], manifest["peak_memory_mb"], faces[-1] if faces else "", warnings]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return ["", "", "", ""]


def _picture(run: Path) -> Image.Image | None:
    """Return the front view: the first tile of preview.png, four in a row."""
    try:
        with Image.open(run / "preview.png", formats=["PNG"]) as preview:
            side = preview.width // 4
            return Image.fromarray(np.asarray(preview.convert("RGB").crop((0, 0, side, side))))
    except OSError:
        return None


def _caption(values: dict[str, Any]) -> str:
    """Return what tells a run from the others: a path by its last part, an option by its last name."""
    parts = []
    for name, value in values.items():
        short = name.rpartition(".")[2]
        path = os.path.basename(str(value)) if name in ("mesh", "sketch", "token") else value
        parts.append(str(value) if name == "prompt" else f"{short}\u00a0{path}")
    return ", ".join(parts)


def _wrapped(text: str, font: Any) -> list[str]:
    """Return at most two lines that fit below a picture."""
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}".strip()
        if font.getlength(longer) <= TILE:
            lines[-1] = longer
        else:
            lines.append(word)
    if len(lines) > 2:
        lines = [lines[0], lines[1] + " …"]
    kept = []
    for line in lines:
        while line and font.getlength(line) > TILE:
            line = line[:-2] + "…"
        kept.append(line.replace("\u00a0", " "))  # only keeps words together; the font has no glyph for it
    return kept
