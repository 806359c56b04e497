"""Runs through the front door with stages that take no time: what runs, what does not, what survives."""

import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.files import file_sha256
from pipeline.run import engine
from pipeline.run.costs import Cost
from pipeline.run.plan import Step
from tests.fake_project import RUN_STAGES, STEPS, Project, kill_group

FAKES = RUN_STAGES[:-1]
PROMPT = "a red ball"
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Project:
    """A project with one finished run; tests that change it work on a copy."""
    project = Project(tmp_path_factory.mktemp("finished"))
    result = project.make("run", PROMPT=PROMPT, THREADS="3")
    assert result.returncode == 0, result.stderr
    assert project.ran(result) == FAKES
    return project


@pytest.fixture
def project(finished: Project, tmp_path: Path) -> Project:
    copy = Project.__new__(Project)
    copy.root = tmp_path / "project"
    shutil.copytree(finished.root, copy.root, symlinks=True)
    return copy


def snapshot(folder: Path) -> dict[str, str]:
    """Return the sha256 of every file of a run that a user sees."""
    return {
        str(p.relative_to(folder)): file_sha256(p)
        for p in sorted(folder.rglob("*"))
        if p.is_file() and not any(part.startswith(".") for part in p.relative_to(folder).parts)
    }


def test_a_second_run_does_nothing_and_says_so(finished: Project) -> None:
    before = snapshot(finished.latest)
    result = finished.make("run", PROMPT=PROMPT)
    assert result.returncode == 0
    assert finished.ran(result) == []
    assert "nothing to do" in result.stderr
    assert snapshot(finished.latest) == before
    glb, report = result.stdout.splitlines()[-2:]
    assert (finished.root / glb).name == "asset.glb"
    assert (finished.root / report).read_text().count("<html") == 1


def test_the_entry_says_how_a_file_was_made(finished: Project) -> None:
    entry = finished.entry("bake")
    job = finished_job(finished)
    assert entry["options"] == {name: job[name] for name in ("bake", "provider")}
    assert entry["seed"] == 0
    assert entry["threads"] == 3
    assert isinstance(entry["peak_memory_mb"], float)
    assert 5 < entry["peak_memory_mb"] < 2000
    inputs, outputs = entry["inputs"], entry["outputs"]
    assert isinstance(inputs, dict)
    assert isinstance(outputs, dict)
    assert inputs["mesh"] == {"path": "mesh_uv.obj", "sha256": file_sha256(finished.latest / "mesh_uv.obj")}
    assert outputs["albedo"]["sha256"] == file_sha256(finished.latest / "albedo_baked.png")
    assert str(finished.root) not in json.dumps(entry), "no machine's folders in an entry"


def finished_job(project: Project) -> dict[str, object]:
    import yaml

    value = yaml.safe_load((project.latest / "job.yaml").read_text())
    assert isinstance(value, dict)
    return value


def test_library_chatter_goes_to_the_log_and_warnings_to_the_user(project: Project) -> None:
    result = project.make("run", PROMPT=PROMPT, OUT="elsewhere")
    assert "chatter" not in result.stderr + result.stdout
    assert "chatter" in (project.root / "elsewhere" / "latest" / "logs" / "clean.log").read_text()
    assert "warning: the word 'zyx' is unknown" in result.stderr
    assert (
        "the word &#x27;zyx&#x27; is unknown" in (project.root / "elsewhere/latest/report.html").read_text()
    )
    lines = result.stderr.lower().splitlines()
    assert not [line for line in lines if "snakemake" in line or "rule" in line or "job" in line]


def test_a_changed_option_reruns_only_what_depends_on_it(project: Project) -> None:
    (project.root / "job.yaml").write_text("clean: {faces: 500}\n")
    result = project.make("run", PROMPT=PROMPT, JOB="job.yaml")
    assert result.returncode == 0, result.stderr
    assert project.ran(result) == ["clean", "unwrap", "bake", "publish"]
    assert project.entry("train_nerf")["reused_from"]
    assert len(list((project.root / "runs").glob("a-red-ball-*"))) == 2
    assert project.make("verify", RUN="runs/latest").returncode == 0


