"""Checks a finished run against its manifest."""

import json
from pathlib import Path

from pipeline.errors import InputError
from pipeline.files import file_sha256


def verify(run: Path) -> tuple[int, list[str]]:
    """Return how many files the manifest names, and for each that differs its name and what is wrong.

    Raises:
        InputError: there is no manifest, or it is not one.
    """
    path = run / "manifest.json"
    try:
        files = json.loads(path.read_text(encoding="utf-8"))["files"]
        expected = {str(name): str(facts["sha256"]) for name, facts in files.items()}
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror}): RUN= takes the folder of a finished run"
        ) from None
    except (ValueError, KeyError, TypeError, AttributeError):
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
