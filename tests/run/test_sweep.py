"""Sweeps through the front door with stages that take no time: what is shared, what fails, what survives."""

import collections
import csv
import io
from pathlib import Path

import pytest

from tests.fake_project import Project, kill_group

SIX = "prompt: [a mug, a duck]\nclean: {faces: [500, 600, 700]}\n"


@pytest.fixture
def project(tmp_path: Path) -> Project:
    made = Project(tmp_path / "project")
    (made.root / "six.yaml").write_text(SIX)
    return made


def counts(text: str) -> dict[str, int]:
    """Return how often each stage did its work, whatever run's label stands before."""
    return collections.Counter(line.partition("ran ")[2] for line in text.splitlines() if "] ran " in line)


def rows(project: Project) -> list[dict[str, str]]:
    (path,) = project.root.glob("runs/sweeps/six-*/table.csv")
    return list(csv.DictReader(io.StringIO(path.read_text())))


def test_shared_work_is_done_once_and_the_next_time_nothing(project: Project) -> None:
    result = project.make("sweep", JOBS="six.yaml")
    assert result.returncode == 0, result.stderr
    done = counts(result.stderr)
    # Each of the two prompts is trained and extracted once, for three budgets of faces.
    assert (done["embed"], done["train_nerf"], done["extract"]) == (2, 2, 2)
    # The fake of `clean` makes the same mesh for a budget, whatever it is of; `bake` also reads the scene.
    assert (done["clean"], done["unwrap"], done["bake"], done["publish"]) == (6, 3, 6, 6)
    runs = [run for run in project.root.glob("runs/a-*") if not run.is_symlink()]
    assert len(runs) == 6
    assert all((run / "asset.glb").is_file() and (run / "report.html").is_file() for run in runs)
    files = [project.root / line for line in result.stdout.splitlines()]
    assert [file.name for file in files] == ["sheet.png", "table.csv", "index.html"]
    assert [(row["prompt"], row["clean.faces"]) for row in rows(project)] == [
        (prompt, faces) for prompt in ("a mug", "a duck") for faces in ("500", "600", "700")
    ]
    again = project.make("sweep", JOBS="six.yaml")
    assert again.returncode == 0
    assert counts(again.stderr) == {}
    assert "nothing to do" in again.stderr
    # A run of the sweep is a run like any other.
    assert project.ran(project.make("run", JOB=str(runs[0] / "job.yaml"))) == []


def test_what_fails_does_not_keep_the_others(project: Project) -> None:
    broken = project.root / "pipeline" / "stages" / "extract.py"
    fake = broken.read_text()
    broken.write_text(
        fake.replace(
            "    kind = PROJECT",
            '    if "duck" in context.job.prompt: raise InputError("no duck: go")\n    kind = PROJECT',
        )
    )
    result = project.make("sweep", JOBS="six.yaml")
    assert result.returncode == 2
    assert "error: 3 of 6 were not made; the first: no duck: go" in result.stderr
    failed = [row["failed"] for row in rows(project) if row["prompt"] == "a duck"]
    assert failed.count("no duck: go") == 1, "the others wait for it, and say where to look"
    assert all(failed)
    assert [row["failed"] for row in rows(project) if row["prompt"] == "a mug"] == [""] * 3
    assert len(list(project.root.glob("runs/a-mug-*/asset.glb"))) == 3
    broken.write_text(fake)
    mended = project.make("sweep", JOBS="six.yaml")
    assert mended.returncode == 0, mended.stderr
    assert counts(mended.stderr).get("train_nerf", 0) == 0
    assert [row["failed"] for row in rows(project)] == [""] * 6


def test_kill_9_then_the_same_sweep(project: Project) -> None:
    (project.root / "slow").write_text("0.05")
    process = project.start("sweep", JOBS="six.yaml")
    project.wait_for_step(5)
    kill_group(process)
    (project.root / "slow").unlink()
    result = project.make("sweep", JOBS="six.yaml")
    assert result.returncode == 0, result.stderr
    assert counts(result.stderr)["train_nerf"] <= 2
    resumed = [path.read_text() for path in project.root.glob("runs/a-*/stages/train_nerf.json")]
    assert any('"resumed_at": 0' not in text for text in resumed)


def test_a_folder_that_another_run_holds_is_named(project: Project) -> None:
    (project.root / "slow").write_text("0.1")
    (project.root / "one.yaml").write_text("prompt: a mug\nclean: {faces: 500}\n")
    process = project.start("run", JOB="one.yaml")
    project.wait_for_step(1)
    result = project.make("sweep", JOBS="six.yaml")
    kill_group(process)
    assert result.returncode == 2
    assert "is being made by another run" in result.stderr


def test_without_a_file(project: Project) -> None:
    assert "JOBS is empty" in project.make("sweep").stderr
