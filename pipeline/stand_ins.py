"""What is found in the place of a file that was not really fetched: a Git LFS pointer, a web page."""

from pathlib import Path

from pipeline.errors import InputError


def check_fetched(path: Path, expected: str) -> None:
    """Raise InputError for a file that is one of these; `expected` is what it should be ("an ONNX model")."""
    with path.open("rb") as file:
        head = file.read(512)
    if head.startswith(b"version https://git-lfs"):
        raise InputError(
            f"{path}: a Git LFS pointer, expected {expected}; run `git lfs pull` in its repository"
        )
    if head.lstrip().lower().startswith((b"<!doctype", b"<html")):
        raise InputError(f"{path}: a web page, expected {expected}; download the file itself, not its page")
