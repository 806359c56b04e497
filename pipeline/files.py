"""Files that are either whole or absent, and their checksums."""

import contextlib
import errno
import hashlib
import os
import sys
from pathlib import Path
from typing import BinaryIO

from pipeline.errors import InputError, one_line

REFUSALS = {
    errno.ENOSPC: "no space is left on the device: free some",
    errno.EDQUOT: "the disk quota is used up: free some",
    errno.EFBIG: "the file would exceed the allowed size: raise the limit",
    errno.EROFS: "the file system is read-only: choose another folder with OUT=",
    errno.EACCES: "permission denied: make it readable, or choose another folder with OUT=",
    errno.EPERM: "operation not permitted: choose another folder with OUT=",
    errno.ENAMETOOLONG: "the name is longer than the file system allows: shorten it",
    errno.ENOTDIR: "a file stands where a folder is needed: choose another folder with OUT=",
    errno.EEXIST: "something else stands there: move it away",
    errno.EISDIR: "a folder stands where a file is needed: move it away",
    errno.ELOOP: "a link stands there, which is not followed: replace it by what it points to",
    errno.ENOMEM: "not enough memory: close other programs, or lower QUALITY",
}


def refusal(error: OSError) -> InputError | None:
    """Return the user's view of an error that the machine, not the program, is the reason of; else None."""
    reason = REFUSALS.get(error.errno or 0)
    if reason is None:
        return None
    return InputError(f"{error.filename or 'writing'}: {reason}, then give the same command again")


def say_refusal(error: InputError | OSError) -> None:
    """Print what the user can mend on stderr, as one line that begins with ``error:``.

    Raises:
        OSError: `error` itself, where not the machine but the program is its reason.
    """
    told = refusal(error) if isinstance(error, OSError) else error
    if told is None:
        raise error
    print(f"error: {one_line(str(told))}", file=sys.stderr)  # noqa: T201


def file_sha256(path: Path) -> str:
    """Return the hexadecimal sha256 of a file's bytes."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def path_sha256(path: Path) -> str:
    """Return the sha256 of a file, or of a folder's relative paths and contents (hidden files apart)."""
    if not path.is_dir():
        return file_sha256(path)
    digest = hashlib.sha256()
    for file in sorted(f for f in path.rglob("*") if f.is_file() and not f.name.startswith(".")):
        digest.update(f"{file.relative_to(path).as_posix()}\0{file_sha256(file)}\n".encode())
    return digest.hexdigest()


def read_at_most(path: Path, most: int) -> bytes:
    """Return a regular file's bytes.

    Raises:
        ValueError: it is no regular file (a device, a pipe: reading may never end) or longer than `most`.
    """
    if not path.is_file():
        raise ValueError("no regular file")
    with path.open("rb") as stream:
        data = stream.read(most + 1)
    if len(data) > most:
        raise ValueError(f"more than {most} bytes")
    return data


def create(path: Path) -> BinaryIO:
    """Open a new file for writing where none, or one of an earlier run, is. What a link points to stays as
    it is: the link goes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(FileNotFoundError):
        path.unlink()
    return os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o644), "wb")


def sync(path: Path) -> None:
    """Force a file, or a folder's directory entries, to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def publish(pairs: list[tuple[Path, Path]]) -> None:
    """Move finished files into place, each atomically: a crash leaves the old or the new bytes."""
    for source, _ in pairs:
        sync(source)
    for source, target in pairs:
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(source, target)
    for folder in {target.parent for _, target in pairs}:
        sync(folder)


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically."""
    partial = path.with_name(f".{path.name}.part{os.getpid()}")
    try:
        with create(partial) as stream:
            stream.write(text.encode("utf-8"))
        publish([(partial, path)])
    finally:
        partial.unlink(missing_ok=True)
