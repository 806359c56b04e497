"""Starts the server: one on a folder, on this machine's own address unless it is told another."""

import contextlib
import fcntl
import os
import secrets
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import uvicorn

from pipeline.errors import InputError
from pipeline.files import write_text
from pipeline.run.estimate import machine_pace
from pipeline.server.access import LOCAL
from pipeline.server.app import make_app
from pipeline.server.queue import Queue


def serve(out: Path, host: str, port: int, threads: int, profile: str, say: Callable[[str], None]) -> None:
    """Serve until SIGINT or SIGTERM; what runs then goes on with the next start.

    Args:
        out: the folder of the runs.
        host: an address or a name of this machine; anything but its own loopback has visitors asked for a
               token.
        port: 0: any that is free.
        threads: of a stage.
        profile: where stages run.
        say: takes the address, a line.

    Raises:
        InputError: the port is taken, the host is none of this machine, or another server has the folder.
    """
    local = host in LOCAL or host == "::1"
    with _listening(host, port) as listening, _alone(out) as lock:
        token = "" if local else _token(out)
        name = f"[{host}]" if ":" in host else host
        address = f"http://{name}:{listening.getsockname()[1]}/"
        os.ftruncate(lock, 0)
        os.pwrite(lock, f"{address} (process {os.getpid()})".encode(), 0)
        say(f"{address}{f'?token={token}' if token else ''}")
        if token:
            say("others can reach this: give the address and token to whom you trust; it is not encrypted")
        say("Ctrl-C ends it; what was asked for goes on with the next start")
        app = make_app(Queue(out, threads, profile, machine_pace()), token)
        config = uvicorn.Config(
            app,
            log_level="warning",
            limit_concurrency=200,
            timeout_keep_alive=10,
            timeout_graceful_shutdown=5,
            server_header=False,
            proxy_headers=False,
        )
        uvicorn.Server(config).run(sockets=[listening])


def _token(out: Path) -> str:
    """Return the folder's token, the same after every start."""
    path = out / ".server" / "token"
    with contextlib.suppress(OSError):
        if kept := path.read_text(encoding="ascii").strip():
            return kept
    token = secrets.token_urlsafe(24)
    write_text(path, token + "\n")
    path.chmod(0o600)
    return token


@contextlib.contextmanager
def _listening(host: str, port: int) -> Iterator[socket.socket]:
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(
            host.strip("[]"), port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        made = socket.socket(family, kind, protocol)
    except OSError as error:
        raise InputError(f"HOST {host!r} is no address of this machine ({error.strerror or error})") from None
    with made:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            made.bind(place)
        except OSError as error:
            raise InputError(
                f"HOST={host} PORT={port} cannot be listened on ({error.strerror}): "
                "choose another PORT, or 0 for any that is free"
            ) from None
        yield made


@contextlib.contextmanager
def _alone(out: Path) -> Iterator[int]:
    """Hold the folder for this server; the kernel drops the lock when it ends."""
    folder = out / ".server"
    folder.mkdir(parents=True, exist_ok=True)
    lock = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(lock, 200).decode(errors="replace").strip()
            raise InputError(
                f"{out} is served already, at {holder or 'another address'}: use it, or say OUT=another"
            ) from None
        yield lock
    finally:
        os.close(lock)
