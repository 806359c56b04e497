"""Every command of the README and of the pages that it leads to is one that the program takes."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from tests.fake_project import ROOT, clean_environment
from tests.tiny_bundle import write_tiny_bundle

GIVEN = {"TOKEN": "tokens/mine.safetensors", "CHECKPOINT": "path/to/checkpoint"}
"""Files of the reader's own, as the README calls them."""
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
TESTED = {
    "make export": "tests/export/test_export_checkpoint.py",
    "make learn-token": "tests/export/test_learn_token.py",
    "make help": "tests/test_front_door.py",
    "make test": "tests/conftest.py",
    "make sweep": "tests/run/test_sweep.py",
    "pip install": "tests/test_wheel.py",
    "latent-nerf run": "tests/test_wheel.py",
    ".venv/bin/python -m": "tests/nerf/test_field.py",
    ".venv/bin/ruff check": "tests/test_imports.py",
}
"""Commands that take minutes or change things, and what runs them instead."""


def commands() -> list[list[str]]:
    """Return the commands of all shell blocks, as words."""
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    blocks = re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines() if line.strip()]
    return [shlex.split(line) for line in dict.fromkeys(lines)]


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 1200


def test_links_lead_somewhere() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_the_readme_has_commands() -> None:
    kinds = {" ".join(command[:2]) for command in commands()}
    assert {"make run", "make help", "make export", "make test"} <= kinds
    assert kinds - {"make run"} <= set(TESTED), "a command that no test runs"
    assert all((ROOT / path).is_file() for path in TESTED.values())


@pytest.mark.parametrize("command", [c for c in commands() if c[:2] == ["make", "run"]], ids=" ".join)
def test_a_run_of_the_readme_can_be_planned(command: list[str], tmp_path: Path) -> None:
    """The plan reads all that the run reads: options, paths, tokens, the model."""
    arguments = [*command[2:], f"OUT={tmp_path / 'runs'}"]
    for name in GIVEN:
        if f"{name}={GIVEN[name]}" in arguments:
            file = tmp_path / Path(GIVEN[name]).name
            save_file({"<mine>": np.zeros((1, 8), np.float32)}, file)
            arguments[arguments.index(f"{name}={GIVEN[name]}")] = f"{name}={file}"
    if "START=runs/latest" in arguments:
        (tmp_path / "before").mkdir()
        (tmp_path / "before" / "job.yaml").write_text("prompt: a red armchair\n")
        (tmp_path / "before" / "field.npz").write_bytes(b"a field")
        arguments[arguments.index("START=runs/latest")] = f"START={tmp_path / 'before'}"
    if "MODEL=my-model" in arguments:
        write_tiny_bundle(tmp_path / "my-model", latent_size=8)
        arguments[arguments.index("MODEL=my-model")] = f"MODEL={tmp_path / 'my-model'}"
    result = subprocess.run(
        ["make", "-o", ".venv/.runtime", "plan", f"IN_VENV={sys.executable}", *arguments],
        cwd=ROOT, env=clean_environment(), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "not made yet" in result.stdout
