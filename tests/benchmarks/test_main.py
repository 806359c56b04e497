"""The pages of docs/ show the tables that the benchmarks wrote."""

from pathlib import Path

import pytest

from benchmarks.__main__ import DOCS, RESULTS, include

MARKED = (
    "before\n<!-- bench skip -->\n\nold\n\n<!-- end -->\nafter\n<!-- bench other -->\n\nx\n\n<!-- end -->\n"
)


def test_a_table_replaces_the_former_one_and_nothing_else(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(MARKED)
    include(page, "skip", "| new |\n")
    assert page.read_text() == MARKED.replace("old\n", "| new |\n")
    include(page, "unmarked", "| y |\n")
    assert "| y |" not in page.read_text()


@pytest.mark.parametrize(
    "name", ["denoiser", "oracle", "oracle-choices", "field", "skip", "guidance", "refine"]
)
def test_the_page_has_the_newest_table(name: str, tmp_path: Path) -> None:
    table = RESULTS / f"{name}.md"
    if not table.is_file():
        pytest.skip(f"{name} has not been run")
    page = tmp_path / "page.md"
    shown = DOCS / "benchmarks.md"
    page.write_bytes(shown.read_bytes())
    include(page, name, table.read_text(encoding="utf-8"))
    assert page.read_text(encoding="utf-8") == shown.read_text(encoding="utf-8")
    assert f"<!-- bench {name} -->" in page.read_text(encoding="utf-8")
