"""The pictures that a mesh file brings along, checked before any is decoded.

Pillow guesses a format from the bytes, whatever the name says, and one of those that it guesses (EPS) it
hands to a program that executes it. trimesh opens what a file names as any of them, and goes on without a
picture that fails.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

from PIL import Image

from pipeline.errors import InputError
from pipeline.mesh.companion_files import colour_files
from pipeline.mesh.gltf_document import data_of, open_document
from pipeline.mesh.gltf_json import gltf_fault

FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "GIF", "TIFF", "TGA")
MOST_TEXELS = 8192**2
"""Of one picture; also of all that are shown together: they are floats in memory, 12 bytes a texel."""


def check_pictures(path: Path) -> None:
    """Raise InputError unless every picture that a mesh file names or holds is one, and not too large."""
    for name, data in _pictures(path):
        try:
            with Image.open(io.BytesIO(data), formats=FORMATS) as image:
                width, height = image.size
                if width * height <= MOST_TEXELS:
                    image.verify()
        except Exception as error:  # pillow lets nearly everything escape
            said = " ".join(str(error).split())[:120] or type(error).__name__
            if "cannot identify" in said:  # and what it calls the bytes helps nobody
                said = f"it begins with {data[:8]!r}, expected {', '.join(FORMATS)}"
            raise InputError(f"{name}: not a readable picture ({said}); export the texture again") from None
        if width * height > MOST_TEXELS:
            raise InputError(
                f"{name}: {width} x {height} texels, expected {MOST_TEXELS} at most; make it smaller"
            )


def _pictures(path: Path) -> Iterator[tuple[str, bytes]]:
    """Yield what to call each picture, and its bytes: the files beside, then those inside a glTF file.

    Raises InputError for one that is not there.
    """
    for file in colour_files(path):
        if file.suffix.lower() != ".mtl":
            yield str(file), file.read_bytes()
    if path.suffix.lower() not in (".glb", ".gltf"):
        return
    document = open_document(path)
    try:
        for row, image in enumerate(document.json.get("images", [])):
            uri, view = image.get("uri"), image.get("bufferView")
            if uri is None:
                yield f"{path}: its picture {row}", document.view(view)
            elif uri.startswith("data:"):
                yield f"{path}: its picture {row}", data_of(uri)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError(f"{path}: not valid glTF ({gltf_fault(error)}); export it again") from None
