"""The queue of jobs: on disk before it is in memory, one run at a time, in the folders of the command line.

A job is known by the name of its run's folder. What the server keeps of it is one JSON file and the job's
       YAML;
what a run makes is where `make run` would have made it, under the same lock. A server that is killed takes
the run with it, and the next one goes on where that was.
"""

import asyncio
import contextlib
import json
import os
import re
import signal
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pipeline.diffusion.bundle import open_bundle
from pipeline.documents import parse_object
from pipeline.errors import InputError
from pipeline.files import write_text
from pipeline.options import job as jobs
from pipeline.options.job import Job
from pipeline.options.models import bundle_folder
from pipeline.progress import EVERY
from pipeline.run.chain import stages_of
from pipeline.run.estimate import price
from pipeline.run.stage import die_with_parent
from pipeline.run.stage_server import GRACE
from pipeline.server.progress import Progress

State = Literal["queued", "running", "stopped", "done", "failed"]
MOST = 500
"""Jobs that may wait."""
PROGRAM = "from pipeline.__main__ import console; console()"
END = GRACE + 10
"""What a run that is told to end may take for it [seconds]."""


@dataclass
class Asked:
    """A job that somebody asked for."""

    name: str
    """Of its run's folder."""
    job: Job
    state: State
    number: int
    """The order in which they were asked for."""
    reason: str = ""
    """Why it failed."""
    progress: Progress = field(default_factory=lambda: Progress({}))
    began: float = 0.0
    """When its run began [seconds of the monotonic clock]."""


class Queue:
    """All jobs that were asked for here. Its methods are called in one thread, that of the event loop."""

    def __init__(self, out: Path, threads: int, profile: str, pace: float) -> None:
        """Read what an earlier server left.

        Args:
            out: the folder of the runs; `out`/.server is the server's own.
            threads: of a stage.
            profile: where stages run.
            pace: of this machine, see `machine_pace`.
        """
        self.out, self.threads, self.profile, self.pace = out, threads, profile, pace
        self.folder = out / ".server" / "jobs"
        self.folder.mkdir(parents=True, exist_ok=True)
        self.asked: dict[str, Asked] = {}
        self.running: asyncio.subprocess.Process | None = None
        self.stopping: set[str] = set()
        self.more = asyncio.Event()
        for path in sorted(self.folder.glob("*.json")):
            with contextlib.suppress(OSError, ValueError, KeyError, InputError):
                self._restore(path)

    def _restore(self, path: Path) -> None:
        kept = parse_object(path.read_bytes())
        job = jobs.load(path.with_suffix(".yaml"))
        state: State = "queued" if kept["state"] == "running" else kept["state"]
        self.asked[path.stem] = self._with_costs(
            Asked(path.stem, job, state, int(kept["number"]), str(kept.get("reason", "")))
        )

    def _with_costs(self, asked: Asked) -> Asked:
        with contextlib.suppress(InputError):  # a model that is gone: the run will say so
            asked.progress = Progress(self.seconds_of(asked.job))
        return asked

    def seconds_of(self, job: Job) -> dict[str, float]:
        """Return what each stage of a job is estimated to take [seconds]."""
        bundle = open_bundle(bundle_folder(job.model), verify=False)
        costs = price(job, bundle, [stage.name for stage in stages_of(job)], self.pace)
        return {name: cost.seconds for name, cost in costs.items()}

    def ask(self, job: Job) -> Asked:
        """Put a job into the queue, or back into it where it stopped or failed; what runs or is done stays.

        Raises:
            InputError: the queue is full, or the model cannot work.
        """
        name = jobs.run_name(job)
        former = self.asked.get(name)
        if former and former.state in ("queued", "running"):
            return former
        if sum(one.state == "queued" for one in self.asked.values()) >= MOST:
            raise InputError(f"{MOST} jobs are waiting: ask again when some are done")
        number = 1 + max((one.number for one in self.asked.values()), default=0)
        asked = Asked(name, job, "queued", number, progress=Progress(self.seconds_of(job)))
        write_text(self.folder / f"{name}.yaml", jobs.to_yaml(job))
        self.asked[name] = asked
        self._keep(asked)
        self.more.set()
        return asked

    def stop(self, name: str) -> None:
        """Take a job out of the queue, or end its run; what it has made stays, and `ask` goes on from
        there.
        """
        asked = self.asked[name]
        if asked.state == "queued":
            self._become(asked, "stopped")
        elif asked.state == "running":
            self.stopping.add(name)
            self._end_run()

    def _become(self, asked: Asked, state: State, reason: str = "") -> None:
        asked.state, asked.reason = state, reason
        self._keep(asked)

    def _keep(self, asked: Asked) -> None:
        kept = {"state": asked.state, "number": asked.number, "reason": asked.reason}
        write_text(self.folder / f"{asked.name}.json", json.dumps(kept) + "\n")

    async def work(self) -> None:
        """Run what is asked for, one after the other, for ever; cancelled, end the run and leave it
        queued.
        """
        while True:
            waiting = sorted(
                (one for one in self.asked.values() if one.state == "queued"), key=lambda o: o.number
            )
            if not waiting:
                self.more.clear()
                await self.more.wait()
                continue
            await self._run(waiting[0])

    async def _run(self, asked: Asked) -> None:
        self._become(asked, "running")
        asked.progress, asked.began = Progress(asked.progress.seconds), time.monotonic()
        words = {
            "JOB": self.folder / f"{asked.name}.yaml",
            "OUT": self.out,
            "THREADS": self.threads,
            "PROFILE": self.profile,
        }
        last = ""
        try:
            self.running = await asyncio.create_subprocess_exec(
                sys.executable, "-c", PROGRAM, "run", *(f"{name}={value}" for name, value in words.items()),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE,
                env={**os.environ, EVERY: "0.5"},
                start_new_session=True,  # Ctrl-C in the terminal is for the server, which ends the run itself
                preexec_fn=die_with_parent,
            )  # fmt: skip
            assert self.running.stderr is not None
            while raw := await _line(self.running.stderr):
                line = raw.decode("utf-8", "replace").strip()
                asked.progress.hear(line)
                last = line or last
            code = await self.running.wait()
        except asyncio.CancelledError:
            await self._ended()
            self._become(asked, "queued")
            raise
        finally:
            self.running = None
        if asked.name in self.stopping:
            self.stopping.discard(asked.name)
            self._become(asked, "done" if code == 0 else "stopped")
        elif code == 0:
            self._become(asked, "done")
        else:
            reason = last.removeprefix("error: ")
            self._become(asked, "failed", reason or f"the run ended with status {code}")

    def _end_run(self) -> None:
        if self.running is not None and self.running.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                self.running.send_signal(signal.SIGTERM)

    async def _ended(self) -> None:
        """End the run and wait for it, not for ever."""
        if self.running is None:
            return
        self._end_run()
        try:
            await asyncio.wait_for(self.running.wait(), END)
        except TimeoutError:
            self.running.kill()
            await self.running.wait()


async def _line(stream: asyncio.StreamReader) -> bytes:
    """Return the next line; of one that is longer than the buffer, a part."""
    try:
        return await stream.readline()
    except ValueError:
        return b"\n"


def is_name(text: str) -> bool:
    """Say whether a text can be the name of a run's folder."""
    return bool(re.fullmatch(r"[a-z0-9][a-z0-9-]{0,80}", text))
