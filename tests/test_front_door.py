"""What a user writes arrives as it was written, and never runs."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.fake_project import ROOT, Project, clean_environment

NASTY = {
    "make function": "$(shell touch x)",
    "make variable": "$(PROMPT) ${MAKE} $@ $$ $",
    "command substitution": "`touch x` $(touch x)",
    "quotes": 'it\'s a "red" chair; touch x & | > x',
    "snakemake": "{x} {wildcards} {{y}} {input}",
    "path": "../../x/.. /etc/passwd ~",
    "newline": "first\nsecond\n\ttouch x",
    "emoji": "🪑 ein roter Stuhl é",
    "backslash": "\\n \\ \\\\ %s %d # comment",
    "long": "red " * 2500,
}


@pytest.fixture(scope="module")
def echo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program that stands for Python and prints its arguments and environment."""
    path = tmp_path_factory.mktemp("echo") / "echo"
    path.write_text(
        f"#!{sys.executable}\nimport json, os, sys\nprint(json.dumps([sys.argv[1:], dict(os.environ)]))\n"
    )
    path.chmod(0o755)
    return path


@pytest.mark.parametrize("text", NASTY.values(), ids=NASTY.keys())
def test_make_passes_text_as_it_is(tmp_path: Path, echo: Path, text: str) -> None:
    given = {"PROMPT": text, "NEGATIVE": f"not {text}", "OUT": f"out {text}"}
    arguments = [f"{k}={v}" for k, v in given.items()]
    secrets = dict.fromkeys(("TOKEN", "MODEL", "NAME", *given), "a secret")
    result = subprocess.run(
        ["make", "-f", str(ROOT / "Makefile"), "-o", ".venv/.runtime", "run", f"IN_VENV={echo}", *arguments],
        cwd=tmp_path,
        env=clean_environment() | secrets,
        capture_output=True,
        text=True,
        check=True,
    )
    argv, seen = json.loads(result.stdout)
    assert "a secret" not in seen.values(), "what the environment calls TOKEN is none of ours"
    assert argv == ["-m", "pipeline", "run"]
    assert {name: seen[name] for name in given} == given
    assert list(tmp_path.iterdir()) == [], "something was executed"


def test_nothing_between_make_and_the_report_reads_the_prompt(tmp_path: Path) -> None:
    project = Project(tmp_path / "it's {a} $(touch x) project")
    prompt = " ".join(text for name, text in NASTY.items() if name != "long") + "<script>alert(1)</script>"
    result = project.make("run", PROMPT=prompt, OUT="runs {b} $(touch y)")
    assert result.returncode == 0, result.stderr
    run = project.root / "runs {b} $(touch y)" / "latest"
    assert yaml.safe_load((run / "job.yaml").read_text())["prompt"] == prompt
    assert json.loads((run / "manifest.json").read_text())["job"]["prompt"] == prompt
    assert "<script>alert" not in (run / "report.html").read_text()
    assert not [p for p in tmp_path.rglob("*") if p.name in ("x", "y")], "something was executed"


def make(*arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        ["make", "-o", ".venv/.runtime", f"IN_VENV={sys.executable}", *arguments],
        cwd=ROOT,
        env=clean_environment(),
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["prompt is empty"]),
        (["PROMPT="], ["prompt is empty"]),
        (["PROMPT=x", "MODEL=nowhere"], ["MODEL", "nowhere", "there are"]),
        (["PROMPT=x", "SEED=-1", "JOB=README.md"], ["README.md is not plain YAML"]),
        (["PROMPT=x", "SEED=-1"], ["SEED is -1", "0", "4294967295"]),
        (["PROMPT=x", "QUALITY=ultra"], ["QUALITY is", "draft | standard | high"]),
        (["PROMPT=x", "MESH=fish.obj"], ["MESH", "fish.obj", "no file"]),
        (["PROMPT=x", f"MESH={'a' * 300}.obj"], ["aaa", "longer than", "shorten"]),
        (["PROMPT=x", "PARAM=face"], ["PARAM", "MESH"]),
        (["PROMPT=x", "MESH=README.md", "SKETCH=README.md"], ["SKETCH", "MESH", "leave one out"]),
        (["PROMPT=x", "SKETCH=absent.obj"], ["SKETCH", "absent.obj", "is no file"]),
        (["PROMPT=x", "SIGMA_S=0.3"], ["SIGMA_S", "SKETCH=file"]),
        (["PROMPT=x", "SKETCH=README.md", "SIGMA_S=0"], ["SIGMA_S is", "0.01", "10"]),
        (["PROMPT=x", "SKETCH=README.md", "SIGMA_S=wide"], ["SIGMA_S", "'wide'", "0.3"]),
        (["PROMPT=x", "REFINE=yes"], ["REFINE", "'yes'", "1"]),
        (["PROMPT=x", "TOKEN=cat.safetensors"], ["TOKEN", "cat.safetensors", "no file"]),
    ],
)
@pytest.mark.parametrize("target", ["run", "plan"])
def test_errors_are_one_line_and_status_2(
    target: str, arguments: list[str], words: list[str], tmp_path: Path
) -> None:
    result = make(target, f"OUT={tmp_path / 'runs'}", *arguments)
    assert result.returncode == 2
    message, made_by_make = result.stderr.strip().splitlines()
    assert message.startswith("error: ")
    assert made_by_make.startswith("make: ***")
    for word in words:
        assert word in message
    assert result.stdout == ""
    assert list(tmp_path.iterdir()) == []