def test_a_sketch_is_tabulated_once_whatever_its_name_and_sigma(project: Project) -> None:
    first, second = (project.root / name for name in ("a {b} 'house'.obj", "$(touch y).obj"))
    first.write_text(TRIANGLE)
    result = project.make("run", PROMPT=PROMPT, SKETCH=first.name)
    after_sketch = ["train_nerf", "extract", "clean", "bake", "publish"]  # the mesh comes out the same
    assert result.returncode == 0, result.stderr
    assert project.ran(result) == ["sketch", *after_sketch]
    inputs = project.entry("sketch")["inputs"]
    assert isinstance(inputs, dict)
    assert inputs["sketch"]["path"] == "../../a {b} 'house'.obj"
    manifest = json.loads((project.latest / "manifest.json").read_text())
    assert "sketch.npz" in manifest["files"]
    assert manifest["job"]["sketch"] == first.name
    assert project.ran(project.make("run", PROMPT=PROMPT, SKETCH=first.name, SIGMA_S="0.1")) == after_sketch
    second.write_text(TRIANGLE)
    assert project.ran(project.make("run", PROMPT=PROMPT, SKETCH=str(second))) == []
    assert not (project.root / "y").exists()
    first.write_text(TRIANGLE + "# a tower")
    assert project.ran(project.make("run", PROMPT=PROMPT, SKETCH=first.name)) == ["sketch", *after_sketch]
    planned = project.make("plan", PROMPT=PROMPT, SKETCH=first.name, SEED="5").stdout
    assert "sketch" in planned
    assert "reuse" in planned


def test_outputs_that_come_out_the_same_stop_the_rerun(project: Project) -> None:
    """The fake clean writes the same mesh for any input: nothing after it has to run."""
    (project.root / "job.yaml").write_text("extract: {resolution: 32}\n")
    assert project.ran(project.make("run", PROMPT=PROMPT, JOB="job.yaml")) == ["extract", "clean"]


def test_a_changed_source_reruns_the_stages_that_import_it(project: Project) -> None:
    stage = project.root / "pipeline" / "stages" / "bake.py"
    stage.write_text(stage.read_text() + "# changed\n")
    plan = project.make("plan", PROMPT=PROMPT).stdout
    assert [line.split()[:2] for line in plan.splitlines() if "source changed" in line] == [["bake", "run"]]
    assert project.ran(project.make("run", PROMPT=PROMPT)) == ["bake"], (
        "its output is the same: publish stays"
    )
    (project.root / "pipeline" / "stages" / "tools.py").write_text("UNIT = 2\n")
    assert project.ran(project.make("run", PROMPT=PROMPT)) == FAKES, "every fake imports it"


@pytest.mark.parametrize("damage", ["truncated", "emptied", "deleted", "changed"])
def test_damaged_files_are_noticed_and_made_again(project: Project, damage: str) -> None:
    before = snapshot(project.latest)
    file = project.latest / "asset.glb"
    content = file.read_bytes()
    if damage == "deleted":
        file.unlink()
    else:
        file.write_bytes({"truncated": content[:-1], "emptied": b"", "changed": content[:-1] + b"!"}[damage])
    verified = project.make("verify", RUN="runs/latest")
    assert verified.returncode != 0
    assert "asset.glb" in verified.stderr
    assert "asset.obj" not in verified.stderr
    assert project.ran(project.make("run", PROMPT=PROMPT)) == ["publish"]
    after = snapshot(project.latest)
    for name in ("asset.glb", "asset.obj", "albedo.png", "field.npz"):
        assert after[name] == before[name]
    assert project.make("verify", RUN="runs/latest").returncode == 0


