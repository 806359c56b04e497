"""Zip files of the same bytes every time."""

import io
import zipfile
from collections.abc import Sequence

EPOCH = (1980, 1, 1, 0, 0, 0)
"""The earliest date that a zip file can hold: the clock is no part of an asset."""


def zipped(files: Sequence[tuple[str, bytes]], compressed: bool, align: int = 1) -> bytes:
    """Return a zip file of named contents, in their order; the data of each, where it is not compressed,
    begins at a multiple of `align` bytes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in files:
            info = zipfile.ZipInfo(name, EPOCH)
            info.compress_type = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
            if align > 1:
                begin = stream.tell() + 30 + len(name.encode("utf-8"))
                gap = -(begin + 4) % align  # an extra field has four bytes of its own
                info.extra = b"\x86\x19" + gap.to_bytes(2, "little") + b"\0" * gap
            archive.writestr(info, content)
    return stream.getvalue()
