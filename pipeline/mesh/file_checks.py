"""What a mesh file claims, checked before it is read: readers believe counts."""

from __future__ import annotations

import re
import struct
from pathlib import Path

from pipeline.documents import whole_number
from pipeline.errors import InputError
from pipeline.mesh.gltf_checks import check_count, check_gltf
from pipeline.stand_ins import check_fetched

FORMATS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")
HEADER = 1 << 16
"""Bytes in which a PLY file's header ends."""


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
    check = {".ply": check_ply, ".stl": check_stl, ".glb": check_gltf, ".gltf": check_gltf}.get(suffix)
    if check:
        check(path)
    check_count(_claimed_faces(path), path)


def _claimed_faces(path: Path) -> int:
    """Return how many triangles a mesh file has at least, without reading them; 0: it does not say (and of
    glTF, which `check_gltf` counts)."""
    suffix = path.suffix.lower()
    if suffix in (".glb", ".gltf"):
        return 0
    if suffix == ".obj":
        return path.read_bytes().count(b"\nf ")
    with path.open("rb") as stream:
        head = stream.read(HEADER)
    if suffix == ".stl":
        count = struct.unpack("<I", head[80:84])[0] if len(head) >= 84 else 0
        return count if path.stat().st_size == 84 + 50 * count else 0
    if suffix == ".ply":
        found = re.search(rb"^element\s+face\s+(\d{1,18})\b", head, re.MULTILINE)
    else:
        found = re.match(rb"\s*\w*OFF\s+(?:#[^\n]*\n\s*)*\d{1,18}\s+(\d{1,18})\b", head)
    return int(found[1]) if found else 0


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
        head = stream.read(HEADER)
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
