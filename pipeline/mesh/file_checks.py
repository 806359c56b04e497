"""What a mesh file claims, checked before it is read: readers believe counts."""

from __future__ import annotations

import re
import struct
from pathlib import Path

from pipeline.documents import whole_number
from pipeline.errors import InputError
from pipeline.mesh.companion_files import PLY_HEADER
from pipeline.mesh.gltf_checks import check_gltf
from pipeline.mesh.limits import check_count
from pipeline.stand_ins import check_fetched

FORMATS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")
OFF_HEADER = 1 << 16
"""Bytes in which an OFF file's counts stand, comments before them."""


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
    check_fetched(path, "a mesh")
    CHECKS[suffix](path)


def check_obj(path: Path) -> None:
    """Raise InputError for too many faces."""
    check_count(path.read_bytes().count(b"\nf "), path)


def check_off(path: Path) -> None:
    """Raise InputError for a header that claims too many faces; its reader says what else is wrong."""
    with path.open("rb") as stream:
        head = stream.read(OFF_HEADER)
    found = re.match(rb"\s*\w*OFF\s+(?:#[^\n]*\n\s*)*\d{1,18}\s+(\d{1,18})\b", head)
    check_count(int(found[1]) if found else 0, path)


def check_stl(path: Path) -> None:
    """Raise InputError for a binary STL file that is shorter than its triangles, or has too many."""
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
    check_count(count, path)


def check_ply(path: Path) -> None:
    """Raise InputError unless the header is one and the file is long enough for its elements."""
    with path.open("rb") as stream:
        head = stream.read(PLY_HEADER)
    lines = head.partition(b"end_header")[0].split(b"\n")
    if not head.startswith(b"ply") or b"end_header" not in head:
        raise InputError(f"{path}: no PLY header; export the mesh again")
    size = path.stat().st_size
    for words in (line.split() for line in lines):
        if words[:2] == [b"element", b"tristrips"]:
            raise InputError(f"{path}: is made of triangle strips; export it as triangles")
        if words[:1] == [b"element"]:
            count = whole_number(words[2]) if len(words) == 3 else None
            if count is None or count > size:
                said = b" ".join(words[1:]).decode("ascii", "replace")[:60]
                raise InputError(
                    f"{path}: claims {said!r} in {size} bytes; the file is cut off: copy it again"
                )
            if words[1] == b"face":
                check_count(count, path)


CHECKS = {
    ".obj": check_obj,
    ".ply": check_ply,
    ".stl": check_stl,
    ".off": check_off,
    ".glb": check_gltf,
    ".gltf": check_gltf,
}
"""What each format's files are held against."""
