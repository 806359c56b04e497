"""What is typed at the console script is what make would have passed."""

import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.__main__ import COMMANDS, main
from pipeline.cli.arguments import EXAMPLES, POSITIONAL, SHELLS, make_parser, parse, variables_of_make
from pipeline.cli.completion import script
from pipeline.cli.variables import CLONE_ONLY, nearest, verbs
from pipeline.errors import InputError
from tests.fake_project import ROOT


def makefile_words(name: str) -> set[str]:
    """Return the words of a list in the Makefile."""
    joined = (ROOT / "Makefile").read_text().replace("\\\n", " ")
    return set(next(line for line in joined.splitlines() if line.startswith(f"{name} :=")).split()[2:])


@pytest.mark.parametrize(
    ("words", "given"),
    [
        (["run", "a red armchair"], {"PROMPT": "a red armchair"}),
        (["run", "--prompt", "-x", "--seed", "3"], None),
        (["run", "--prompt=-x", "--seed", "3"], {"PROMPT": "-x", "SEED": "3"}),
        (["run", "PROMPT=a = b", "SIGMA_S=0.3"], {"PROMPT": "a = b", "SIGMA_S": "0.3"}),
        (["run", "x=1 $(touch y)"], {"PROMPT": "x=1 $(touch y)"}),
        (["run", "a chair", "--refine"], {"PROMPT": "a chair", "REFINE": "1"}),
        (["run", "a chair", "--refine=0"], {"PROMPT": "a chair", "REFINE": "0"}),
        (["run", "--", "--chair"], {"PROMPT": "--chair"}),
        (["run", "first\nsecond"], {"PROMPT": "first\nsecond"}),
        (["verify", "runs/latest"], {"RUN": "runs/latest"}),
        (["sweep", "six.yaml", "--profile", "slurm"], {"JOBS": "six.yaml", "PROFILE": "slurm"}),
        (["models", "--verify"], {"VERIFY": "1"}),
        (["completion", "zsh"], {"SHELL": "zsh"}),
    ],
)
def test_words_become_variables(words: list[str], given: dict[str, str] | None) -> None:
    if given is None:
        with pytest.raises(InputError):
            parse(words)
    else:
        assert parse(words) == (words[0], given)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["rnu"], "'rnu' is no verb: did you mean run?"),
        (["gallary"], "'gallary' is no verb: did you mean gallery?"),
        (["zzz"], "'zzz' is no verb; there are: run, plan"),
        (["run", "--promt", "x"], "--promt is no option of run: did you mean --prompt?"),
        (["run", "--sigma_s=1"], "--sigma_s is no option of run: did you mean --sigma-s?"),
        (["run", "PROMT=x"], "PROMT is no variable of run: did you mean PROMPT?"),
        (["verify", "SEED=3"], "SEED is no variable of verify; it takes: RUN"),
        (["run", "a", "red", "chair"], "put it in quotes"),
        (["run", "a", "--prompt", "b"], "PROMPT is given twice, 'b' and 'a'"),
        (["run", "--seed"], "expected one argument; see latent-nerf run --help"),
        (["models", "x"], "takes nothing of the kind of 'x'"),
        (["completion", "fish"], "invalid choice"),
    ],
)
def test_errors_are_one_line_that_helps(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words, {}) == 2
    message = capsys.readouterr().err
    assert message.startswith("error: ")
    assert message.count("\n") == 1
    assert said in message


def test_every_target_that_a_user_needs_has_its_verb() -> None:
    targets = makefile_words("TARGETS")
    assert set(verbs()) == targets - CLONE_ONLY - {"help"} | {"completion"}
    assert targets >= CLONE_ONLY
    assert set(COMMANDS) == set(verbs())
    assert set(EXAMPLES) | set(POSITIONAL) <= set(verbs())


def test_every_variable_of_make_belongs_to_a_verb() -> None:
    of_developers = {"ONLY", "MINUTES"}
    assert {v.name for verb in verbs().values() for v in verb.variables} == (
        makefile_words("USER_VARIABLES") - of_developers
    )


def test_make_passes_what_belongs_to_the_verb_and_empty_is_not_given() -> None:
    passed = {"PROMPT": "x", "SEED": "", "RUN": "runs/latest", "HOME": "/root"}
    assert variables_of_make("run", passed) == {"PROMPT": "x"}
    assert variables_of_make("verify", passed) == {"RUN": "runs/latest"}


def test_nearest_knows_case_and_signs() -> None:
    assert nearest("sigmas", ["SIGMA_S", "SEED"]) == ": did you mean SIGMA_S?"
    assert nearest("xyz", ["SIGMA_S", "SEED"]) == ""


@pytest.mark.parametrize("verb", verbs())
def test_help_teaches(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main([verb, "--help"], {})
    assert end.value.code == 0
    text = capsys.readouterr().out
    for variable in verbs()[verb].variables:
        assert variable.option in text
        assert variable.meaning.split()[0] in text
    for line in EXAMPLES.get(verb, "").splitlines():
        assert line.strip() in text


@pytest.mark.parametrize("shell", SHELLS)
def test_shells_complete_verbs_options_and_choices(shell: str, tmp_path: Path) -> None:
    text = script(make_parser(), shell)
    for word in ("sweep", "sigma-s", "draft", "openvino"):
        assert word in text
    if shell == "bash":
        asked = f"{text}\nCOMP_WORDS=(latent-nerf run --quality dr); COMP_CWORD=3\n"
        asked += '_shtab_latent_nerf latent-nerf dr --quality; echo "${COMPREPLY[@]}"\n'
        result = subprocess.run(["bash"], input=asked, text=True, capture_output=True, check=False)
        assert result.stdout.split() == ["draft"], result.stderr


def test_without_a_verb_there_is_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([], {}) == 0
    assert "latent-nerf VERB --help" in capsys.readouterr().out


def test_make_says_what_may_have_been_meant(tmp_path: Path) -> None:
    def make(*words: str) -> str:
        command = ["make", "-f", str(ROOT / "Makefile"), "-o", ".venv/.runtime", *words]
        result = subprocess.run(
            [*command, f"PYTHON={sys.executable}"], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert result.returncode == 2
        return result.stderr

    assert "PROMT is no variable of this project: did you mean PROMPT?" in make("run", "PROMT=a chair")
    assert "prompt is no variable of this project: did you mean PROMPT?" in make("run", "prompt=a chair")
    assert "rnu is no target: did you mean run?" in make("rnu")
    make("run", "a'$(shell touch x)`touch y`=1")
    make("a'`touch x`;touch y")
    assert list(tmp_path.iterdir()) == [], "something was executed"


@pytest.mark.parametrize("verb", ["export", "learn-token"])
def test_what_needs_an_extra_is_told_on_the_command_line_alone(
    verb: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = dict[str, str]()
    monkeypatch.setattr(subprocess, "call", lambda command, env: told.update(env) or 0)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: True)
    for name in ("NAME", "IMAGES", "CHECKPOINT", "TOKEN", "SEED"):
        monkeypatch.setenv(name, "hunter2")
    monkeypatch.setenv("LANGUAGE", "C")
    assert main([verb, "--name", "mine"], {}) == 0
    assert told["NAME"] == "mine"
    assert told["LANGUAGE"] == "C"
    assert "hunter2" not in told.values()
