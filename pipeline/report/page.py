"""The page of a run: one HTML file that shows everything by itself, the asset too; its links open the run's
files."""

import base64
import html
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.report.unneeded import unneeded
from pipeline.report.viewer import inline, policy, scripts
from pipeline.run.start_files import spent

STYLE = """
:root { color-scheme: light dark; --line: #8884; --dim: #5c5c5c; --link: #0b57b0; --back: #fff;
        --plate: #8881; }
@media (prefers-color-scheme: dark) { :root { --dim: #a8a8a8; --link: #8ab8f5; --back: #161616; } }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem;
       background: var(--back); }
h1 { font-size: 1.6rem; margin: 0; overflow-wrap: anywhere; white-space: pre-wrap; }
h2 { font-size: 1.1rem; margin: 2.5rem 0 .5rem; }
a { color: var(--link); }
.dim { color: var(--dim); overflow-wrap: anywhere; }
img, video { max-width: 100%; border-radius: 6px; background: var(--plate); display: block;
             margin: 1rem auto; }
video { width: min(100%, 32rem); }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; }
td, th { border-bottom: 1px solid var(--line); padding: .25rem .6rem .25rem 0; text-align: left;
         vertical-align: top; font-variant-numeric: tabular-nums; overflow-wrap: break-word; }
th { font-weight: 600; } td.n, th.n { text-align: right; } td:first-child { white-space: nowrap; }
.warning { border-left: 4px solid #d80; padding: .3rem .8rem; margin: .5rem 0; background: #d801; }
.bar { display: flex; height: .7rem; border-radius: 6px; overflow: hidden; }
.bar span:nth-child(4n+1) { background: #38a; } .bar span:nth-child(4n+2) { background: #a53; }
.bar span:nth-child(4n+3) { background: #7a4; } .bar span:nth-child(4n) { background: #888; }
summary { cursor: pointer; } pre { overflow-x: auto; font-size: .85rem; }
.viewer { margin: 1rem 0; }
.stage { height: min(70vh, 30rem); border-radius: 6px; background: var(--plate); touch-action: pan-y;
       cursor: grab;
         overflow: hidden; }
.stage:active { cursor: grabbing; } .stage canvas { display: block; }
:focus-visible { outline: 3px solid var(--link); outline-offset: 2px; }
.viewer-bar { display: flex; flex-wrap: wrap; gap: .5rem; align-items: center; margin-top: .5rem; }
button { font: inherit; padding: .3rem .8rem; border: 1px solid #8888; border-radius: 6px;
         background: var(--plate);
         color: inherit; cursor: pointer; min-height: 2.5rem; }
button[aria-pressed=true] { border-color: var(--link); box-shadow: inset 0 0 0 1px var(--link); }
.alone header, .alone .rest { display: none; } .alone { margin: 0 auto; max-width: none; padding: .5rem; }
.alone .stage { height: calc(100vh - 5rem); }
"""
START = """
(function () {
  "use strict";
  // A gallery shows the viewer alone, in a frame of its own.
  document.body.classList.toggle("alone", location.hash === "#viewer");
  var text = atob(document.getElementById("glb").textContent.trim());
  var bytes = new Uint8Array(text.length);
  for (var i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  var shown = showAsset(document.getElementById("viewer"), bytes.buffer);
  if (!shown) document.body.classList.remove("alone");
  var video = document.querySelector("video"), still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (!still && !document.body.classList.contains("alone")) video.play().catch(function () {});
})();
"""


@dataclass(frozen=True)
class Page:
    """What the page shows; `entries` are the stages' entries in the order of the chain."""

    prompt: str
    negative: str
    facts: dict[str, str]
    """Model, seed, quality: short values by name."""
    entries: list[dict[str, Any]]
    preview_png: bytes
    turntable_mp4: bytes
    asset_glb: bytes
    links: list[tuple[str, str, int | None]]
    """Files of the run: path relative to the page, what it is, bytes (None: not written yet)."""
    job_yaml: str
    contest_png: bytes | None = None
    """A row of views for each seed; None: there was one."""


def render(page: Page) -> str:
    """Return the page as HTML. Every text in it is escaped: a prompt may hold anything."""
    title = html.escape(page.prompt)
    negative = f"<p class=dim>not: {html.escape(page.negative)}</p>" if page.negative else ""
    facts = " · ".join(f"{html.escape(name)} {html.escape(value)}" for name, value in page.facts.items())
    warnings = [warning for entry in page.entries for warning in entry["metrics"].get("warnings", ())]
    told = [f"<p class=warning>{html.escape(str(warning))}</p>" for warning in warnings]
    rest = [
        f'<img alt="eight views and four normal maps" src="{_inline("image/png", page.preview_png)}">',
        f'<video controls loop muted playsinline aria-label="the asset turning once" '
        f'src="{_inline("video/mp4", page.turntable_mp4)}"></video>',
        "<h2>Files</h2>",
        _table(
            ("file", "what it is", "size"),
            [(_link(path), html.escape(what), _size(size)) for path, what, size in page.links],
            numeric=frozenset({2}),
        ),
        "<h2>Stages</h2>",
        _stages(page.entries),
        *(_shares(entry) for entry in page.entries),
        *_contest(page),
        *_before(page),
        "<h2>Left out, since this scene does not need it</h2>",
        f"<ul>{''.join(f'<li>{html.escape(line)}</li>' for line in unneeded(page.entries))}</ul>",
        "<h2>Metrics</h2>",
        *(_figures(entry) for entry in page.entries if set(entry["metrics"]) - {"warnings"}),
        "<h2>Job</h2>",
        f"<details><summary>every option</summary><pre>{html.escape(page.job_yaml)}</pre></details>",
        "<h2>Versions</h2>",
        f"<p>{html.escape(_versions(page.entries))}</p>",
    ]
    parts = [
        f"<header><h1>{title}</h1>{negative}<p class=dim>{facts}</p>{''.join(told)}</header>",
        "<main>",
        '<section class=viewer id=viewer aria-label="the asset in 3D"></section>',
        "<div class=rest>",
        *rest,
        "</div>",
        "</main>",
    ]
    body = "\n".join(parts)
    code = [*scripts(), START]
    asset = base64.b64encode(page.asset_glb).decode("ascii")
    return (
        f'<!doctype html>\n<html lang="en">\n<head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{html.escape(policy(code), quote=True)}">'
        f"<title>{title}</title>"
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{STYLE}</style></head>\n'
        f"<body>\n{body}\n"
        f'<script type="application/base64" id="glb">{asset}</script>\n'
        f"{''.join(map(inline, code))}\n</body>\n</html>\n"
    )


