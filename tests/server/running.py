"""A real server in a process of its own, with a tiny model that makes an asset in seconds."""

import contextlib
import http.client
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from tests.fake_project import ROOT, clean_environment
from tests.tiny_bundle import write_tiny_bundle

START = "from pipeline.__main__ import console; console()"


class Answer(NamedTuple):
    """Of a request."""

    status: int
    body: bytes
    headers: dict[str, str]

    @property
    def json(self) -> Any:
        return json.loads(self.body)


class Server:
    """A server that runs."""

    def __init__(self, process: "subprocess.Popen[str]", address: str) -> None:
        self.process, self.address = process, address
        self.place = urlsplit(address)

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> Answer:
        """Send one request; a mapping is sent as JSON."""
        connection = http.client.HTTPConnection(str(self.place.hostname), self.place.port or 80, timeout=60)
        with contextlib.closing(connection):
            sent = {name.replace("_", "-"): value for name, value in headers.items()}
            if isinstance(body, dict):
                sent.setdefault("content-type", "application/json")
                body = json.dumps(body)
            connection.request(method, path, body, sent)
            answer = connection.getresponse()
            return Answer(answer.status, answer.read(), {k.lower(): v for k, v in answer.getheaders()})

    def wait(self, name: str, *states: str, seconds: float = 240.0) -> dict[str, Any]:
        """Wait until a job is in one of the states, and return it."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            job: dict[str, Any] = self.ask("GET", f"/api/jobs/{name}").json
            if job["state"] in states:
                return job
            time.sleep(0.1)
        raise TimeoutError(f"{name} is {job['state']}: {job}")

    def end(self, number: int = signal.SIGTERM) -> None:
        """Send the server a signal and wait for its end."""
        self.process.send_signal(number)
        self.process.communicate(timeout=60)


def write_model(folder: Path, steps: int = 6) -> None:
    """Write a model that recommends few steps, under the name `tiny` among the models of `folder`."""
    write_tiny_bundle(folder / "tiny", latent_size=16)
    path = folder / "tiny" / "bundle.json"
    described = json.loads(path.read_text())
    described["distillation"] = {"steps": steps, "cameras_per_step": 2, "samples_per_ray": 24}
    path.write_text(json.dumps(described))


@contextlib.contextmanager
def serving(out: Path, models: Path, **options: str) -> Iterator[Server]:
    """Serve a folder on a free port."""
    given = {"OUT": str(out), "PORT": "0", "THREADS": "1", **options}
    process = subprocess.Popen(
        [sys.executable, "-c", START, "serve", *(f"{name}={value}" for name, value in given.items())],
        cwd=ROOT,
        env={**clean_environment(), "LATENT_NERF_MODELS": str(models)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        if not address:
            raise AssertionError(process.communicate()[1])
        server = Server(process, address)
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            with contextlib.suppress(OSError):
                server.ask("GET", "/")
                break
            time.sleep(0.05)
        yield server
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
