"""What makes a shell complete verbs, options, their choices, and files."""

import argparse
import typing
from typing import Literal

import shtab

from pipeline.options.job import Job

FILES = frozenset({"JOB", "JOBS", "MESH", "SKETCH", "TOKEN", "CHECKPOINT", "START"})
FOLDERS = frozenset({"OUT", "RUN", "IMAGES"})


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return the script that a shell reads; `parser` is changed, and not for parsing any more."""
    hints = {name.upper(): hint for name, hint in typing.get_type_hints(Job).items()}
    for commands in parser._subparsers._group_actions if parser._subparsers else ():
        for sub in typing.cast("dict[str, argparse.ArgumentParser]", commands.choices).values():
            for action in sub._actions:
                name = action.metavar if action.dest == "given" else action.dest
                if action.dest == "given":
                    action.help = ""
                if name in FILES:
                    action.complete = shtab.FILE  # type: ignore[attr-defined]
                elif name in FOLDERS:
                    action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
                elif typing.get_origin(hints.get(str(name))) is Literal:
                    action.choices = typing.get_args(hints[str(name)])
                elif name == "MODEL":
                    action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
    return str(shtab.complete(parser, shell))