def _stages(entries: list[dict[str, Any]]) -> str:
    rows = [
        (
            html.escape(entry["stage"]),
            f"{entry['seconds']:.1f}",
            f"{entry['peak_memory_mb']:.0f}",
            html.escape(entry.get("reused_from", "")),
        )
        for entry in entries
    ]
    total = sum(entry["seconds"] for entry in entries)
    peak = max((entry["peak_memory_mb"] for entry in entries), default=0)
    rows.append(("<b>together</b>", f"<b>{total:.1f}</b>", f"<b>{peak:.0f}</b>", ""))
    return _table(("stage", "seconds", "peak MB", "taken from"), rows, numeric=frozenset({1, 2}))


def _contest(page: Page) -> list[str]:
    """Return the sheet of the seeds that began, and how well each agreed with the text."""
    entry = next((entry for entry in page.entries if entry["stage"] == "contest"), None)
    if entry is None or page.contest_png is None:
        return []
    metrics = entry["metrics"]
    rows = [
        (
            seed,
            f"{row['score']:.4f}",
            f"{row['loss_told']:.4f}",
            f"{row['loss_untold']:.4f}",
            "goes on" if seed == str(metrics["chosen_seed"]) else "",
        )
        for seed, row in metrics["scores"].items()
    ]
    heads = ("seed", "score", "loss with the text", "loss without", "")
    return [
        "<h2>Seeds</h2>",
        f'<img alt="a row of views for each seed" src="{_inline("image/png", page.contest_png)}">',
        _table(heads, rows, numeric=frozenset({1, 2, 3})),
    ]


def _before(page: Page) -> list[str]:
    """Return what was spent on each run that this one started from, and on this one."""
    earlier = [row for entry in page.entries for row in entry["metrics"].get("before", ())]
    if not earlier:
        return []
    rows = [*earlier, spent("this run", page.facts["model"], page.entries)]
    heads = ("run", "model", "calls of its denoiser", "seconds of training", "seconds in all")
    cells = [tuple(html.escape(str(value)) for value in row.values()) for row in rows]
    return ["<h2>What each model spent</h2>", _table(heads, cells, numeric=frozenset({2, 3, 4}))]


def _shares(entry: dict[str, Any]) -> str:
    """Say where a stage's time went, as a bar."""
    name, metrics = html.escape(entry["stage"]), entry["metrics"]
    parts = []
    if sum(metrics.get("seconds", {}).values()):
        total = sum(metrics["seconds"].values())
        shares = [(html.escape(part), 100 * value / total) for part, value in metrics["seconds"].items()]
        bar = "".join(f'<span style="width:{share:.2f}%" title="{part}"></span>' for part, share in shares)
        told = ", ".join(f"{part} {share:.0f} %" for part, share in shares)
        parts.append(f"<p>{name}, time in steps: {told}</p><div class=bar>{bar}</div>")
    return "".join(parts)


def _figures(entry: dict[str, Any]) -> str:
    rows = [
        (html.escape(name.replace("_", " ")), html.escape(_value(value)))
        for name, value in entry["metrics"].items()
        if name not in ("warnings", "before", "scores")
    ]
    table = _table(("figure", "value"), rows)
    return f"<details><summary>{html.escape(entry['stage'])}</summary>{table}</details>"


def _table(
    heads: tuple[str, ...], rows: Sequence[tuple[str, ...]], numeric: frozenset[int] = frozenset()
) -> str:
    def line(tag: str, cells: tuple[str, ...]) -> str:
        marks = (" class=n" if column in numeric else "" for column in range(len(cells)))
        return (
            "<tr>"
            + "".join(f"<{tag}{mark}>{cell}</{tag}>" for mark, cell in zip(marks, cells, strict=True))
            + "</tr>"
        )

    lines = line("th", heads) + "".join(line("td", row) for row in rows)
    return f"<div class=scroll><table>{lines}</table></div>"


def _versions(entries: list[dict[str, Any]]) -> str:
    versions = {name: version for entry in entries for name, version in entry["versions"].items()}
    return ", ".join(f"{name} {version}" for name, version in sorted(versions.items()))


def _value(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _size(size: int | None) -> str:
    if size is None:
        return ""
    return f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{size / 1e3:.1f} kB"


def _link(path: str) -> str:
    return f'<a href="{html.escape(path, quote=True)}">{html.escape(path)}</a>'


def _inline(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
