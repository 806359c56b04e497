"""The viewer where a browser has no WebGL. With it: `tests/server/test_browser.py`."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from pipeline.report.page import render
from tests.report.test_page import PAGE

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on the PATH")
@pytest.mark.parametrize("place", ["", "#viewer"])
def test_without_webgl_there_is_a_line_and_no_empty_box(place: str, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text(render(PAGE), encoding="utf-8")
    assert CHROMIUM
    usual = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    address = (tmp_path / "report.html").as_uri() + place
    command = [CHROMIUM, *usual, "--disable-3d-apis", "--virtual-time-budget=1000", "--dump-dom", address]
    page = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    (viewer,) = re.findall(r"<section[^>]*>(.*?)</section>", page, re.DOTALL)
    assert "This browser has no WebGL: see the pictures instead." in viewer
    assert "stage" not in viewer
    assert 'class="alone"' not in page, "the gallery's frame has the pictures, too"
