"""The page stands alone and escapes everything."""

import base64
import dataclasses
import re
from html.parser import HTMLParser

from pipeline.report.page import START, STYLE, Page, render
from pipeline.report.viewer import scripts, viewer_js

ENTRY = {
    "stage": "clean",
    "seconds": 2.5,
    "peak_memory_mb": 321.0,
    "versions": {"numpy": "2.4.6"},
    "metrics": {"faces": 1234, "iou": 0.912345678, "warnings": ["a <b> & 'c'"]},
}
PAGE = Page(
    prompt='a "red" <script>alert(1)</script> & chair',
    negative="<i>blue</i>",
    facts={"model": "everyday-objects", "seed": "7"},
    entries=[ENTRY, {**ENTRY, "stage": "bake", "seconds": 3.5, "metrics": {}, "reused_from": "other-run"}],
    preview_png=b"png bytes",
    turntable_mp4=b"mp4 bytes",
    asset_glb=b"glb bytes",
    links=[("asset.glb", "the asset", 2_345_678), ("asset.mtl", "its material", 99)],
    job_yaml="prompt: <b>",
)


class Reader(HTMLParser):
    """Collects tags and text, and checks that tags are closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.stack: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.scripts: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in {"meta", "img", "input"}:
            self.stack.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.stack.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.stack and self.stack[-1] == "script":
            self.scripts.append(data)
        else:
            self.text += data


def read(page: Page) -> Reader:
    reader = Reader()
    reader.feed(render(page))
    assert reader.stack == []
    return reader


def test_text_arrives_as_text() -> None:
    reader = read(PAGE)
    assert {"i", "b"} & {tag for tag, _ in reader.tags} <= {"b"}
    assert [base64.b64decode(reader.scripts[0]), *reader.scripts[1:]] == [b"glb bytes", *scripts(), START]
    for text in (PAGE.prompt, PAGE.negative, "a <b> & 'c'", "prompt: <b>"):
        assert text in reader.text


def test_pictures_are_inside_and_nothing_is_fetched() -> None:
    reader = read(PAGE)
    sources = [attrs["src"] or "" for _, attrs in reader.tags if "src" in attrs]
    assert [base64.b64decode(source.split(",")[1]) for source in sources] == [b"png bytes", b"mp4 bytes"]
    page = render(PAGE)
    for script in scripts():  # three.js has names of namespaces in it
        page = page.replace(script, "")
    assert not re.search(r"https?://|@import|url\(", page)
    (rules,) = [attrs["content"] or "" for _, attrs in reader.tags if "http-equiv" in attrs]
    assert rules.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-inline" not in rules.partition("style-src")[0]
    assert [attrs["href"] for tag, attrs in reader.tags if tag == "a"] == ["asset.glb", "asset.mtl"]


def test_figures_are_there() -> None:
    text = read(PAGE).text
    for figure in (
        "2.5",
        "321",
        "6.0",
        "1234",
        "0.912346",
        "numpy 2.4.6",
        "2.3 MB",
        "0.1 kB",
        "other-run",
        "seed 7",
    ):
        assert figure in text


def luminance(colour: str) -> float:
    """Return the relative luminance of #rrggbb or #rgb, as WCAG 2 defines it."""
    digits = colour.lstrip("#")
    parts = [
        int(d * 2 if len(digits) == 3 else digits[2 * i : 2 * i + 2], 16) for i, d in enumerate(digits[:3])
    ]
    linear = [v / 255 / 12.92 if v <= 10 else ((v / 255 + 0.055) / 1.055) ** 2.4 for v in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_colours_have_the_contrast_of_aa() -> None:
    light, dark = (
        dict(re.findall(r"--(\w+): (#\w+)", block)) for block in re.findall(r"(?s):root \{(.*?)\}", STYLE)
    )
    for names in (light, {**light, **dark}):
        back = luminance(names["back"])
        for name in ("dim", "link"):
            high, low = sorted([back, luminance(names[name])], reverse=True)
            assert (high + 0.05) / (low + 0.05) >= 4.5, name


def test_nothing_moves_by_itself_where_motion_is_reduced() -> None:
    assert all("autoplay" not in attrs for _, attrs in read(PAGE).tags)
    assert START.count("prefers-reduced-motion") == 1
    assert viewer_js().count("prefers-reduced-motion") == 1
    (label,) = [attrs["aria-label"] for tag, attrs in read(PAGE).tags if tag == "video"]
    assert label


def test_it_says_where_the_time_went_and_what_was_skipped() -> None:
    seconds = {"render": 1.0, "denoiser": 6.0, "backward": 2.0, "rest": 1.0}
    metrics = {"seconds": seconds, "skipped_samples": {"in <empty> cells": 0.625}}
    reader = read(dataclasses.replace(PAGE, entries=[{**ENTRY, "stage": "train_nerf", "metrics": metrics}]))
    assert "train_nerf, time in steps: render 10 %, denoiser 60 %, backward 20 %, rest 10 %" in reader.text
    assert "train_nerf: samples of its rays: 62.5 % in <empty> cells" in reader.text
    bars = [attrs["style"] for tag, attrs in reader.tags if tag == "span"]
    assert bars == ["width:10.00%", "width:60.00%", "width:20.00%", "width:10.00%"]
