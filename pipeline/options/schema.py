"""Typed options: dataclasses whose fields carry a meaning and a range, and their plain YAML form.

Dataclasses may hold dataclasses, one level deep: the sections of a file. Types are str, int, float, bool, a
Literal of words, and pairs of rising numbers.
"""

import dataclasses
import json
import math
import re
import reprlib
import textwrap
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar

import yaml

from pipeline.errors import InputError
from pipeline.files import read_at_most

T = TypeVar("T")
MOST_YAML = 2**20
"""A job, with every option written out, takes three kilobytes [bytes]."""

LINE = 110
"""Of what `describe` writes [characters]."""


def option(default: Any, help: str, low: float | None = None, high: float | None = None) -> Any:
    """Return a dataclass field with its meaning and its inclusive range (None: unbounded)."""
    return dataclasses.field(default=default, metadata={"help": help, "low": low, "high": high})


def check(options: Any) -> None:
    """Check every field of a dataclass of options against its type and its range.

    Raises:
        InputError: the field, the value found and the values allowed.
    """
    hints = typing.get_type_hints(type(options))
    nested = any(dataclasses.is_dataclass(hint) for hint in hints.values())
    section = "" if nested else f"{snake(type(options).__name__)}."
    for spec in dataclasses.fields(options):
        value = getattr(options, spec.name)
        if not dataclasses.is_dataclass(value):
            _check_value(f"{section}{spec.name}", value, hints[spec.name], spec.metadata)


