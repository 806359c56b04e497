"""What a stage said, with the names that the user typed."""

from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.options.job import Job
from pipeline.run.failures import as_typed, failure


def test_paths_of_a_stage_are_those_that_were_typed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run, elsewhere = tmp_path / "out" / "run", tmp_path / "here"
    for folder in (run, elsewhere / "given" / "old"):
        folder.mkdir(parents=True)
    for name in ("chair.obj", "chair.obj.mtl", "skin.png"):
        (elsewhere / "given" / name).write_text("x")
    (run / "field.npz").write_text("x")
    monkeypatch.chdir(elsewhere)
    files = "../../here/given"
    mesh = Job(prompt="x", mesh="given/chair.obj", model="./model")
    start = Job(prompt="x", start="../here/given/chair.obj", model="./model")
    other = Job(prompt="x", start="given/old", model="./model")
    for job, said, typed in (
        (mesh, f"{files}/chair.obj: no", "given/chair.obj: no"),
        (mesh, f"{files}/skin.png: no ... 1 .. 2", "given/skin.png: no ... 1 .. 2"),
        (mesh, f"{files}/chair.obj.mtl: no", "given/chair.obj.mtl: no"),
        (start, f"{files}/chair.obj has no colours", "../here/given/chair.obj has no colours"),
        (start, f"{files}/skin.png: no", "../here/given/skin.png: no"),
        (other, f"{files}/old/field.npz is no scene", "given/old/field.npz is no scene"),
        (other, "../../here/model/unet: cut", "./model/unet: cut"),
        (other, "field.npz is no scene", f"{run}/field.npz is no scene"),
    ):
        assert as_typed(said, job, run) == typed


def test_a_missing_library_of_the_system_is_named(tmp_path: Path) -> None:
    (tmp_path / "stages").mkdir()
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "snakemake.log").write_text(
        "Traceback (most recent call last):\n    import pymeshlab\n"
        "ImportError: libGL.so.1: cannot open shared object file: No such file\nUsing profile x\n"
    )
    found = failure(Job(prompt="x"), tmp_path)
    assert isinstance(found, InputError)
    assert str(found).startswith("libGL.so.1: cannot open shared object file")
    assert "apt-get install libgl1 libopengl0" in str(found)
