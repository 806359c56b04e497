"""How large a mesh that a user gives may be."""

from pathlib import Path

from pipeline.errors import InputError

MOST_FACES = 5_000_000


def check_count(faces: int, path: Path) -> None:
    """Raise InputError for more faces than the mesh in a file may have."""
    if faces > MOST_FACES:
        raise InputError(f"{path}: {faces} faces, expected at most {MOST_FACES}; decimate the mesh first")