def test_the_packages_of_another_clone_are_refused(tmp_path: Path, echo: Path) -> None:
    (tmp_path / ".venv").mkdir()
    command = ["make", "-f", str(ROOT / "Makefile"), "-o", ".venv/.runtime", f"IN_VENV={echo}"]
    for clone, status in ((tmp_path, 0), (tmp_path / "other", 2)):
        (tmp_path / ".venv" / ".runtime").write_text(f"{clone.resolve()}\n")
        result = subprocess.run(
            [*command, "plan"],
            cwd=tmp_path,
            env=clean_environment(),
            capture_output=True,
            text=True,
            check=False,
        )
        assert result.returncode == status
    assert f"installed for the clone in {tmp_path.resolve() / 'other'}" in result.stderr
    assert "make clean-venv" in result.stderr


def test_a_mistyped_variable_is_refused(tmp_path: Path) -> None:
    result = make("run", f"OUT={tmp_path / 'runs'}", "PROMPT=a chair", "QUALTY=high")
    assert result.returncode == 2
    assert "QUALTY is no variable" in result.stderr
    assert "QUALITY" in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("out", ["README.md", "README.md/runs", "runs\udcff"])
@pytest.mark.parametrize("command", ["run", "plan"])
def test_a_folder_that_cannot_be_made(
    command: str, out: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from pipeline.__main__ import main

    monkeypatch.chdir(ROOT)
    assert main([command], {"PROMPT": "a chair", "OUT": out}) == 2
    message = capsys.readouterr().err
    assert message.startswith("error: OUT is ")
    assert message.count("\n") == 1


@pytest.mark.parametrize("threads", ["0", "-1", "two", "1e3", "2000"])
def test_threads_out_of_range(threads: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from pipeline.__main__ import main

    (tmp_path / "model").mkdir()
    assert main(["run"], {"PROMPT": "x", "MODEL": str(tmp_path / "model"), "THREADS": threads}) == 2
    assert "THREADS" in capsys.readouterr().err


def test_help_names_every_variable_and_every_target_and_nothing_else() -> None:
    text = make("help").stdout
    makefile = (ROOT / "Makefile").read_text()
    joined = makefile.replace("\\\n", " ")
    targets = next(line for line in joined.splitlines() if line.startswith("TARGETS")).split()[2:]
    for target in set(targets) - {"help"}:
        assert f"make {target}" in text
    variables = next(line for line in joined.splitlines() if line.startswith("USER_VARIABLES")).split()[2:]
    for variable in variables:
        assert f"{variable}=" in text


def test_verify_wants_a_finished_run(tmp_path: Path) -> None:
    for arguments in ([], [f"RUN={tmp_path}"]):
        result = make("verify", *arguments)
        assert result.returncode == 2
        assert "RUN" in result.stderr.splitlines()[0]
    (tmp_path / "manifest.json").write_text('{"files": 3}')
    assert "is not a manifest" in make("verify", f"RUN={tmp_path}").stderr
    (tmp_path / "manifest.json").write_text('{"files": {}}')
    assert "names no file" in make("verify", f"RUN={tmp_path}").stderr
