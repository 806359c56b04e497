"""What a token's file is by its name, its size and its first bytes: checked without torch, before a run."""

from __future__ import annotations

import pickle
import zipfile
from pathlib import Path

from safetensors import SafetensorError, safe_open

from pipeline.errors import InputError

FORMATS = (".safetensors", ".bin", ".pt")
LARGEST_FILE = 64 * 2**20
"""Bytes; a concept takes kilobytes, a checkpoint given by mistake gigabytes."""
_TORCH = (b"PK\x03\x04", pickle.PROTO)
"""What torch's files begin with: an archive, or in old ones a pickle."""


def check_token(path: Path) -> None:
    """Raise InputError for a file that is no learned embedding before its numbers are read."""
    size = path.stat().st_size
    if not 0 < size <= LARGEST_FILE:
        raise InputError(f"TOKEN {path}: {size} bytes, expected a learned embedding of a few kilobytes")
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"TOKEN {path}: the ending is {path.suffix!r}, expected {' or '.join(FORMATS)}")
    if path.suffix.lower() != ".safetensors":
        with path.open("rb") as stream:
            head = stream.read(8)
        if not head.startswith(_TORCH):
            raise InputError(f"TOKEN {path}: no readable torch file (it begins with {head!r}); copy it again")
        if head.startswith(_TORCH[0]):
            _check_archive(path, size)
        return
    try:
        with safe_open(path, framework="numpy"):
            pass
    except (SafetensorError, ValueError, KeyError, RuntimeError, OSError) as error:
        said = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(f"TOKEN {path}: no readable safetensors file ({said}); copy it again") from None


def _check_archive(path: Path, size: int) -> None:
    """torch writes its archives unpacked; a packed one may hold a thousand times its size."""
    try:
        with zipfile.ZipFile(path) as archive:
            held = sum(member.file_size for member in archive.infolist())
    except (zipfile.BadZipFile, ValueError, NotImplementedError, EOFError, OSError) as error:
        said = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(f"TOKEN {path}: no readable torch file ({said}); copy it again") from None
    if held > size:
        raise InputError(f"TOKEN {path}: holds {held} bytes packed into {size}; learn or export it again")
