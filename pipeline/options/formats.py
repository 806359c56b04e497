"""The files that an asset can have beside GLB and OBJ."""

import importlib.util

from pipeline.errors import InputError

FORMATS = ("ply", "stl", "3mf", "usdz")
NEEDED = {"usdz": ("pxr", "usd-core")}
"""The module and the package of those that the usual installation does not write."""


def asked_formats(text: str) -> tuple[str, ...]:
    """Return the formats of a list with commas, each once and in the order of `FORMATS`.

    Raises:
        InputError: a word that is none of them.
    """
    words = [word.strip().lower() for word in text.split(",") if word.strip()]
    for word in words:
        if word not in FORMATS:
            raise InputError(
                f"formats is {text[:60]!r}: {word[:20]!r} is no format; expected some of "
                f"{', '.join(FORMATS)}, with commas between them (GLB and OBJ are always made)"
            )
    return tuple(name for name in FORMATS if name in words)


def check_installed(*formats: str) -> None:
    """Raise InputError for a format whose package is not installed."""
    for name in formats:
        module, package = NEEDED.get(name, ("", ""))
        if module and importlib.util.find_spec(module) is None:
            raise InputError(
                f"FORMATS names {name}, whose package {package} is not installed: "
                f".venv/bin/python -m pip install {package}, or leave {name} out"
            )
