"""Files that visitors give: kept under their checksum, so that no name of theirs reaches the disk."""

import hashlib
import os
import re
from collections.abc import AsyncIterator
from pathlib import Path

from pipeline.errors import InputError
from pipeline.files import publish
from pipeline.options.schema import short

MESHES = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")
DRAWINGS = (".png", ".svg")
LARGEST = 64 * 2**20
"""Of one file [bytes]."""
MOST = 2 * 2**30
"""Of all together [bytes]."""


class TooLarge(InputError):
    """More than is allowed."""


async def keep(folder: Path, name: str, chunks: AsyncIterator[bytes]) -> str:
    """Write what comes to `folder` and return its id: sha256 and the ending.

    Args:
        name: what the visitor calls it; only its ending counts.
        chunks: its bytes; whatever ends them early leaves nothing behind.

    Raises:
        TooLarge: it, or all together, would take more room than is allowed.
        InputError: it is empty, or of a kind that nothing here reads.
    """
    suffix = Path(name.replace("\\", "/").rpartition("/")[2]).suffix.lower()
    if suffix not in MESHES + DRAWINGS:
        raise InputError(
            f"{short(name)} is no mesh and no drawing: give a file that ends in {' '.join(MESHES + DRAWINGS)}"
        )
    folder.mkdir(parents=True, exist_ok=True)
    room = MOST - sum(file.stat().st_size for file in folder.iterdir())
    partial = folder / f".{os.urandom(8).hex()}.part"
    digest, size = hashlib.sha256(), 0
    try:
        with partial.open("wb") as stream:
            async for chunk in chunks:
                size += len(chunk)
                if size > LARGEST:
                    raise TooLarge(f"{short(name)} is larger than {LARGEST >> 20} MB: make it smaller")
                if size > room:
                    raise TooLarge(f"{folder} holds {MOST >> 30} GB already: remove what is not needed there")
                digest.update(chunk)
                stream.write(chunk)
        if not size:
            raise InputError(f"{short(name)} is empty")
        identity = digest.hexdigest() + suffix
        publish([(partial, folder / identity)])
    finally:
        partial.unlink(missing_ok=True)
    return identity


def path_of(folder: Path, identity: object) -> Path:
    """Return the file that an id stands for.

    Raises:
        InputError: there is none.
    """
    endings = "|".join(re.escape(suffix) for suffix in MESHES + DRAWINGS)
    if not isinstance(identity, str) or not re.fullmatch(rf"[0-9a-f]{{64}}({endings})", identity):
        raise InputError(f"{short(identity)} is no upload: send the file to /api/uploads first")
    path = folder / identity
    if not path.is_file():
        raise InputError(f"{short(identity)} is not here any more: send the file again")
    return path
