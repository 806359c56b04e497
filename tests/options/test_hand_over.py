"""Several models for one asset, as a chain of jobs."""

from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.options.hand_over import STRENGTH, model_names, resolve_all
from pipeline.options.job import run_name


@pytest.fixture
def models(tmp_path: Path) -> Path:
    for name in ("small", "large", "a,b"):
        (tmp_path / name).mkdir()
    return tmp_path


def test_one_model_is_one_job(models: Path) -> None:
    assert len(resolve_all({"PROMPT": "x", "MODEL": "small"}, Path("runs"), models)) == 1
    assert model_names("a,b", models) == ["a,b"]


def test_each_model_goes_on_from_the_run_before(models: Path, tmp_path: Path) -> None:
    asked = {"PROMPT": "x", "MODEL": "small, large,small", "QUALITY": "high", "REFINE": "1", "SEED": "3"}
    first, second, third = resolve_all(asked, tmp_path / "out", models)
    assert [job.model for job in (first, second, third)] == ["small", "large", "small"]
    assert [job.quality for job in (first, second, third)] == ["draft", "draft", "high"]
    assert [job.refine for job in (first, second, third)] == [False, False, True]
    assert {job.seed for job in (first, second, third)} == {3}
    assert first.start == ""
    assert second.start == str(tmp_path / "out" / run_name(first))
    assert third.start == str(tmp_path / "out" / run_name(second))
    assert (first.start_fit.updates_per_call, second.start_fit.updates_per_call) == (0, 6)
    assert second.strength == third.strength == float(STRENGTH)


def test_strength_is_that_of_the_start_or_else_of_the_hand_over(models: Path, tmp_path: Path) -> None:
    asked = {"PROMPT": "x", "MODEL": "small,large", "STRENGTH": "0.7"}
    first, second = resolve_all(asked, tmp_path, models)
    assert (first.strength, second.strength) == (0.5, 0.7)
    run = tmp_path / "run"
    run.mkdir()
    (run / "field.npz").write_bytes(b"x")
    first, second = resolve_all({**asked, "START": str(run)}, tmp_path, models)
    assert first.start == str(run)
    assert (first.strength, second.strength) == (0.7, float(STRENGTH))


def test_models_may_stand_in_the_job_file(models: Path, tmp_path: Path) -> None:
    (tmp_path / "job.yaml").write_text("prompt: x\nmodel: small,large\n")
    jobs = resolve_all({"JOB": str(tmp_path / "job.yaml")}, tmp_path, models)
    assert [job.model for job in jobs] == ["small", "large"]


def test_hostile_lists_end_in_one_line(models: Path, tmp_path: Path) -> None:
    for given, fault in (
        ("small,", "expected models with a comma between each two"),
        (",", "expected models with a comma"),
        ("small,small", "names 'small' twice in a row"),
        ("small,none", "MODEL 'none' does not exist; there are"),
        ("none,small", "MODEL 'none' does not exist"),
    ):
        with pytest.raises(InputError, match=fault):
            resolve_all({"PROMPT": "x", "MODEL": given}, tmp_path, models)
