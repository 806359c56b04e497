"""A run of latent-nerf beside Blender: start it, hear it, end it. Nothing here needs Blender."""

import os
import queue
import re
import shutil
import signal
import subprocess
import threading
from pathlib import Path

_COUNT = re.compile(r"(\w+): (\d+)/(\d+) (\w+)(?:, (.*? left))?")
_BEGUN = re.compile(r"(\w+) \.\.\.$")


class ProgramMissing(Exception):
    """There is no latent-nerf where the preferences say."""


def program_command(place: str) -> list[str]:
    """Return the command that starts latent-nerf.

    Args:
        place: the program, a clone of the repository whose `.venv` is installed, or "" for what PATH has.

    Raises:
        ProgramMissing: there is none.
    """
    path = Path(place).expanduser() if place else None
    if path is not None and path.is_dir():
        for python in (path / ".venv" / "bin" / "python", path / ".venv" / "Scripts" / "python.exe"):
            if python.is_file():
                return [str(python), "-c", "from pipeline.__main__ import console; console()"]
        raise ProgramMissing(f"{path} has no .venv: give `make run` there once, or choose the program itself")
    if path is not None and path.is_file():
        return [str(path)]
    if path is None and (found := shutil.which("latent-nerf")):
        return [found]
    raise ProgramMissing(f"{place or 'latent-nerf'} is not there: choose it in the extension's preferences")


class Job:
    """One run. `poll` is to be called now and then; it never waits."""

    def __init__(self, command: list[str], variables: dict[str, str], folder: Path) -> None:
        """Start it.

        Args:
            command: see `program_command`.
            variables: as make has them: PROMPT, MESH and the others; OUT too.
            folder: where it works.
        """
        # Blender's own Python must not reach the program's.
        clean = {
            name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "BLENDER"))
        }
        self.process = subprocess.Popen(
            [*command, "run", *(f"{name}={value}" for name, value in variables.items())],
            cwd=folder,
            env={**clean, "PIPELINE_PROGRESS_SECONDS": "0.5"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            start_new_session=os.name == "posix",
        )
        self.folder = folder
        self.lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.printed: list[str] = []
        self.message = "starting"
        """What it does, for a person."""
        self.share = 0.0
        """Of the running stage, in [0, 1]."""
        self.cancelled = False
        self._last = ""
        self._threads = [
            threading.Thread(target=self._read, args=(self.process.stderr, self.lines.put), daemon=True),
            threading.Thread(target=self._read, args=(self.process.stdout, self.printed.append), daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @staticmethod
    def _read(stream, put) -> None:
        for line in stream:
            put(line.strip())

    def poll(self) -> bool:
        """Take what it has said; return whether it has ended."""
        ended = self.process.poll() is not None
        if ended:
            for thread in self._threads:
                thread.join(5)
        while not self.lines.empty():
            line = self.lines.get()
            self._last = line or self._last
            if match := _COUNT.match(line):
                self.share = int(match[2]) / max(int(match[3]), 1)
                self.message = f"{match[1]}: {match[2]} of {match[3]} {match[4]}" + (
                    f", {match[5]}" if match[5] else ""
                )
            elif match := _BEGUN.match(line):
                self.share, self.message = 0.0, match[1]
        return ended

    @property
    def asset(self) -> Path | None:
        """The asset of a run that ended well."""
        found = [self.folder / line for line in self.printed if line.endswith("asset.glb")]
        return found[-1] if self.process.poll() == 0 and found else None

    @property
    def error(self) -> str:
        """Why there is none; empty while it runs, and when it was cancelled."""
        if self.process.poll() in (None, 0) or self.cancelled:
            return ""
        return self._last.removeprefix("error: ") or f"it ended with status {self.process.returncode}"

    def cancel(self) -> None:
        """Have it stop; the same run goes on from there when it is started again."""
        self.cancelled = True
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
