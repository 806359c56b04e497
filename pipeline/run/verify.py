"""Checks a finished run against its manifest."""

from pathlib import Path

from pipeline.documents import read_json
from pipeline.errors import InputError
from pipeline.files import file_sha256


def verify(run: Path) -> tuple[int, list[str]]:
    """Return how many files the manifest names, and for each that differs its name and what is wrong.

    Raises:
        InputError: there is no manifest, or it is not one.
    """
    path = run / "manifest.json"
    if not path.is_file():
        raise InputError(f"{path} does not exist: RUN= takes the folder of a finished run")
    try:
        files = read_json(path, "make the run again")["files"]
        expected = {str(name): str(facts["sha256"]) for name, facts in files.items()}
    except (KeyError, TypeError, AttributeError):
        raise InputError(f"{path} is not a manifest: make the run again") from None
    if not expected:
        raise InputError(f"{path} names no file: make the run again")
    faults = []
    for name, sha256 in sorted(expected.items()):
        file = run / name
        if not file.is_file():
            faults.append(f"{name} is missing")
        elif file_sha256(file) != sha256:
            faults.append(f"{name} differs")
    return len(expected), faults
