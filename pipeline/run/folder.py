"""The folder of a run as a place: what may stand in it, who works in it, and which one `latest` is.

A folder may hold anything by the time it is used again. Nothing of it is followed that is a link, and nothing
is emptied that is not ours.
"""

import contextlib
import fcntl
import os
import shutil
import stat
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline.errors import InputError

FOLDERS = ("logs", "stages", "checkpoints")
_WORD = 20
"""A lock holds the number of a process [bytes]."""


def check_out(text: str) -> Path:
    """Return the folder that OUT names, where it is a folder or can become one."""
    otherwise = "choose another folder with OUT="
    try:
        text.encode()
    except UnicodeEncodeError:
        raise InputError(f"OUT is {text!r}, expected a path in UTF-8: {otherwise}") from None
    if os.path.lexists(text) and not os.path.exists(text):
        raise InputError(f"OUT is {text!r}, a link to {os.readlink(text)!r}, which is not there: {otherwise}")
    nearest = next(path for path in (Path(text).absolute(), *Path(text).absolute().parents) if path.exists())
    if not nearest.is_dir():
        raise InputError(f"OUT is {text!r}, but {nearest} is a file: {otherwise}")
    if not os.access(nearest, os.W_OK):
        raise InputError(f"OUT is {text!r}, but {nearest} cannot be written to: {otherwise}")
    if not shutil.disk_usage(nearest).total:  # /proc and its like, whatever their permissions say
        raise InputError(f"OUT is {text!r}, but {nearest} is no place for files: {otherwise}")
    return Path(text)


def check_places(run: Path, outputs: Sequence[str]) -> None:
    """Refuse a run's folder in which something stands where a file or a folder of ours has to be.

    Args:
        run: need not exist.
        outputs: files that the stages write, relative to it.

    Raises:
        InputError: what stands where, and what was expected.
    """
    _check_folder(run)
    folders = [run / name for name in FOLDERS]
    folders += [path for path in _inside(run / "checkpoints") if not path.name.startswith(".")]
    for path in folders:
        if os.path.lexists(path) and _kind(path) != "a folder":
            raise InputError(f"{path} is {_kind(path)}, expected a folder of the run: move it away")
    ours = [run / "job.yaml", *(run / name for name in outputs)]
    for path in [*ours, *_inside(run / "logs"), *_inside(run / "stages")]:
        if os.path.lexists(path) and _kind(path) not in ("a file", "a link"):
            raise InputError(f"{path} is {_kind(path)}, expected a file of the run: move it away")


def date_back(run: Path) -> None:
    """Date the files of a run that are from the future, as after a clock was set back, to now: Snakemake
    fails where what it has made is older than what it was made from."""
    now = time.time()
    for path in [*_inside(run), *_inside(run / "stages")]:
        if _kind(path) == "a file" and path.stat().st_mtime > now:
            os.utime(path)


@contextlib.contextmanager
def locked(run: Path) -> Iterator[None]:
    """Hold the run's folder for this process and its forks: the kernel drops the lock when all have ended.

    Raises:
        InputError: the folder cannot be made or is a link, another process holds it, or its `.lock` is not
            ours.
    """
    _check_folder(run)
    try:
        run.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{run} cannot be made ({error.strerror}): choose another folder with OUT="
        ) from None
    path = run / ".lock"
    foreign = InputError(f"{path} is {_kind(path)}, expected the lock of this run: move it away")
    if os.path.lexists(path) and _kind(path) != "a file":
        raise foreign
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o644)
    try:
        facts, held = os.fstat(descriptor), os.read(descriptor, _WORD + 1)
        if facts.st_nlink > 1 or len(held) > _WORD or held.strip(b"0123456789\n"):
            raise foreign
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = held.decode("ascii").strip() or "unknown"
            raise InputError(
                f"{run} is being made by another run (process {holder}): wait for it to end, "
                "or stop it, then give the same command again"
            ) from None
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, str(os.getpid()).encode(), 0)
        yield
    finally:
        os.close(descriptor)


def remove_socket(path: Path) -> None:
    """Remove a socket that an earlier run left; anything else in its place is not ours."""
    if os.path.lexists(path):
        if _kind(path) != "a socket":
            raise InputError(f"{path} is {_kind(path)}, expected a socket of this run: move it away")
        path.unlink()


def point_latest(run: Path) -> None:
    """Make `latest` beside the run point to it."""
    latest = run.parent / "latest"
    if latest.is_symlink() or not latest.exists():
        beside = run.parent / f".latest{os.getpid()}"
        beside.symlink_to(run.name)
        os.replace(beside, latest)


def _check_folder(run: Path) -> None:
    if run.is_symlink() or (run.exists() and not run.is_dir()):
        raise InputError(f"{run} is {_kind(run)}, expected a folder: move it away, or say OUT=")


def _inside(folder: Path) -> list[Path]:
    return sorted(folder.iterdir()) if folder.is_dir() and not folder.is_symlink() else []


def _kind(path: Path) -> str:
    """Return what stands at a path; a link is a link wherever it leads."""
    names = {
        stat.S_IFLNK: "a link",
        stat.S_IFDIR: "a folder",
        stat.S_IFREG: "a file",
        stat.S_IFSOCK: "a socket",
        stat.S_IFIFO: "a pipe",
    }
    with contextlib.suppress(OSError):
        return names.get(stat.S_IFMT(path.lstat().st_mode), "a device")
    return "nothing"
