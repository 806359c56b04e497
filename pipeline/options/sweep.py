"""A sweep: many jobs from one file.

YAML, as a job file, in which any value may be a list of values: the jobs are their product, the first option
varying most slowly. Or a text file: a prompt a line, ``#`` before what is none.
"""

import dataclasses
import itertools
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.options.job import Job, resolve, run_name
from pipeline.options.models import MODELS
from pipeline.options.schema import plain, read_yaml, short

MOST = 20_000
"""Jobs of one sweep: one graph of Snakemake holds so many."""


class Sweep(typing.NamedTuple):
    """The jobs of a sweep."""

    jobs: tuple[Job, ...]
    varied: tuple[str, ...]
    """Options that are not the same in all, such as seed or clean.faces."""

    def values(self, job: Job) -> dict[str, Any]:
        """Return what a job has of the varied options."""
        values = plain(job)
        return {name: _at(values, name) for name in self.varied}


def read_sweep(path: Path, models: Path = MODELS) -> Sweep:
    """Return the jobs that a file asks for; what is asked for twice is there once.

    Raises:
        InputError: as for `resolve`; no job, or more than MOST.
    """
    if path.suffix.lower() in (".yaml", ".yml"):
        given = read_yaml(path)
        lists = _lists(path, given)
    else:
        given = {}
        lists = {("prompt",): _lines(path)}
    count = 1
    for name, values in lists.items():
        count *= len(values)
        if not values:
            raise InputError(f"{path}: {'.'.join(name)} is an empty list: say at least one value")
    if count > MOST:
        raise InputError(f"{path} asks for {count} jobs, expected at most {MOST}: make several sweeps of it")
    found: dict[str, Job] = {}
    for chosen in itertools.product(*lists.values()):
        options = {n: dict(value) if isinstance(value, Mapping) else value for n, value in given.items()}
        for (*section, key), one in zip(lists, chosen, strict=True):
            (options[section[0]] if section else options)[key] = one
        try:
            job = resolve({}, models, options=options)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        found.setdefault(run_name(job), job)
    jobs = tuple(found.values())
    return Sweep(jobs, tuple(".".join(name) for name, values in lists.items() if len(values) > 1))


def _lines(path: Path) -> list[str]:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except ValueError:
        raise InputError(
            f"{path} is no text in UTF-8: write one prompt a line, or a file that ends in .yaml"
        ) from None
    lines = [line.strip() for line in text.splitlines()]
    prompts = [line for line in lines if line and not line.startswith("#")]
    if not prompts:
        raise InputError(f"{path} has no prompt in it: write one a line")
    return prompts


def _lists(path: Path, given: Mapping[str, Any]) -> dict[tuple[str, ...], list[Any]]:
    """Return the lists of values by the name of their option, in the order of the file."""
    hints = typing.get_type_hints(Job)
    found: dict[tuple[str, ...], list[Any]] = {}
    for name, value in given.items():
        if isinstance(value, Mapping) and dataclasses.is_dataclass(hints.get(name)):
            inner = typing.get_type_hints(hints[name])
            for key, one in value.items():
                if (values := _values(one, inner.get(key))) is not None:
                    found[name, str(key)] = values
        elif (values := _values(value, hints.get(name))) is not None:
            found[(str(name),)] = values
    for names, values in found.items():
        if any(isinstance(value, Mapping) for value in values):
            raise InputError(f"{path}: {'.'.join(names)} lists {short(values)}, expected plain values")
    return found


def _values(value: Any, hint: Any) -> list[Any] | None:
    """Return what to vary; None for a value that is one. A pair is a list in YAML: lists of pairs are
    varied.
    """
    if not isinstance(value, list):
        return None
    if typing.get_origin(hint) is tuple:
        return value if all(isinstance(one, list) for one in value) else None
    return value


def _at(values: Mapping[str, Any], name: str) -> Any:
    for part in name.split("."):
        values = values[part]
    return values
