"""The JSON part of a glTF file, and which of its nodes viewers show."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

from pipeline.documents import parse_object
from pipeline.errors import InputError


def gltf_fault(error: Exception) -> str:
    """Return what an error met in a glTF document says about the file, in one line."""
    said = " ".join(str(error).split())[:120]
    if isinstance(error, KeyError):
        return f"{said} is missing or unknown"
    if isinstance(error, IndexError):
        return f"it refers to what is not there: {said}"
    if isinstance(error, (AttributeError, TypeError)):
        return f"a value is of another kind than glTF says: {said}"
    return said


def read_gltf_json(path: Path) -> dict[str, Any]:
    """Return the JSON part of a .gltf or .glb file. Raises InputError if there is none."""
    data = path.read_bytes()
    try:
        if path.suffix.lower() == ".glb":
            magic, version, _, length, kind = struct.unpack("<4sII I4s", data[:20])
            if magic == b"glTF" and version != 2:
                raise InputError(f"{path}: glTF {version} is not read: convert it to 2.0")
            if magic != b"glTF" or kind != b"JSON" or length > len(data) - 20:
                raise ValueError("no glTF header")
            data = data[20 : 20 + length]
        return parse_object(data)
    except (ValueError, struct.error) as error:
        said = str(error).splitlines()[0][:120]
        raise InputError(f"{path}: not a readable glTF file ({said}); export it again") from None


def shown_nodes(json: dict[str, Any]) -> list[int]:
    """Return the nodes of the scene that viewers open, parents first; without scenes all nodes. They are
    trees (`gltf_checks` sees to that)."""
    nodes = json.get("nodes", [])
    if json.get("scenes"):
        waiting = [*json["scenes"][json.get("scene", 0)].get("nodes", [])][::-1]
    else:
        children = {child for node in nodes for child in node.get("children", ())}
        waiting = [row for row in range(len(nodes)) if row not in children][::-1]
    found: dict[int, None] = {}
    while waiting:
        if (row := waiting.pop()) not in found:
            found[row] = None
            waiting += nodes[row].get("children", [])[::-1]
    return list(found)
