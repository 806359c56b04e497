"""What a mesh file claims, checked before it is read: trimesh believes counts, and follows cycles.

Also the other files that a .gltf file needs.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from pipeline.documents import parse_object
from pipeline.errors import InputError

FORMATS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")
MOST_ELEMENTS = 20_000_000
"""Of one glTF accessor that has no data behind it and stands for zeros."""
MOST_DEPTH = 100
"""Of glTF nodes: a hand's skeleton has ten levels, and placing a node takes as long as it is deep."""
_TRIANGLES = {4: "triangles", 5: "triangle strips", 6: "triangle fans"}
_OTHERS = {0: "points", 1: "lines", 2: "line loops", 3: "line strips"}
"""What glTF can draw beside these (specification, 3.7.2.1)."""
SUPPORTED_EXTENSIONS = (
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "EXT_texture_",
    "KHR_mesh_quantization",
)
_PLY_HEADER = 1 << 16


def check_file(path: Path) -> None:
    """Raise InputError for a file that is no mesh by its name or by what its first bytes claim."""
    if not path.is_file():
        raise InputError(f"{path} does not exist or is no file: give the path of a mesh")
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(
            f"{path}: the ending is {suffix or 'missing'}, expected one of {' '.join(FORMATS)}; "
            "export the mesh in one of these formats"
        )
    if not path.stat().st_size:
        raise InputError(f"{path}: 0 bytes, expected a mesh; export or copy it again")
    check = {".ply": check_ply, ".stl": check_stl, ".glb": check_gltf, ".gltf": check_gltf}.get(suffix)
    if check:
        check(path)


def check_stl(path: Path) -> None:
    """Raise InputError for a binary STL file that is shorter than its triangles."""
    with path.open("rb") as stream:
        head = stream.read(84)
    size = path.stat().st_size
    count = struct.unpack("<I", head[80:])[0] if len(head) == 84 else 0
    # Some binary files begin with the word too: they have just the right length.
    if head.lstrip()[:5].lower() == b"solid" and size != 84 + 50 * count:
        with path.open("rb") as stream:
            stream.seek(max(0, size - 1024))
            if b"endsolid" not in stream.read().lower():
                raise InputError(
                    f"{path}: a text STL without its end (endsolid); it is cut off: copy it again"
                )
        return
    if len(head) < 84 or size < 84 + 50 * count:
        raise InputError(
            f"{path}: claims {count} triangles ({84 + 50 * count} bytes) in {size} bytes; the file is cut "
            "off: copy it again"
        )


def check_ply(path: Path) -> None:
    """Raise InputError unless the header is one and the file is long enough for its elements."""
    with path.open("rb") as stream:
        head = stream.read(_PLY_HEADER)
    lines = head.partition(b"end_header")[0].split(b"\n")
    if not head.startswith(b"ply") or b"end_header" not in head:
        raise InputError(f"{path}: no PLY header; export the mesh again")
    size = path.stat().st_size
    for words in (line.split() for line in lines):
        if words[:2] == [b"element", b"tristrips"]:
            raise InputError(f"{path}: is made of triangle strips; export it as triangles")
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
    _check_version(document, path)
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
        raise InputError(f"{path}: not valid glTF ({gltf_fault(error)}); export it again") from None
    for name in needed:
        if not name.startswith(SUPPORTED_EXTENSIONS):
            raise InputError(f"{path}: needs the glTF extension {name[:60]}; export the mesh without it")
    _check_tree(children, path)
    try:
        _check_shown(document, path)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise InputError(f"{path}: not valid glTF ({gltf_fault(error)}); export it again") from None


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


def _check_version(document: dict[str, Any], path: Path) -> None:
    asset = document.get("asset")
    version = asset.get("version", "1.0") if isinstance(asset, dict) else "1.0"
    if not str(version).startswith("2."):
        raise InputError(f"{path}: glTF {str(version)[:20]} is not read: convert it to 2.0")


