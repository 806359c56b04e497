"""Lists of formats: any order, each once; what is none, or lacks its package, is said in one line."""

from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.options import formats
from pipeline.options.formats import asked_formats, check_installed
from pipeline.options.job import Job, resolve, run_name
from tests.tiny_bundle import write_tiny_bundle


def test_lists() -> None:
    assert asked_formats("") == ()
    assert asked_formats("USDZ, stl,stl,") == ("stl", "usdz")
    with pytest.raises(InputError, match=r"'fbx' is no format; expected some of ply, stl, 3mf, usdz"):
        asked_formats("stl,fbx")


def test_the_variable_reaches_the_job(tmp_path: Path) -> None:
    write_tiny_bundle(tmp_path / "tiny", latent_size=8)
    base = {"PROMPT": "a ball", "MODEL": "tiny"}
    jobs = [resolve({**base, "FORMATS": text}, tmp_path) for text in ("3mf, ply", "ply,3mf")]
    assert {job.formats for job in jobs} == {"ply,3mf"}, "the same files, the same folder"
    assert len({run_name(job) for job in jobs}) == 1
    with pytest.raises(InputError, match=r"^FORMATS is 'gif': 'gif' is no format"):
        resolve({**base, "FORMATS": "gif"}, tmp_path)
    with pytest.raises(InputError, match="no format"):
        Job(prompt="x", formats="gif")


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(formats.NEEDED, "usdz", ("no_such_module", "usd-core"))
    check_installed("ply", "stl", "3mf")
    with pytest.raises(
        InputError, match=r"FORMATS names usdz, whose package usd-core is not installed: .*pip install"
    ):
        check_installed("stl", "usdz")
