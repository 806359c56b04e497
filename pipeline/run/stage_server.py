"""Stages without the seconds that each would spend on importing torch, scipy and numba.

`serve` is one process that imports what the stages of a run need, once, while Snakemake starts and the first
stages run, and forks itself for every stage. A stage is called as
``python -m pipeline.run.stage_server <name> --job ...``: this hands descriptors, folder, environment and
arguments to the server that `ADDRESS` names, and ends as the fork ends. Where nobody serves (on a cluster,
say) it becomes ``python -m pipeline.stages.<name>``, which does the same.

SIGTERM ends the server, and first its stages: a training leaves a checkpoint within `GRACE`.

The server has no threads that a fork would lose: libraries start theirs with their first work, and OpenBLAS
stops its own around a fork.
"""

import contextlib
import importlib
import json
import math
import os
import select
import signal
import socket
import sys
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple, NoReturn

ADDRESS = "PIPELINE_WARM"
"""Environment variable with the path of the server's socket."""
LATE = ("trimesh", "skimage.measure")
"""What stages import as they go along."""
TICK = 0.02
"""How often the server looks for ended stages [seconds]."""
GRACE = 5.0
"""What a stage that is told to end may take for it [seconds]: a step and a checkpoint."""


def call(name: str, arguments: Sequence[str]) -> int:
    """Run a stage in a fork of the server, or in this process's place; return its exit status."""
    with socket.socket(socket.AF_UNIX) as connection:
        try:
            connection.connect(os.environ[ADDRESS])
        except (KeyError, OSError):
            _replace_by(name, arguments)
        request = {"stage": name, "arguments": arguments, "folder": os.getcwd()}
        message = json.dumps({**request, "environment": dict(os.environ)}).encode()
        socket.send_fds(connection, [len(message).to_bytes(8, "big")], [0, 1, 2])
        connection.sendall(message)
        parent = os.getppid()
        while not select.select([connection], [], [], 1.0)[0]:
            if os.getppid() != parent:  # Snakemake was killed: leave, so that the server ends the stage
                return 1
        try:
            answer = connection.recv(1)
        except ConnectionResetError:  # the server was killed
            answer = b""
    return answer[0] if answer else 1


def _replace_by(name: str, arguments: Sequence[str]) -> NoReturn:
    """Become the stage, in a process that has imported nothing."""
    os.execv(sys.executable, [sys.executable, "-m", f"pipeline.stages.{name}", *arguments])


class Running(NamedTuple):
    """A stage in a fork of the server."""

    caller: socket.socket
    until: float
    """When it is killed if it has not ended [seconds of the monotonic clock]."""


def serve(address: Path, stages: Sequence[str]) -> None:
    """Import the stages' modules, and fork one process a request meanwhile and after, until told to end.

    A stage whose caller is gone is told to end, at the latest after the import that goes on then: it would
    write where another run may begin.
    """
    left = [*(f"pipeline.stages.{stage}" for stage in stages), *LATE]
    running: dict[int, Running] = {}
    # Ctrl-C reaches all processes of a terminal: who started the server says what is to end, and how.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    told: list[int] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        told.append(number)  # what a library that is being imported may catch
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)
    with contextlib.suppress(KeyboardInterrupt), socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(address))
        listening.listen()
        while not told:
            if left:
                _import(left.pop(0))
            callers = {process: one.caller for process, one in running.items() if one.until == math.inf}
            patience = 0 if left else TICK if running else None
            ready = select.select([listening, *callers.values()], [], [], patience)[0]
            for process, caller in callers.items():
                if caller in ready:
                    _end(running, process)
            _reap(running)
            if listening in ready:
                caller, _ = listening.accept()
                if process := _fork(caller, [listening, caller, *(one.caller for one in running.values())]):
                    running[process] = Running(caller, math.inf)
    for process in running:
        _end(running, process)
    while running:
        time.sleep(TICK)
        _reap(running)


def _end(running: dict[int, Running], process: int) -> None:
    """Tell a stage to end."""
    if running[process].until == math.inf:
        running[process] = running[process]._replace(until=time.monotonic() + GRACE)
        os.kill(process, signal.SIGTERM)


def _reap(running: dict[int, Running]) -> None:
    """Tell callers of stages that have ended, and end those whose time is over."""
    for process, (caller, until) in list(running.items()):
        if over := time.monotonic() > until:
            os.kill(process, signal.SIGKILL)
        ended, status = os.waitpid(process, 0 if over else os.WNOHANG)
        if ended:
            code = os.waitstatus_to_exitcode(status)
            with contextlib.suppress(OSError):
                caller.sendall(bytes([code if code >= 0 else 128 - code]))
            caller.close()
            del running[process]


def _import(module: str) -> None:
    """Import a module, and have ready what came with it and what its key is made of."""
    with contextlib.suppress(Exception):  # the stage itself will say what is wrong
        importlib.import_module(module)
        if module.startswith("pipeline."):
            importlib.import_module("pipeline.run.staleness").code(module)
    if "numba" in sys.modules:  # half a second that its first call of a kernel would take
        sys.modules["numba.core.registry"].cpu_target.target_context.refresh()


def _fork(caller: socket.socket, sockets: Sequence[socket.socket]) -> int:
    """Start the stage that a caller asks for, without the server's sockets; return its process, or 0 when
    the caller was gone.
    """
    head, descriptors, _, _ = socket.recv_fds(caller, 8, 3)
    text = b""
    while head and len(text) < int.from_bytes(head, "big"):
        if not (part := caller.recv(1 << 16)):
            break
        text += part
    if not head or len(text) < int.from_bytes(head, "big"):
        for descriptor in descriptors:
            os.close(descriptor)
        caller.close()
        return 0
    request = json.loads(text)
    _import(f"pipeline.stages.{request['stage']}")
    # A SIGTERM that met the fork with the server's handler would make a second server of it.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    process = os.fork()
    if process == 0:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    if process == 0:
        for own in sockets:
            own.close()
        _become(request, descriptors)
    for descriptor in descriptors:
        os.close(descriptor)
    return process


def _become(request: dict[str, Any], descriptors: Sequence[int]) -> NoReturn:
    """Be the stage, in the fork."""
    status = 1
    try:
        for standard, descriptor in enumerate(descriptors):
            os.dup2(descriptor, standard)
            os.close(descriptor)
        os.chdir(request["folder"])
        os.environ.clear()
        os.environ.update(request["environment"])
        module = f"pipeline.stages.{request['stage']}"
        sys.argv = [module, *request["arguments"]]
        importlib.import_module("pipeline.run.stage").execute(
            request["stage"], importlib.import_module(module).main
        )
        status = 0
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)  # not the server's own end


if __name__ == "__main__":
    if sys.argv[1] == "--serve":
        serve(Path(sys.argv[2]), sys.argv[3:])
        os._exit(0)  # its modules take a second to be taken down, and the run waits for that
    else:
        sys.exit(call(sys.argv[1], sys.argv[2:]))