@pytest.mark.parametrize("content", [pytest.param(None, marks=pytest.mark.thorough), "prompt: another\n"])
def test_a_damaged_job_file_is_mended(project: Project, content: str | None) -> None:
    file = project.latest / "job.yaml"
    before = file.read_bytes()
    file.unlink() if content is None else file.write_text(content)
    assert project.make("verify", RUN="runs/latest").returncode != 0
    assert "nothing to do" in project.make("run", PROMPT=PROMPT).stderr
    assert file.read_bytes() == before
    assert project.make("verify", RUN="runs/latest").returncode == 0


def test_kill_9_of_everything_then_the_same_command(project: Project) -> None:
    expected = file_sha256(project.latest / "asset.glb")
    shutil.rmtree(project.root / "runs")
    (project.root / "slow").write_text("0.05")
    process = project.start("run", PROMPT=PROMPT)
    project.wait_for_step(5)
    kill_group(process)
    reached = int(next(project.root.glob("runs/*/checkpoints/train_nerf/step.checkpoint")).read_text())
    assert "continues from its checkpoint" in project.make("plan", PROMPT=PROMPT).stdout
    (project.root / "slow").unlink()
    result = project.make("run", PROMPT=PROMPT)
    assert result.returncode == 0, result.stderr
    assert project.ran(result) == FAKES[1:]
    metrics = project.entry("train_nerf")["metrics"]
    assert isinstance(metrics, dict)
    assert 5 <= metrics["resumed_at"] == reached < STEPS
    assert file_sha256(project.latest / "asset.glb") == expected
    assert not list(project.latest.glob("checkpoints/train_nerf")), "scratch goes after success"


def test_nothing_lives_on_when_only_the_front_door_is_killed(project: Project) -> None:
    shutil.rmtree(project.root / "runs")
    (project.root / "slow").write_text("0.1")
    process = project.start("run", PROMPT=PROMPT)
    project.wait_for_step(2)
    front_door = int(next(project.root.glob("runs/*/.lock")).read_text())
    os.kill(front_door, signal.SIGKILL)  # a minimal Debian has no program of that name
    process.communicate(timeout=20)
    step = next(project.root.glob("runs/*/checkpoints/train_nerf/step.checkpoint"))
    time.sleep(0.3)
    reached = step.read_text()
    time.sleep(0.5)
    assert step.read_text() == reached, "the training goes on without its run"


def test_two_runs_at_once_in_one_folder(project: Project) -> None:
    shutil.rmtree(project.root / "runs")
    (project.root / "slow").write_text("0.2")
    first = project.start("run", PROMPT=PROMPT)
    project.wait_for_step(1)
    second = project.make("run", PROMPT=PROMPT)
    assert second.returncode == 2
    assert "another run" in one_error(second)
    assert first.poll() is None, "the first run is not disturbed"
    (project.root / "slow").write_text("0")
    first.communicate(timeout=60)
    assert first.returncode == 0


def test_checkpoints_of_other_inputs_are_not_continued(project: Project) -> None:
    shutil.rmtree(project.root / "runs")
    (project.root / "fail-train_nerf").write_text("fault")
    project.make("run", PROMPT=PROMPT)
    (project.root / "fail-train_nerf").unlink()
    plan = project.make("plan", PROMPT=PROMPT).stdout
    assert ["train_nerf", "run"] in [line.split()[:2] for line in plan.splitlines()]
    assert "continues from its checkpoint" in plan
    (project.root / "pipeline" / "stages" / "tools.py").write_text("UNIT = 3\n")
    project.make("run", PROMPT=PROMPT)
    metrics = project.entry("train_nerf")["metrics"]
    assert isinstance(metrics, dict)
    assert metrics["resumed_at"] == 0


def one_error(result: "subprocess.CompletedProcess[str]") -> str:
    """Return the one line that an error may print; a traceback or a second line fails."""
    lines = [line for line in result.stderr.splitlines() if line and not line.startswith("make")]
    errors = [line for line in lines if line.startswith("error: ")]
    assert len(errors) == 1, result.stderr
    assert lines[-1] == errors[0]
    assert "Traceback" not in result.stderr
    return errors[0]


