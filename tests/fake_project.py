"""The project with stages that take no time: real front door, Snakefile, contract and report.

Every fake writes a digest of its options and inputs, so that outputs change exactly when they should.
`train_nerf` counts up in its scratch folder, slowly if told so, and gets killed. What a fake does can be
changed by files in its folder: `fail-<stage>` holds "input" or "fault", `slow` seconds a step.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from tests.tiny_bundle import write_tiny_bundle

ROOT = Path(__file__).resolve().parents[1]
RUN_STAGES = ["embed", "train_nerf", "extract", "clean", "unwrap", "bake", "publish", "report"]
STEPS = 40

FAKE = """
import hashlib, json, sys, time
from pathlib import Path
from pipeline.errors import InputError
from pipeline.files import path_sha256
from pipeline.run.chain import stage_options
from pipeline.run.stage import Context, Progress, execute, say
from pipeline.stages import tools

NAME = {name!r}
PROJECT = Path(__file__).parents[2]

def main(context: Context) -> None:
    print("chatter of a library")
    say(f"ran {{NAME}}")
    kind = PROJECT / f"fail-{{NAME}}"
    if NAME == "train_nerf":
        slow, done = PROJECT / "slow", context.scratch / "step.checkpoint"
        first = int(done.read_text()) if done.exists() else 0
        context.metrics["resumed_at"] = first
        for step in range(first, {steps}):
            done.write_text(str(step + 1))
            time.sleep(float(slow.read_text()) if slow.exists() else 0)
    if kind.exists():
        for path in context.outputs.values():
            path.write_text("half")
        raise InputError("the moon is full: wait") if kind.read_text() == "input" else KeyError("boom")
    options = stage_options(context.job, NAME)
    digest = hashlib.sha256(json.dumps(options, sort_keys=True).encode())
    for name in sorted(context.inputs):
        digest.update(path_sha256(context.inputs[name]).encode())
    if NAME == "clean":  # the same mesh whatever it is made of
        digest = hashlib.sha256(str(options["clean"]["faces"]).encode())
    for name, path in context.outputs.items():
        path.write_text(f"{{NAME}} {{name}} {{digest.hexdigest()}}")
    context.metrics["warnings"] = ["the word 'zyx' is unknown"] if NAME == "embed" else []

if __name__ == "__main__":
    execute(NAME, main)
"""


class Project:
    """A project in a folder of its own, used as a user would: through make."""

    def __init__(self, root: Path) -> None:
        self.root = root
        shutil.copytree(ROOT / "pipeline", root / "pipeline", ignore=_everything_heavy)
        (root / "pipeline" / "stages" / "tools.py").write_text("UNIT = 1\n")
        for name in [*RUN_STAGES[:-1], "sketch", "refine"]:
            (root / "pipeline" / "stages" / f"{name}.py").write_text(FAKE.format(name=name, steps=STEPS))
        for name in ("Makefile", "pyproject.toml"):
            shutil.copy2(ROOT / name, root / name)
        write_tiny_bundle(root / "onnx_models" / "everyday-objects")

    def command(self, target: str, **variables: str) -> list[str]:
        """Return the make command line; the interpreter of the tests stands for .venv."""
        given = [f"{name}={value}" for name, value in {"IN_VENV": sys.executable, **variables}.items()]
        return ["make", "-o", ".venv/.runtime", target, *given]

    def make(self, target: str, **variables: str) -> "subprocess.CompletedProcess[str]":
        """Run make to its end; variables not given are absent from the environment too."""
        return subprocess.run(
            self.command(target, **variables),
            cwd=self.root,
            env=clean_environment(),
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )

    def start(self, target: str, **variables: str) -> "subprocess.Popen[str]":
        """Start make in a process group of its own."""
        return subprocess.Popen(
            self.command(target, **variables),
            cwd=self.root,
            env=clean_environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def ran(self, result: "subprocess.CompletedProcess[str]") -> list[str]:
        """Return the stages whose work was done in a run, in order (the real report has no marker)."""
        return [line.removeprefix("ran ") for line in result.stderr.splitlines() if line.startswith("ran ")]

    @property
    def latest(self) -> Path:
        return self.root / "runs" / "latest"

    def entry(self, stage: str) -> dict[str, Any]:
        value = json.loads((self.latest / "stages" / f"{stage}.json").read_text())
        assert isinstance(value, dict)
        return value

    def wait_for_step(self, step: int) -> None:
        """Wait until the slow training has reached a step."""
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            found = list(self.root.glob("runs/*/checkpoints/train_nerf/step.checkpoint"))
            if found and (text := found[0].read_text()) and int(text) >= step:
                return
            time.sleep(0.02)
        raise TimeoutError("the training did not get there")


def clean_environment() -> dict[str, str]:
    """Return the environment without what an outer make or test run put there."""
    return {
        name: value
        for name, value in os.environ.items()
        if name
        not in {
            "MAKEFLAGS",
            "MAKELEVEL",
            "MFLAGS",
            "PROMPT",
            "JOB",
            "OUT",
            "MODEL",
            "SEED",
            "QUALITY",
            "SKETCH",
            "SIGMA_S",
            "MESH",
            "PARAM",
            "REFINE",
            "TOKEN",
            "NEGATIVE",
        }
    }


def kill_group(process: "subprocess.Popen[str]") -> None:
    """kill -9 of everything that a command started in its group, and wait."""
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


def _everything_heavy(folder: str, names: list[str]) -> set[str]:
    heavy = {"__pycache__", "scene", "kernels"}
    stages = {
        name for name in names if Path(folder).name == "stages" and name not in {"__init__.py", "report.py"}
    }
    return (heavy & set(names)) | stages
