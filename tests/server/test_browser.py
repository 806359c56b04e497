"""The page, the report and the gallery in a real browser: asked, watched, turned, downloaded.

Needs playwright and a Chromium on the PATH; where one is missing these tests are left out.
"""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.server.running import serving, write_model

playwright = pytest.importorskip("playwright.sync_api")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
ARGUMENTS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
BOX = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on the PATH")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        one = driver.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield one
        one.close()


def open_page(browser: Any, **options: Any) -> tuple[Any, list[str], list[str]]:
    """Return a page, and what it will have asked for and complained about."""
    context = browser.new_context(reduced_motion="reduce", accept_downloads=True, **options)
    page = context.new_page()
    asked: list[str] = []
    wrong: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    return page, asked, wrong


def names_missing(page: Any) -> list[str]:
    """Return what can be operated and has no name for a screen reader."""
    found: list[str] = page.evaluate(
        """() => [...document.querySelectorAll("button, a[href], input, select, [tabindex='0']")]
        .filter((e) => e.offsetParent && !(e.textContent.trim() || e.getAttribute("aria-label") ||
            (e.labels && e.labels.length))).map((e) => e.outerHTML)"""
    )
    return found


def test_asked_watched_turned_and_downloaded(browser: Any, tmp_path: Path) -> None:
    write_model(tmp_path / "models", steps=60)
    out = tmp_path / "runs"
    with serving(out, tmp_path / "models") as server:
        page, asked, wrong = open_page(browser)
        page.goto(server.address)
        page.locator("#model option").nth(1).wait_for(state="attached")
        assert names_missing(page) == []
        page.locator("summary").click()
        page.select_option("#model", "tiny")
        page.keyboard.press("Tab")
        page.fill("#prompt", 'a <b>"red"</b> ball')
        page.set_input_files("#file", {"name": "box.obj", "mimeType": "text/plain", "buffer": BOX.encode()})
        page.locator("#file-name", has_text=re.compile(r"^box\.obj$")).wait_for()
        page.check("[name=use][value=sketch]")
        page.locator("#prompt").press("Enter")
        page.locator("#shown-title", has_text='a <b>"red"</b> ball').wait_for()
        page.locator("#state", has_text="Being made").wait_for(timeout=60_000)
        page.locator("#cancel").click()
        page.locator("#state", has_text="Stopped").wait_for(timeout=120_000)
        page.locator("#resume").click()
        page.locator("#state", has_text="Done.").wait_for(timeout=400_000)
        stage = page.locator(".stage[data-ready]")
        stage.wait_for(timeout=60_000)
        assert names_missing(page) == []

        def azimuth() -> float:
            page.wait_for_timeout(300)
            return float(stage.get_attribute("data-azimuth"))

        before = azimuth()
        box = stage.bounding_box()
        page.mouse.move(box["x"] + 200, box["y"] + 100)
        page.mouse.down()
        page.mouse.move(box["x"] + 300, box["y"] + 100, steps=4)
        page.mouse.up()
        turned = azimuth()
        assert abs(turned - before + 1.0) < 0.05, "a hundred pixels are a radian"
        stage.focus()
        page.keyboard.press("ArrowLeft")
        assert azimuth() > turned
        with page.expect_download() as download:
            page.locator("#downloads a").first.click()
        (run,) = out.glob("a-*")
        assert Path(download.value.path()).read_bytes() == (run / "asset.glb").read_bytes()
        assert all(url.startswith((server.address, "blob:", "data:")) for url in asked)
        assert wrong == []

        page.goto(server.address + "runs/")
        page.locator("a.tile").click()
        page.frame_locator("iframe").locator(".stage[data-ready]").wait_for(timeout=60_000)
        page.keyboard.press("Escape")
        page.locator("dialog").wait_for(state="hidden")

    # Without a server: a file, on a phone.
    page, asked, wrong = open_page(browser, viewport={"width": 390, "height": 800}, color_scheme="dark")
    page.goto((run / "report.html").as_uri())
    page.locator(".stage[data-ready]").wait_for(timeout=60_000)
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    assert page.evaluate("document.querySelector('video').paused")
    assert names_missing(page) == []
    assert [url for url in asked if not url.startswith(("file:", "blob:", "data:"))] == []
    assert wrong == []