def _check_shown(document: dict[str, Any], path: Path) -> None:
    """Raise InputError where no node of the scene (of all there are, in a file without scenes) has a mesh, or
    no mesh has triangles."""
    meshes, nodes = document.get("meshes", []), document.get("nodes", [])
    modes = {int(primitive.get("mode", 4)) for mesh in meshes for primitive in mesh["primitives"]}
    if modes and not modes & _TRIANGLES.keys():
        names = ", ".join(_OTHERS.get(mode, f"mode {mode}") for mode in sorted(modes))
        raise InputError(f"{path}: is made of {names}; export it as triangles")
    waiting = list(range(len(nodes)))
    if scenes := document.get("scenes", []):
        waiting = [int(node) for node in scenes[int(document.get("scene", 0))].get("nodes", [])]
    shown: set[int] = set()
    while waiting:
        node = waiting.pop()
        if node not in shown and 0 <= node < len(nodes):  # the tree is checked apart
            shown.add(node)
            waiting += [int(child) for child in nodes[node].get("children", ())]
    if meshes and not any("mesh" in nodes[node] for node in shown):
        raise InputError(
            f"{path}: has {len(meshes)} meshes, but none in its scene; export it with a scene that shows them"
        )


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
    rooted = [(node, 1) for node in range(len(children)) if node not in parent]
    reached = 0
    while rooted:
        reached += 1
        node, depth = rooted.pop()
        if depth > MOST_DEPTH:
            raise InputError(
                f"{path}: its glTF nodes are nested more than {MOST_DEPTH} deep; export the mesh without them"
            )
        rooted += [(child, depth + 1) for child in children[node]]
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
        if isinstance(uri, str) and not uri.startswith("data:"):
            found.append(_beside(path, unquote(uri), "buffer"))
    return found


def colour_files(path: Path) -> list[Path]:
    """Return the files that a mesh takes its colours from: materials and textures of an OBJ, textures of a
    .gltf or a PLY (none for other files); they lie beside it.

    Raises InputError for one that is missing or outside its folder.
    """
    suffix = path.suffix.lower()
    if suffix == ".gltf":
        images = read_gltf_json(path).get("images", [])
        uris = [i.get("uri") for i in images if isinstance(i, dict)] if isinstance(images, list) else []
        return [
            _beside(path, unquote(uri), "texture")
            for uri in uris
            if isinstance(uri, str) and not uri.startswith("data:")
        ]
    if suffix == ".ply":
        return [_beside(path, name, "texture") for name in _ply_textures(path)]
    if suffix != ".obj":
        return []
    found = []
    for name in _words_after(path, "mtllib"):
        library = _beside(path, name, "material file")
        found.append(library)
        for texture in _words_after(library, "map_kd"):
            whole = (library.parent / texture).is_file()  # else options stand before the name
            found.append(_beside(library, texture if whole else texture.split()[-1], "texture"))
    return list(dict.fromkeys(found))


def _ply_textures(path: Path) -> list[str]:
    """Return the last texture that comments of a PLY file's header name, the one that is read, if any."""
    with path.open("rb") as stream:
        head = stream.read(_PLY_HEADER).partition(b"end_header")[0].decode("utf-8", "replace")
    found = re.findall(r"^\s*comment\s+texturefile\s+(\S.*)", head, re.IGNORECASE | re.MULTILINE)
    return [found[-1].strip()] if found else []


def _words_after(path: Path, key: str) -> list[str]:
    """Return what follows a key on the lines of a text file, each once."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    pairs = [(line.split(maxsplit=1) + ["", ""])[:2] for line in lines]
    return list(dict.fromkeys(rest.strip() for word, rest in pairs if word.lower() == key and rest.strip()))


def _beside(path: Path, name: str, what: str) -> Path:
    """Return the file of that name in the folder of `path`, or below. Raises InputError if there is none."""
    file = path.parent / name
    try:
        inside = not Path(name).is_absolute() and file.resolve().is_relative_to(path.parent.resolve())
        there = file.is_file()
    except (OSError, ValueError):  # no name of a file: too long, or with a NUL
        inside, there = True, False
    if not inside:
        raise InputError(f"{path}: its {what} {name[:80]!r} lies outside its folder; put it beside the file")
    if not there:
        raise InputError(f"{path}: its {what} {name[:80]!r} is missing; copy it too, or export as .glb")
    return file


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
