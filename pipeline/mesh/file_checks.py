"""What a mesh file claims, checked before it is read: trimesh believes counts, and follows cycles.

Also the other files that a .gltf file needs.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from pipeline.errors import InputError

MOST_ELEMENTS = 20_000_000
"""Of one glTF accessor that has no data behind it and stands for zeros."""
SUPPORTED_EXTENSIONS = (
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "EXT_texture_",
    "KHR_mesh_quantization",
)
_PLY_HEADER = 1 << 16


def check_ply(path: Path) -> None:
    """Raise InputError unless the header is one and the file is long enough for its elements."""
    with path.open("rb") as stream:
        head = stream.read(_PLY_HEADER)
    lines = head.partition(b"end_header")[0].split(b"\n")
    if not head.startswith(b"ply") or b"end_header" not in head:
        raise InputError(f"{path}: no PLY header; export the mesh again")
    size = path.stat().st_size
    for words in (line.split() for line in lines):
        if words[:1] == [b"element"]:
            count = int(words[2]) if len(words) == 3 and words[2].isdigit() else -1
            if not 0 <= count <= size:
                said = b" ".join(words[1:]).decode("ascii", "replace")[:60]
                raise InputError(
                    f"{path}: claims {said!r} in {size} bytes; the file is cut off: copy it again"
                )


def check_gltf(path: Path) -> None:
    """Raise InputError for a glTF file with claims its data cannot keep, cyclic nodes, unknown compression or
    buffers outside its folder."""
    document = read_gltf_json(path)
    buffer_files(path)
    try:
        needed = [str(name) for name in document.get("extensionsRequired", ())]
        views, accessors = document.get("bufferViews", []), document.get("accessors", [])
        for index, accessor in enumerate(accessors):
            count = int(accessor["count"])
            view = accessor.get("bufferView")
            most = MOST_ELEMENTS if view is None else int(views[view]["byteLength"])
            if not 0 <= count <= most:
                raise InputError(f"{path}: accessor {index} claims {count} elements; the file is damaged")
        children = [[int(child) for child in node.get("children", ())] for node in document.get("nodes", [])]
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise InputError(
            f"{path}: not valid glTF ({type(error).__name__}: {error}); export it again"
        ) from None
    for name in needed:
        if not name.startswith(SUPPORTED_EXTENSIONS):
            raise InputError(f"{path}: needs the glTF extension {name[:60]}; export the mesh without it")
    _check_tree(children, path)


def _check_tree(children: list[list[int]], path: Path) -> None:
    """glTF nodes are trees: every node has at most one parent, and no node is its own ancestor."""
    parent: dict[int, int] = {}
    for node, below in enumerate(children):
        for child in below:
            if not 0 <= child < len(children) or child in parent:
                raise InputError(
                    f"{path}: glTF node {child} has no place in a tree of nodes; export it again"
                )
            parent[child] = node
    rooted = [node for node in range(len(children)) if node not in parent]
    reached = 0
    while rooted:
        reached += 1
        rooted += children[rooted.pop()]
    if reached != len(children):
        raise InputError(f"{path}: its glTF nodes form a cycle; export it again")


def buffer_files(path: Path) -> list[Path]:
    """Return the files that a .gltf file keeps its numbers in (none for other files); they lie beside it.

    Raises InputError for one that is missing or outside its folder.
    """
    if path.suffix.lower() not in (".gltf", ".glb"):
        return []
    found = []
    buffers = read_gltf_json(path).get("buffers", [])
    if not isinstance(buffers, list):
        raise InputError(f"{path}: not valid glTF (its buffers are no list); export it again")
    for buffer in buffers:
        uri = buffer.get("uri") if isinstance(buffer, dict) else None
        if not isinstance(uri, str) or uri.startswith("data:"):
            continue
        name = unquote(uri)
        file = path.parent / name
        try:
            inside = not Path(name).is_absolute() and file.resolve().is_relative_to(path.parent.resolve())
            there = file.is_file()
        except (OSError, ValueError):  # no name of a file: too long, or with a NUL
            inside, there = True, False
        if not inside:
            raise InputError(
                f"{path}: its buffer {name[:80]!r} lies outside its folder; put it beside the file"
            )
        if not there:
            raise InputError(f"{path}: its buffer {name[:80]!r} is missing; copy it too, or export as .glb")
        found.append(file)
    return found


def read_gltf_json(path: Path) -> dict[str, Any]:
    """Return the JSON part of a .gltf or .glb file. Raises InputError if there is none."""
    data = path.read_bytes()
    try:
        if path.suffix.lower() == ".glb":
            magic, _, _, length, kind = struct.unpack("<4sII I4s", data[:20])
            if magic != b"glTF" or kind != b"JSON" or length > len(data) - 20:
                raise ValueError("no glTF header")
            data = data[20 : 20 + length]
        document = json.loads(data)
    except (ValueError, struct.error, RecursionError) as error:
        said = str(error).splitlines()[0][:120]
        raise InputError(f"{path}: not a readable glTF file ({said}); export it again") from None
    if not isinstance(document, dict):
        raise InputError(f"{path}: not a glTF file, its JSON is no object; export it again")
    return document


def beside(folder: Path, uri: str) -> Path | None:
    """Return the file that a document in `folder` names, if it is one and lies there or below."""
    try:
        file = folder / unquote(uri)
        inside = file.resolve().is_relative_to(folder.resolve())
        return file if inside and file.is_file() else None
    except (OSError, ValueError):  # no name of a file: too long, or with a NUL
        return None


def image_files(path: Path) -> list[Path]:
    """Return the pictures that lie beside a .gltf or .glb file and belong to it."""
    if path.suffix.lower() not in (".gltf", ".glb"):
        return []
    images = read_gltf_json(path).get("images", [])
    uris = (
        [image.get("uri") for image in images if isinstance(image, dict)] if isinstance(images, list) else []
    )
    named = [uri for uri in uris if isinstance(uri, str) and not uri.startswith("data:")]
    return [file for file in (beside(path.parent, uri) for uri in named) if file is not None]
