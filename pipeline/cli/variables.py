"""What every verb takes, read from help.txt, which `make help` prints: there is no other list.

A section of help.txt is headed ``run and plan take:``; in it, each variable stands as ``NAME=example``,
       then two
spaces, then what it means, over as many lines as it needs. Verbs stand before the first section, as
``make verb NAME=example``.
"""

import difflib
import functools
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

HELP = Path(__file__).parents[1] / "help.txt"
CLONE_ONLY = frozenset({"bench", "default-model", "dist", "fuzz", "test", "clean-venv"})
"""Targets of make that work on the repository itself: an installed program has no verb for them."""
EVERYWHERE = ("OUT", "THREADS", "PROFILE")
"""Of those that `run` takes, what other verbs may take too, where their section's head names them."""
COLUMN = 28
"""Where the meaning of a variable begins."""


@dataclass(frozen=True)
class Variable:
    """A variable of make, and the option of the console script that stands for it."""

    name: str
    example: str
    """What help.txt gives as a value: the default, where there is one."""
    meaning: str

    @property
    def option(self) -> str:
        """As the console script has it, such as --sigma-s."""
        return "--" + self.name.lower().replace("_", "-")


@dataclass(frozen=True)
class Verb:
    """A command."""

    name: str
    meaning: str
    variables: tuple[Variable, ...]


@functools.cache
def verbs(path: Path = HELP) -> dict[str, Verb]:
    """Return the verbs of the console script by name, in the order of the help."""
    head, *sections = re.split(r"\n\n(?=[a-z, -]+ takes?\b[^\n]*:\n)", path.read_text(encoding="utf-8"))
    taken = dict[str, tuple[Variable, ...]]()
    for section in sections:
        title, _, body = section.partition("\n")
        names = re.findall(r"[a-z-]+", re.split(r" takes?\b", title)[0])
        own = _entries(body)
        also = [
            v for v in taken.get("run", ()) if v.name in EVERYWHERE and re.search(rf"\b{v.name}\b", title)
        ]
        for name in names:
            if name != "and":
                taken[name] = (*own, *also)
    shared = {v.name: v for v in taken["run"]}
    taken["options"] = (shared["MODEL"],)
    taken["gallery"] = (shared["OUT"],)
    taken["doctor"] = (shared["OUT"], shared["THREADS"])
    found = dict[str, Verb]()
    for name, meaning in _targets(head):
        if name not in CLONE_ONLY and name not in found:
            found[name] = Verb(name, meaning, taken.get(name, ()))
    found["completion"] = Verb("completion", "print what makes a shell complete: bash, zsh or tcsh", ())
    return found


def _targets(head: str) -> list[tuple[str, str]]:
    """Return target and meaning of every line ``make target ...  meaning``, with the lines that go on."""
    found: list[tuple[str, str]] = []
    for line in head.splitlines():
        if match := re.match(r"  make ([a-z-]+)(?: .*?)?  +(\S.*)$", line):
            found.append((match[1], match[2]))
        elif found and line.startswith(" " * COLUMN):
            found[-1] = found[-1][0], f"{found[-1][1]} {line.strip()}"
    return found


def _entries(body: str) -> tuple[Variable, ...]:
    found: list[Variable] = []
    for line in body.split("\n\n")[0].splitlines():
        if match := re.match(r"  ([A-Z_]+)=(\S.*?)  +(\S.*)$", line):
            found.append(Variable(match[1], match[2].strip('"'), match[3]))
        elif found and line.strip():
            last = found[-1]
            found[-1] = Variable(last.name, last.example, f"{last.meaning} {line.strip()}")
    return tuple(found)


def nearest(word: str, known: Iterable[str]) -> str:
    """Return ``: did you mean …?`` for the known word that is nearest to one that is not known, or nothing.

    Case and the signs between words do not count: sigma-s is near SIGMA_S.
    """
    plain = {_plain(one): one for one in known}
    found = difflib.get_close_matches(_plain(word), plain, n=1, cutoff=0.6)
    return f": did you mean {plain[found[0]]}?" if found else ""


def _plain(word: str) -> str:
    return re.sub(r"[^a-z0-9]", "", word.lower())
