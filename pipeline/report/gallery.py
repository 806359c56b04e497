"""One page of all runs in a folder: their pictures, what was asked for, and each asset in the viewer.

The page holds links alone: pictures are those of the runs, and the viewer is the run's own report in a frame.
"""

import html
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from pipeline.documents import parse_object
from pipeline.progress import duration
from pipeline.report.page import STYLE
from pipeline.report.viewer import inline, policy

NAME = "gallery.html"
EXTRA = """
.gallery { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 13rem), 1fr));
           gap: 1.25rem;
           list-style: none; padding: 0; margin: 1.5rem 0; }
.gallery h2 { font-size: 1rem; margin: .4rem 0 0; overflow-wrap: anywhere; }
.gallery p { margin: 0; font-size: .9rem; overflow-wrap: anywhere; }
.tile { display: block; aspect-ratio: 1; overflow: hidden; border-radius: 6px; background: var(--plate);
       padding: 0;
        border: 0; width: 100%; }
.tile img { width: 400%; max-width: none; margin: 0; border-radius: 0; }
input { font: inherit; padding: .4rem .6rem; border: 1px solid #8888; border-radius: 6px;
        width: min(100%, 20rem);
        min-height: 2.5rem; box-sizing: border-box; background: var(--back); color: inherit; }
dialog { width: min(64rem, 94vw); height: min(46rem, 90vh); border: 1px solid var(--line);
         border-radius: 10px;
         padding: 1rem; background: var(--back); color: inherit; box-sizing: border-box; }
dialog[open] { display: flex; flex-direction: column; } dialog iframe { flex: 1; border: 0; width: 100%; }
dialog .viewer-bar { margin: 0 0 .5rem; justify-content: space-between; }
dialog h2 { margin: 0; overflow-wrap: anywhere; }
"""
SCRIPT = """
(function () {
  "use strict";
  var dialog = document.querySelector("dialog"), frame = dialog.querySelector("iframe");
  document.addEventListener("click", function (event) {
    var tile = event.target.closest("a.tile");
    if (!tile || event.ctrlKey || event.metaKey || event.shiftKey) return;
    event.preventDefault();
    dialog.querySelector("h2").textContent = tile.dataset.prompt;
    frame.src = tile.getAttribute("href") + "#viewer";
    frame.title = "the asset in 3D: " + tile.dataset.prompt;
    dialog.showModal();
  });
  dialog.querySelector("button").addEventListener("click", function () { dialog.close(); });
  dialog.addEventListener("close", function () { frame.src = "about:blank"; });
  var search = document.getElementById("search"), count = document.getElementById("count");
  search.addEventListener("input", function () {
    var shown = 0;
    document.querySelectorAll(".gallery > li").forEach(function (card) {
      card.hidden = card.textContent.toLowerCase().indexOf(search.value.toLowerCase()) < 0;
      shown += !card.hidden;
    });
    count.textContent = shown + (shown === 1 ? " run" : " runs");
  });
})();
"""


@dataclass(frozen=True)
class Card:
    """A finished run, as a gallery shows it."""

    name: str
    """Of its folder."""
    job: dict[str, Any]
    """Prompt, model, seed and the like, as its manifest has them."""
    seconds: float
    """Of all stages."""
    finished: float
    """When [seconds of the clock]."""


def find_runs(out: Path) -> list[Card]:
    """Return the finished runs in a folder, the newest first; what cannot be read is passed over."""
    cards = []
    for path in out.glob("*/manifest.json"):
        folder = path.parent
        if (
            folder.is_symlink()
            or not (folder / "report.html").is_file()
            or not (folder / "asset.glb").is_file()
        ):
            continue
        try:
            manifest = parse_object(path.read_bytes())
            job = {str(name): value for name, value in manifest["job"].items()}
            cards.append(Card(folder.name, job, float(manifest["seconds"]), os.path.getmtime(path)))
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            continue
    return sorted(cards, key=lambda card: (-card.finished, card.name))


def render(cards: Sequence[Card], title: str = "Gallery", base: str = "") -> str:
    """Return the page as HTML; `base` leads from it to the folder of the runs. Every text in it is
    escaped.
    """
    count = f"{len(cards)} run" + ("" if len(cards) == 1 else "s")
    tiles = "\n".join(_card(card, base) for card in cards)
    rules = (
        policy([SCRIPT]).replace("img-src data: blob:", "img-src 'self' file:") + "; frame-src 'self' file:"
    )
    empty = "" if cards else "<p>Nothing is finished here yet.</p>"
    return (
        f'<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{html.escape(rules, quote=True)}">'
        f"<title>{html.escape(title)}</title>"
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{STYLE}{EXTRA}</style></head>\n<body>\n"
        f"<header><h1>{html.escape(title)}</h1></header>\n<main>\n"
        f'<p><label for="search">Find </label><input id="search" type="search" autocomplete="off"> '
        f'<span class="dim" id="count" role="status">{count}</span></p>\n{empty}'
        f'<ul class="gallery">\n{tiles}\n</ul>\n</main>\n'
        '<dialog aria-labelledby="shown"><div class="viewer-bar"><h2 id="shown"></h2>'
        '<button type="button">Close</button></div><iframe title="the asset in 3D"></iframe></dialog>\n'
        f"{inline(SCRIPT)}\n</body>\n</html>\n"
    )


def _card(card: Card, base: str) -> str:
    place, prompt = base + quote(card.name), html.escape(str(card.job.get("prompt", "")), quote=True)
    facts = [f"{name} {card.job[name]}" for name in ("quality", "seed") if name in card.job]
    for name in ("sketch", "mesh"):
        if file := Path(str(card.job.get(name) or "")):
            # What the page took is known by its checksum.
            facts += [f"{name} {'of a visitor' if len(file.stem) == 64 else file.name}"] if file.name else []
    told = html.escape(" · ".join([*facts, duration(card.seconds)]))
    return (
        f'<li><a class="tile" href="{place}/report.html" data-prompt="{prompt}">'
        f'<img loading="lazy" alt="{prompt}" src="{place}/preview.png"></a>'
        f'<h2>{prompt}</h2><p class="dim">{told}</p>'
        f'<p><a href="{place}/report.html">report</a> · '
        f'<a href="{place}/asset.glb" download>asset.glb</a></p></li>'
    )
