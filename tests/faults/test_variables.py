"""Variables and job files: errors name what was typed, and what is not ours is not read."""

import os
import sys
from pathlib import Path

import pytest

from tests.faults.door import Door


def _runs(door: Door) -> dict[Path, int]:
    """Return the stages that have run so far, and when."""
    return {path: path.stat().st_mtime_ns for path in door.out.glob("*/stages/*.json")}


@pytest.mark.parametrize(("variables", "words"), [
    ({"SEED": "-1"}, "SEED is -1"),
    ({"QUALITY": "best"}, "QUALITY is 'best'"),
    ({"PROVIDER": "cuda"}, "PROVIDER is 'cuda'"),
    ({"PROFILE": "lsf"}, "PROFILE 'lsf' does not exist"),
    ({"PROFILE": "slurm"}, "snakemake-executor-plugin-slurm"),
    ({"THREADS": "no"}, "THREADS is 'no'"),
    ({"MESH": "job.yaml"}, "job.yaml: the ending is .yaml"),
    ({"SKETCH": "job.yaml"}, "job.yaml: the ending is .yaml"),
    ({"JOB": "/dev/zero"}, "/dev/zero"),
    ({"JOB": "nowhere.yaml"}, "nowhere.yaml does not exist"),
    ({"JOB": "model"}, "model"),
    ({"MODEL": "a\nb\x1b[2J"}, "a\\nb"),
    ({"PROMPT": "nul\\x00"[:4] + " \udcff"}, "PROMPT is not valid UTF-8"),
])  # fmt: skip
@pytest.mark.parametrize("target", ["plan", "run"])
def test_plan_and_run_refuse_the_same(door: Door, variables: dict[str, str], words: str, target: str) -> None:
    if variables.get("PROFILE") == "slurm":
        pytest.importorskip("snakemake")
        if any((Path(p) / "snakemake_executor_plugin_slurm").is_dir() for p in sys.path):
            pytest.skip("the plugin is installed")
    before = _runs(door)
    door.refused(target, words, **variables)
    assert _runs(door) == before


@pytest.mark.parametrize("text", [
    "!!python/object/apply:os.system ['touch executed']", "prompt: [1", "- a", "promt: x", "seed: 1e400",
    f"seed: 0x{'9' * 5000}", "prompt: x\nprompt: y", "a: &a [*a]", "train_nerf: {steps: no}", "[" * 5000,
    "\0",
])  # fmt: skip
def test_job_files(door: Door, text: str) -> None:
    (door.given / "job.yaml").write_text(text)
    door.refused("plan", "given/job.yaml", JOB="given/job.yaml")


def test_a_pipe_that_nobody_writes_to(door: Door) -> None:
    os.mkfifo(door.given / "pipe.yaml")
    try:
        answer = door.ask("plan", JOB="given/pipe.yaml")
    finally:
        (door.given / "pipe.yaml").unlink()
    assert answer.status == 2
    assert "no regular file" in answer.error


def test_secrets_of_the_environment_are_not_read(door: Door) -> None:
    secrets = dict.fromkeys(("TOKEN", "MODEL", "JOB", "PROFILE", "OUT", "MESH", "SEED"), "hunter2")
    answer = door.ask("plan", environment=secrets)
    assert answer.status == 0, answer.stderr
    assert "hunter2" not in answer.stdout + answer.stderr


def test_a_plain_locale_prints_what_it_can(door: Door) -> None:
    plain = {"LANG": "C", "LC_ALL": "C", "PYTHONIOENCODING": "ascii"}
    answer = door.ask("plan", environment=plain, OUT="out é")
    assert answer.status == 0, answer.stderr
