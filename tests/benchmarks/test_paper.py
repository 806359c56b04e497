"""The gallery of the paper's prompts: commands that work, meshes that load, a page that hides nothing."""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest

from benchmarks import paper
from benchmarks._results import Result, make_result, nothing
from benchmarks.paper import CASES, MESH, MOST_BYTES, NOT_LOOKED_AT, SKETCH, TEXT, Case, command
from pipeline.errors import InputError
from pipeline.mesh.readers import read_mesh
from pipeline.options import job as jobs
from pipeline.run import engine
from tests.fake_project import ROOT

FEW = (Case(TEXT, "a giraffe"), Case(TEXT, "a giraffe", refine=True), Case(MESH, "a goldfish", "fish"))


def result(fault: str = "") -> Result:
    return Result("run", 0.0 if fault else 61.4, nothing(24), fault)


def test_all_of_the_papers_prompts_are_there() -> None:
    once = [case for case in CASES if not case.refine]
    counted = {mode: sum(case.mode == mode for case in once) for mode in (TEXT, SKETCH, MESH)}
    assert counted == {TEXT: 11, SKETCH: 11, MESH: 13}
    assert len({case.title() for case in CASES}) == len(CASES)
    assert {case._replace(refine=False) for case in CASES} == set(once)
    assert {case.mode for case in CASES if case.refine} == {TEXT, SKETCH, MESH}


def test_every_command_is_what_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    for case in CASES:
        words = shlex.split(command(case))
        assert words[:2] == ["make", "run"]
        assert dict(word.split("=", 1) for word in words[2:]) == case.variables()
        if case.mode != MESH:
            job = jobs.resolve(case.variables())
            assert (job.prompt, job.refine, bool(job.sketch)) == (
                case.prompt,
                case.refine,
                case.mode == SKETCH,
            )


def test_quotes() -> None:
    assert command(FEW[1]) == 'make run PROMPT="a giraffe" REFINE=1'
    assert command(FEW[2]) == 'make run PROMPT="a goldfish" MESH=build/paper/meshes/fish.obj'
    assert shlex.split(paper.quoted("PROMPT", 'a "$HOME" sign')) == ['PROMPT=a "$HOME" sign']


def test_the_meshes_are_fit_for_painting(tmp_path: Path) -> None:
    words = sorted({case.shape for case in CASES if case.mode == MESH})
    paper.write_meshes(tmp_path, words)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert len(before) == len(words) == 8
    for path in tmp_path.iterdir():
        mesh = read_mesh(path)
        assert mesh.uv is None
        assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)
        assert np.linalg.norm(mesh.vertices, axis=1).max() == pytest.approx(0.75, abs=1e-3)
    paper.write_meshes(tmp_path, words)
    assert before == {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    case = next(case for case in CASES if case.mode == MESH)
    assert jobs.resolve(case.variables(tmp_path)).mesh == str(tmp_path / "cabinet.obj")


def test_the_page_shows_all_and_says_what_came_out_wrong(tmp_path: Path) -> None:
    (tmp_path / "gallery").mkdir()
    (tmp_path / "gallery" / "99-former.jpg").write_bytes(b"")
    remarks = {"a giraffe (REFINE=1)": "five legs | no neck"}
    paper.write_gallery(tmp_path, FEW, [result(), result(), result("the scene is empty")], remarks)
    pictures = sorted(path.name for path in (tmp_path / "gallery").iterdir())
    assert pictures == ["01-a-giraffe.jpg", "02-a-giraffe-refine-1.jpg", "03-a-goldfish.jpg"]
    page = (tmp_path / "gallery.md").read_text()
    assert all(f"(gallery/{name})" in page for name in pictures)
    assert "| Text | 1 | a giraffe |" in page
    assert "| Latent-Paint | 1 | none |" in page
    assert f'| `make run PROMPT="a giraffe"` | 61 | {NOT_LOOKED_AT} |' in page
    assert r"| 61 | five legs \| no neck |" in page
    assert "|  | no asset: the scene is empty |" in page
    assert paper.summary(FEW, [result(), result(), result("x")]) == {
        "runs": 3, "prompts": 2, "refined": 1, "failed": 1, "seconds": 122.8, "median_seconds": 61.4,
    }  # fmt: skip


def test_pictures_are_small() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (320, 480, 3), np.uint8)
    assert len(paper.small_jpeg(noise)) <= MOST_BYTES
    with pytest.raises(ValueError, match="does not fit"):
        paper.small_jpeg(noise, 1000)


def test_remarks_are_about_prompts_of_the_page() -> None:
    assert paper.read_remarks('{"a temple": "no columns"}') == {"a temple": "no columns"}
    with pytest.raises(InputError, match="speaks of a tempel"):
        paper.read_remarks('{"a tempel": "no columns"}')
    written = ROOT / "benchmarks" / "results" / "paper-remarks.json"
    if written.is_file():
        paper.read_remarks(written.read_text(encoding="utf-8"))


def test_main_takes_its_runs_from_the_front_door(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    called = []

    def faked(function: object, calls: list[tuple[dict[str, str], Path, int]], label: str) -> list[Result]:
        assert function is make_result
        called.extend(calls)
        return [result() for _ in calls]

    monkeypatch.setattr(paper, "at_once", faked)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(paper, "CASES", FEW)
    (tmp_path / "paper-remarks.json").write_text(json.dumps({"a goldfish": "no fins"}))
    figures = paper.main(tmp_path)
    assert [asked["PROMPT"] for asked, _, _ in called] == [case.prompt for case in FEW]
    assert Path(called[2][0]["MESH"]).is_file()
    assert figures["summary"]["runs"] == len(figures["rows"]) == 3
    assert "no fins" in (tmp_path / "docs" / "gallery.md").read_text()


def test_a_scene_that_came_to_nothing_is_a_result_and_a_full_disk_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(job: jobs.Job, out: Path, threads: int) -> Path:
        raise InputError("the trained scene is empty; try another SEED")

    monkeypatch.setattr(engine, "run_job", fails)
    asked = {"PROMPT": "a giraffe"}
    with pytest.raises(InputError):
        make_result(asked, tmp_path, 8)
    stages = tmp_path / jobs.run_name(jobs.resolve(asked)) / "stages"
    stages.mkdir(parents=True)
    (stages / "extract.error").write_text("2 the trained scene is empty; try another SEED\n")
    found = make_result(asked, tmp_path, 8)
    assert found.fault.startswith("the trained scene is empty")
    assert found.views.shape == (6, 8, 8, 3)