def test_an_input_error_of_a_stage_reaches_the_user(project: Project) -> None:
    before = snapshot(project.latest)
    (project.root / "fail-bake").write_text("input")
    (project.root / "job.yaml").write_text("bake: {views: 8}\n")
    result = project.make("run", PROMPT=PROMPT, JOB="job.yaml")
    assert result.returncode == 2
    assert one_error(result) == "error: the moon is full: wait"
    stage = project.root / "pipeline" / "stages" / "bake.py"
    stage.write_text(stage.read_text() + "# so that it runs\n")
    first = min((project.root / "runs").glob("a-red-ball-*"), key=lambda p: p.stat().st_ctime)
    assert project.make("run", PROMPT=PROMPT).returncode == 2
    assert {k: v for k, v in snapshot(project.latest).items() if not k.startswith(("logs", "stages"))} == {
        k: v for k, v in before.items() if not k.startswith(("logs", "stages"))
    }, first


def test_a_fault_of_a_stage_leaves_its_traceback_in_the_log(project: Project) -> None:
    shutil.rmtree(project.root / "runs")
    (project.root / "fail-clean").write_text("fault")
    result = project.make("run", PROMPT=PROMPT)
    assert result.returncode == 2, "make's own status"
    error = one_error(result)
    assert "stage clean failed: KeyError: 'boom'" in error
    assert "Traceback" in Path(error.split("details in ")[1]).read_text()
    (project.root / "fail-clean").unlink()
    assert project.ran(project.make("run", PROMPT=PROMPT)) == ["clean", "unwrap", "bake", "publish"]


def test_a_missing_or_truncated_model_file_is_named(project: Project) -> None:
    before = snapshot(project.root / "runs")
    model = project.root / "onnx_models" / "everyday-objects" / "unet" / "model.onnx"
    content = model.read_bytes()
    model.write_bytes(content[: len(content) // 2])
    truncated = project.make("run", PROMPT=PROMPT)
    model.unlink()
    missing = project.make("run", PROMPT=PROMPT)
    new = project.make("run", PROMPT="never made before")
    for result in (truncated, missing, new):
        assert result.returncode == 2
        assert "unet/model.onnx" in one_error(result)
    assert snapshot(project.root / "runs") == before


def test_a_folder_that_cannot_be_written(project: Project) -> None:
    (project.root / "taken").write_text("a file")
    result = project.make("run", PROMPT=PROMPT, OUT="taken/runs")
    assert result.returncode == 2
    assert "OUT=" in one_error(result)
    assert (project.root / "taken").read_text() == "a file"


def test_a_cluster_that_is_not_installed_is_named(project: Project) -> None:
    result = project.make("run", PROMPT="a blue ball", PROFILE="slurm")
    assert result.returncode == 2
    assert "slurm" in one_error(result)
    result = project.make("run", PROMPT="a blue ball", PROFILE="moon")
    assert "local, slurm" in one_error(result)


def test_plan_tells_and_writes_nothing(finished: Project) -> None:
    before = snapshot(finished.root)
    result = finished.make("plan", PROMPT=PROMPT)
    assert "nothing would run" in result.stdout
    result = finished.make("plan", PROMPT="a green ball")
    rows = {
        line.split()[0]: line.split() for line in result.stdout.splitlines() if line.split()[0] in RUN_STAGES
    }
    assert list(rows) == RUN_STAGES
    assert rows["embed"][1] == "run"
    assert rows["report"][1] == "run"
    assert snapshot(finished.root) == before


def test_what_the_disk_and_the_memory_lack_is_said_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    priced = [(Step("train_nerf", "run", "new"), Cost(70.0, 3000.0))]
    monkeypatch.setattr(engine, "available_memory_mb", lambda: 2000.0)
    engine._check_room(tmp_path, priced)
    assert "about 3000 MB of memory are needed, 2000 MB are free" in capfd.readouterr().err
    usage = shutil.disk_usage(tmp_path)._replace(free=50 << 20)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
    with pytest.raises(InputError, match="has 50 MB of disk left, a run needs 200 MB: free some"):
        engine._check_room(tmp_path, priced)