def snake(name: str) -> str:
    """Return the name of the section that a class of options stands for."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()


def check_power_of_two(name: str, value: int) -> None:
    """Refuse a size that is not 1, 2, 4, 8 and so on."""
    if value & (value - 1):
        raise InputError(f"{name} is {value}, expected a power of two such as 1024")


def check_text(name: str, text: str) -> None:
    """Refuse text that no tokenizer, file or page can carry: NUL, or bytes that were not UTF-8."""
    if "\0" in text:
        raise InputError(f"{name} holds a NUL character at position {text.index(chr(0))}: remove it")
    try:
        text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise InputError(f"{name} is not valid UTF-8 at position {error.start}: write it in UTF-8") from None


class _Loader(yaml.SafeLoader):
    """YAML without tags that execute, without numbers that cannot be printed, and with each key once: of two
    sections one would be lost."""

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        """Build a whole number of at most 64 bits."""
        value = int(super().construct_yaml_int(node)) if len(node.value) < 100 else 2**63
        if abs(value) >= 2**63:
            raise yaml.YAMLError(f"{short(node.value)} in line {node.start_mark.line + 1} has over 64 bits")
        return value

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Build a mapping; a key said twice is an error."""
        seen = set[str]()
        for key, _ in node.value:
            name = str(key.value)
            if name in seen:
                raise yaml.YAMLError(f"{short(name)} stands twice, again in line {key.start_mark.line + 1}")
            seen.add(name)
        return super().construct_mapping(node, deep)


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML mapping; tags never execute.

    Raises:
        InputError: the file is absent, is not YAML, has a key twice, or holds no mapping.
    """
    if not path.exists():
        raise InputError(f"{path} does not exist: give the path of a YAML file")
    try:
        text = read_at_most(path, MOST_YAML).decode("utf-8")
        value = yaml.load(text, Loader=_Loader)  # noqa: TID251 (a SafeLoader)
    except (yaml.YAMLError, ValueError) as error:  # a number or date that is none, bytes that are no UTF-8
        raise InputError(f"{path} is not plain YAML: {' '.join(str(error).split())}") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except RecursionError:
        raise InputError(f"{path} is nested too deeply to be a job") from None
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise InputError(
            f"{path} holds {type(value).__name__}, expected a mapping such as prompt: a red armchair"
        )
    return value


def build(kind: type[T], values: Mapping[str, Any], where: str = "", section: str = "") -> T:
    """Build a dataclass of options from plain YAML values.

    Raises:
        InputError: an unknown key (with the valid ones), a wrong type, a value out of range.
    """
    prefix = f"{where}: " if where else ""
    hints = typing.get_type_hints(kind)
    made: dict[str, Any] = {}
    for key, value in values.items():
        name = f"{section}{key}"
        if key not in hints:
            raise InputError(f"{prefix}unknown key {name!r}; valid keys: {', '.join(hints)}")
        if dataclasses.is_dataclass(hints[key]):
            if not isinstance(value, Mapping):
                raise InputError(f"{prefix}{name} is {short(value)}, expected a mapping of options")
            made[key] = build(typing.cast(type, hints[key]), value, where, f"{name}.")
        else:
            made[key] = _widen(value, hints[key])
    try:
        return kind(**made)
    except InputError as error:
        raise (
            error if not prefix or str(error).startswith(prefix) else InputError(f"{prefix}{error}")
        ) from None


def describe(kind: type, values: Any = None) -> str:
    """Return every option with its value, range and meaning, as YAML with comments.

    `values`: options of this kind, whose values are said; None: the defaults.
    """
    lines = []
    hints = typing.get_type_hints(kind)
    for spec in dataclasses.fields(kind):
        section, value = hints[spec.name], getattr(values, spec.name, None)
        if dataclasses.is_dataclass(section):
            inner = typing.get_type_hints(section)
            lines += ["", f"{spec.name}:  # {(section.__doc__ or '').strip()}"]
            for field in dataclasses.fields(section):
                lines += _describe_field(
                    field, inner[field.name], getattr(value, field.name, field.default), "  "
                )
        else:
            lines += _describe_field(spec, section, spec.default if values is None else value)
    return "\n".join(lines)


def _describe_field(spec: "dataclasses.Field[Any]", hint: Any, value: Any, indent: str = "") -> list[str]:
    """Return the lines of an option: the comment goes on below where a line would get too long."""
    text = json.dumps(value, ensure_ascii=False) if not isinstance(value, tuple) else str(list(value))
    head = f"{indent}{spec.name}: {text}".ljust(36)
    comment = f"{_allowed(hint, spec.metadata)}: {spec.metadata['help']}"
    parts = textwrap.wrap(comment, max(LINE - len(head) - len("  # "), 30), break_on_hyphens=False)
    return [f"{head}  # {parts[0]}", *(f"{'':{len(head)}}  # {part}" for part in parts[1:])]


def _check_value(name: str, value: Any, hint: Any, metadata: Mapping[str, Any]) -> None:
    low = -math.inf if metadata["low"] is None else metadata["low"]
    high = math.inf if metadata["high"] is None else metadata["high"]
    if typing.get_origin(hint) is Literal:
        good = isinstance(value, str) and value in typing.get_args(hint)
    elif hint in (str, bool):
        good = isinstance(value, hint)
    elif hint is int:
        good = isinstance(value, int) and not isinstance(value, bool) and low <= value <= high
    elif hint is float:
        good = _is_real(value) and low <= value <= high
    else:
        good = (
            isinstance(value, tuple)
            and len(value) == 2
            and all(_is_real(v) and low <= v <= high for v in value)
            and value[0] <= value[1]
        )
    if not good:
        raise InputError(f"{name} is {short(value)}, expected {_allowed(hint, metadata)}")


def _allowed(hint: Any, metadata: Mapping[str, Any]) -> str:
    if typing.get_origin(hint) is Literal:
        return " | ".join(typing.get_args(hint))
    if hint in (str, bool):
        return "text" if hint is str else "true | false"
    kind = {int: "a whole number", float: "a number"}.get(hint, "two rising numbers")
    if metadata["low"] is None and metadata["high"] is None:
        return kind
    return f"{kind} from {_number(metadata['low'])} to {_number(metadata['high'])}"


def _number(value: float | None) -> str:
    return "any" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _is_real(value: Any) -> bool:
    try:
        return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:  # an integer beyond every float
        return False


def _widen(value: Any, hint: Any) -> Any:
    """YAML has no tuples, writes whole floats as integers, and takes 1e-3 for text."""
    if hint is float and isinstance(value, (int, str)) and not isinstance(value, bool):
        try:
            return float(value)
        except (ValueError, OverflowError):
            return value
    if typing.get_origin(hint) is tuple and isinstance(value, list):
        return tuple(float(v) if _is_real(v) else v for v in value)
    return value


def plain(value: Any) -> Any:
    """Return options as plain YAML or JSON values."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {spec.name: plain(getattr(value, spec.name)) for spec in dataclasses.fields(value)}
    return list(value) if isinstance(value, tuple) else value


def short(value: Any) -> str:
    """Return a value as an error quotes it; of a long list, or one of lists of lists, only the beginning."""
    text = repr(value) if isinstance(value, str) else reprlib.repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
