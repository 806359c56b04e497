"""What an .onnx file says about itself, read without the onnx package and without loading a weight.

An .onnx file is one protocol-buffers message (`ModelProto`, onnx/onnx.proto). Walking its top
levels tells, in milliseconds, what a loader needs to know before it spends seconds and gigabytes:
whether the file is whole, what the graph takes and gives, which operator sets it needs, and which
other files hold its weights. Reference: protobuf.dev, "Encoding"; field numbers from onnx.proto.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.documents import whole_number
from pipeline.errors import InputError
from pipeline.stand_ins import check_fetched

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_Span = tuple[int, int]


@dataclass(frozen=True)
class Port:
    """One input or output of a graph: element type (onnx's number) and its axes (None = dynamic)."""

    name: str
    element_type: int
    shape: tuple[int | None, ...] | None


@dataclass(frozen=True)
class External:
    """Weights of one tensor kept in another file: `location` is relative to the .onnx file; bytes."""

    tensor: str
    location: str
    offset: int
    length: int


@dataclass
class OnnxFile:
    """The outline of a model: ports in order, external weights, operators and local functions
    as (domain, name)."""

    path: Path
    inputs: dict[str, Port] = field(default_factory=dict)
    outputs: dict[str, Port] = field(default_factory=dict)
    external: list[External] = field(default_factory=list)
    operators: set[tuple[str, str]] = field(default_factory=set)
    functions: set[tuple[str, str]] = field(default_factory=set)


class _Truncated(ValueError):
    """A length or a number runs past the end of the message that holds it."""


def _varint(data: mmap.mmap, at: int, end: int) -> tuple[int, int]:
    value, shift = 0, 0
    while at < end and shift < 70:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at += 1
        if byte < 0x80:
            return value, at
        shift += 7
    raise _Truncated


def _fields(data: mmap.mmap, span: _Span) -> Iterator[tuple[int, int | _Span]]:
    """Yield (field number, number or span of bytes) of the message in `span`."""
    at, end = span
    while at < end:
        key, at = _varint(data, at, end)
        number, wire = key >> 3, key & 7
        if number == 0:
            raise _Truncated
        if wire == _VARINT:
            value, at = _varint(data, at, end)
            yield number, value
            continue
        if wire == _BYTES:
            length, at = _varint(data, at, end)
        elif wire in (_FIXED64, _FIXED32):
            length = 8 if wire == _FIXED64 else 4
        else:
            raise _Truncated
        if at + length > end:
            raise _Truncated
        yield number, (at, at + length)
        at += length


def _spans(data: mmap.mmap, span: _Span, number: int) -> Iterator[_Span]:
    return (value for found, value in _fields(data, span) if found == number and isinstance(value, tuple))


def _text(data: mmap.mmap, span: _Span) -> str:
    return data[span[0] : span[1]].decode("utf-8", errors="replace")


def _port(data: mmap.mmap, span: _Span) -> Port:
    name, element_type, shape = "", 0, None
    for number, value in _fields(data, span):
        if number == 1 and isinstance(value, tuple):
            name = _text(data, value)
        elif number == 2 and isinstance(value, tuple):
            for tensor_type in _spans(data, value, 1):
                for key, part in _fields(data, tensor_type):
                    if key == 1 and isinstance(part, int):
                        element_type = part
                    elif key == 2 and isinstance(part, tuple):
                        shape = tuple(_axis(data, axis) for axis in _spans(data, part, 1))
    return Port(name, element_type, shape)


def _axis(data: mmap.mmap, span: _Span) -> int | None:
    return next(
        (value for number, value in _fields(data, span) if number == 1 and isinstance(value, int)), None
    )


def _external(data: mmap.mmap, span: _Span) -> External | None:
    """The external-data entries of a TensorProto (fields 8 name, 13 external_data, 14 data_location)."""
    name, location, entries = "", 0, {}
    for number, value in _fields(data, span):
        if number == 8 and isinstance(value, tuple):
            name = _text(data, value)
        elif number == 13 and isinstance(value, tuple):
            pair = [_text(data, part) for _, part in _fields(data, value) if isinstance(part, tuple)]
            entries[pair[0]] = pair[1] if len(pair) > 1 else ""
        elif number == 14 and isinstance(value, int):
            location = value
    if location != 1:
        return None
    offset, length = (whole_number(entries.get(key, "")) or 0 for key in ("offset", "length"))
    return External(name, entries.get("location", ""), offset, length)


def _name_and_domain(data: mmap.mmap, span: _Span, name_field: int, domain_field: int) -> tuple[str, str]:
    texts = {
        key: _text(data, part)
        for key, part in _fields(data, span)
        if key in (name_field, domain_field) and isinstance(part, tuple)
    }
    return texts.get(domain_field, ""), texts.get(name_field, "")


def _read_graph(data: mmap.mmap, span: _Span, found: OnnxFile) -> None:
    initializers: set[str] = set()
    for number, value in _fields(data, span):
        if not isinstance(value, tuple):
            continue
        if number == 1:
            found.operators.add(_name_and_domain(data, value, 4, 7))
        elif number == 5:
            initializers.update(_text(data, name) for name in _spans(data, value, 8))
            if (external := _external(data, value)) is not None:
                found.external.append(external)
        elif number in (11, 12):
            port = _port(data, value)
            (found.inputs if number == 11 else found.outputs)[port.name] = port
    for name in initializers & found.inputs.keys():  # old exporters list the weights as inputs too
        del found.inputs[name]


def read_onnx(path: Path) -> OnnxFile:
    """Return the outline of the model at `path`.

    Raises InputError when the file is empty, a Git LFS pointer, a web page, no ONNX model, or cut short.
    """
    size = path.stat().st_size
    if size == 0:
        raise InputError(f"{path}: 0 bytes, expected an ONNX model; copy the file again")
    check_fetched(path, "an ONNX model")
    found = OnnxFile(path)
    graphs = 0
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        try:
            for number, value in _fields(data, (0, size)):
                if number == 7 and isinstance(value, tuple):
                    graphs += 1
                    _read_graph(data, value, found)
                elif number == 25 and isinstance(value, tuple):
                    found.functions.add(_name_and_domain(data, value, 1, 10))
        except _Truncated:
            raise InputError(
                f"{path}: {size} bytes that break off or are no ONNX model; copy or export the file again"
            ) from None
    if graphs != 1 or not found.outputs:
        raise InputError(
            f"{path}: no ONNX graph with outputs found in {size} bytes; copy or export the file again"
        )
    return found


def check_external(model: OnnxFile) -> None:
    """Raise InputError when a file of external weights is missing, short, or outside the folder."""
    folder = model.path.parent
    seen: dict[str, int] = {}
    for item in model.external:
        seen[item.location] = max(seen.get(item.location, 0), item.offset + item.length)
    for location, needed in seen.items():
        relative = Path(location)
        if not location or relative.is_absolute() or ".." in relative.parts:
            raise InputError(
                f"{model.path}: its weights are said to be in {location!r}, expected a file name inside "
                "its own folder; export the model again"
            )
        data = folder / relative
        if not data.is_file():
            raise InputError(
                f"{data}: missing, expected {needed} bytes of weights of {model.path.name}; copy it too"
            )
        if not data.resolve().is_relative_to(folder.resolve()):
            raise InputError(
                f"{data}: a link that leads out of its folder, which is refused; put the file itself there"
            )
        if (size := data.stat().st_size) < needed:
            raise InputError(
                f"{data}: {size} bytes, expected at least {needed} for {model.path.name}; copy it again"
            )
