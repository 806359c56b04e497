"""The front door as a stranger uses it, and what must hold whatever is handed in."""

import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from pipeline.files import path_sha256
from tests.fake_project import ROOT, clean_environment
from tests.tiny_bundle import write_tiny_bundle

JOB = """
train_nerf: {steps: 6, cameras_per_step: 1, samples_per_ray: 16, checkpoint_every: 2}
refinement: {fit_steps: 2, steps: 4, cameras_per_step: 1}
extract: {resolution: 32, views: 4}
clean: {faces: 300}
unwrap: {resolution: 128, padding: 2}
bake: {views: 4, texture: 128}
prepare: {resolution: 128}
start_fit: {views: 4, steps: 6, cells: 24}
train_paint: {steps: 4, cameras_per_step: 1, texture: 64, views: 8, checkpoint_every: 2}
bake_paint: {views: 4, texture: 128}
publish: {preview_size: 48, turntable_size: 48, turntable_frames: 4}
"""
SECONDS, BYTES = 60, 2 << 30
"""What one wrong input may cost, of processor time and of memory."""


class Answer(NamedTuple):
    """How a command ended."""

    status: int
    stdout: str
    stderr: str

    @property
    def error(self) -> str:
        """The line that says what is wrong."""
        lines = [line for line in self.stderr.splitlines() if line.startswith("error: ")]
        assert len(lines) == 1, self.stderr
        return lines[0]


class Door:
    """A folder with a tiny model and a small job; what is handed in lies in `given`."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.given, self.out = folder, folder / "given", folder / "out"
        self.given.mkdir(parents=True)
        write_tiny_bundle(folder / "model")
        (folder / "job.yaml").write_text(JOB)

    def command(self, target: str, **variables: str) -> list[str]:
        """Return the make command line; paths are as a user in `folder` writes them."""
        usual = {"PROMPT": "a red ball", "MODEL": "./model", "JOB": "job.yaml", "OUT": "out"}
        given = {**(usual if target in ("run", "plan") else {}), **variables, "IN_VENV": sys.executable}
        return [
            "make", "-f", str(ROOT / "Makefile"), "-o", ".venv/.runtime", "-o", ".venv/.dev", target,
            *(f"{name}={value}" for name, value in given.items()),
        ]  # fmt: skip

    def ask(self, target: str, environment: dict[str, str] | None = None, **variables: str) -> Answer:
        """Give a command and return how it ended."""
        ended = subprocess.run(
            self.command(target, **variables),
            cwd=self.folder,
            env=self.environment() | (environment or {}),
            capture_output=True,
            text=True,
            errors="replace",
            preexec_fn=_limit,
            check=False,
        )
        return Answer(ended.returncode, ended.stdout, ended.stderr)

    def refused(self, target: str, *words: str, **variables: str) -> str:
        """Give a command that has to be refused, in one line with these words; nothing of the user's changes.
        Return the line."""
        before = path_sha256(self.given), path_sha256(self.folder / "model")
        answer = self.ask(target, **variables)
        assert answer.status == 2, answer.stderr
        assert "Traceback" not in answer.stderr
        for word in words:
            assert word in answer.error
        assert before == (path_sha256(self.given), path_sha256(self.folder / "model"))
        assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024 < BYTES
        assert not list(self.folder.rglob("executed")), "something was executed"
        return answer.error

    @staticmethod
    def environment() -> dict[str, str]:
        """Return the environment of the commands."""
        return clean_environment() | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}


def _limit() -> None:
    os.setsid()
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
