"""A glTF file as it is: its JSON, its buffers, and the numbers of its accessors (specification, section 3.6).

What reads geometry, and what gives a file back with other colours, share it. Letters: n elements,
k components.
"""

from __future__ import annotations

import base64
import binascii
import struct
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote_to_bytes

import numpy as np
from jaxtyping import Float

from pipeline.errors import InputError
from pipeline.mesh.companion_files import buffer_files
from pipeline.mesh.gltf_json import gltf_fault, read_gltf_json

DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
"""Components of an element; MAT2 and MAT3 are in nothing that is read here."""


class Document(NamedTuple):
    """A file in memory."""

    json: dict[str, Any]
    buffers: list[bytes]

    def view(self, row: int) -> bytes:
        """Return the bytes of a buffer view."""
        view = self.json["bufferViews"][row]
        first, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        data = self.buffers[int(view["buffer"])][first : first + length]
        if min(first, length) < 0 or len(data) != length:
            raise ValueError(f"bufferView {row} claims {length} bytes at {first}, its buffer has {len(data)}")
        return data

    def elements(self, row: int) -> np.ndarray:
        """Return the numbers of an accessor as they are stored, (n, k); sparse changes are applied."""
        accessor = self.json["accessors"][row]
        count, width = int(accessor["count"]), WIDTHS[accessor["type"]]
        dtype = np.dtype(DTYPES[accessor["componentType"]])
        if accessor.get("bufferView") is None:
            found = np.zeros((count, width), dtype)
        else:
            view = self.json["bufferViews"][accessor["bufferView"]]
            stride = int(view.get("byteStride", 0)) or width * dtype.itemsize
            start = int(accessor.get("byteOffset", 0))
            found = _strided(self.view(accessor["bufferView"]), start, stride, count, dtype, width)
        if sparse := accessor.get("sparse"):
            found = found.copy()
            changed = int(sparse["count"])
            where, what = sparse["indices"], sparse["values"]
            kind = np.dtype(DTYPES[where["componentType"]])
            places = _strided(
                self.view(where["bufferView"]),
                int(where.get("byteOffset", 0)),
                kind.itemsize,
                changed,
                kind,
                1,
            )
            found[places[:, 0]] = _strided(
                self.view(what["bufferView"]),
                int(what.get("byteOffset", 0)),
                width * dtype.itemsize,
                changed,
                dtype,
                width,
            )
        return found

    def values(self, row: int) -> Float[np.ndarray, "n k"]:
        """Return the numbers of an accessor, float64; normalised integers are shares of the largest."""
        stored = self.elements(row)
        values = stored.astype(np.float64)
        if self.json["accessors"][row].get("normalized") and stored.dtype.kind in "iu":
            values = np.maximum(values / np.iinfo(stored.dtype).max, -1.0)
        return values


def _strided(data: bytes, start: int, stride: int, count: int, dtype: np.dtype, width: int) -> np.ndarray:
    """Return `count` elements that lie `stride` bytes apart."""
    size = width * dtype.itemsize
    if start < 0 or stride < size or (count and start + (count - 1) * stride + size > len(data)):
        raise ValueError(f"{count} elements of {size} bytes, {stride} apart, do not fit {len(data)} bytes")
    rows = np.lib.stride_tricks.as_strided(
        np.frombuffer(data, np.uint8)[start:], (count, size), (stride, 1), writeable=False
    )
    return np.ascontiguousarray(rows).view(dtype).reshape(count, width)


def open_document(path: Path) -> Document:
    """Return a checked .glb or .gltf file with all its buffers.

    Raises:
        InputError: a buffer is missing, cut off, or no base64; see also `read_gltf_json`, `buffer_files`.
    """
    document = read_gltf_json(path)
    files = iter(buffer_files(path))
    buffers = []
    try:
        for row, buffer in enumerate(document.get("buffers", [])):
            uri, length = buffer.get("uri"), int(buffer["byteLength"])
            if uri is None:
                data = _binary_chunk(path) if row == 0 and path.suffix.lower() == ".glb" else b""
            else:
                data = data_of(uri) if uri.startswith("data:") else next(files).read_bytes()
            if not 0 <= length <= len(data):
                raise ValueError(f"buffer {row} claims {length} bytes and has {len(data)}")
            buffers.append(data[:length])
    except (KeyError, TypeError, ValueError, AttributeError, struct.error) as error:
        raise InputError(f"{path}: not a readable glTF file ({gltf_fault(error)}); export it again") from None
    return Document(document, buffers)


def data_of(uri: str) -> bytes:
    """Return the bytes of a data: URI. Raises ValueError if it is none."""
    head, _, body = uri.partition(",")
    try:
        return base64.b64decode(body, validate=False) if head.endswith(";base64") else unquote_to_bytes(body)
    except binascii.Error as error:
        raise ValueError(f"a data URI is no base64 ({error})") from None


def _binary_chunk(path: Path) -> bytes:
    """Return the second chunk of a GLB file; empty if there is none."""
    data = path.read_bytes()
    first = 20 + struct.unpack("<I", data[12:16])[0]
    if len(data) < first + 8:
        return b""
    length, kind = struct.unpack("<I4s", data[first : first + 8])
    return data[first + 8 : first + 8 + length] if kind == b"BIN\0" else b""
