"""The other files that a mesh file needs: buffers, materials, textures. They lie beside it, or below."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import unquote

from pipeline.errors import InputError
from pipeline.mesh.gltf_json import read_gltf_json

PLY_HEADER = 1 << 16
"""Bytes in which a PLY file's header ends."""


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


def beside(folder: Path, uri: str) -> Path | None:
    """Return the file that a document in `folder` names, if it is one and lies there or below."""
    try:
        file = folder / unquote(uri)
        inside = file.resolve().is_relative_to(folder.resolve())
        return file if inside and file.is_file() else None
    except (OSError, ValueError):  # no name of a file: too long, or with a NUL
        return None


def _ply_textures(path: Path) -> list[str]:
    """Return the last texture that comments of a PLY file's header name, the one that is read, if any."""
    with path.open("rb") as stream:
        head = stream.read(PLY_HEADER).partition(b"end_header")[0].decode("utf-8", "replace")
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
