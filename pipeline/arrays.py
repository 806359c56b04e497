"""Named arrays as bytes: .npz with fixed timestamps and order, so that equal arrays are equal bytes."""

import io
import math
import zipfile
from collections.abc import Mapping

import numpy as np

# A .npy file is no archive (TypeError); an encrypted member is a RuntimeError.
_DAMAGE = (zipfile.BadZipFile, EOFError, OSError, KeyError, AttributeError, TypeError, RuntimeError)
_EPOCH = (1980, 1, 1, 0, 0, 0)


def pack(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return an uncompressed .npz archive, which `numpy.load` reads too."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", _EPOCH), member.getvalue())
    return stream.getvalue()


def unpack(data: bytes) -> dict[str, np.ndarray]:
    """Return the arrays of a .npz archive.

    Raises:
        ValueError: the bytes are no such archive, are damaged, packed, hold pickled objects, or claim more
            than they have.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            claimed = sum(_claimed(archive.zip, member) for member in archive.zip.infolist())
            if claimed > len(data):
                raise ValueError(f"its arrays claim {claimed} bytes, the archive has {len(data)}")
            return {name: archive[name] for name in archive.files}
    except _DAMAGE as error:
        raise ValueError(f"not a readable .npz archive: {error}") from None


def _claimed(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> int:
    """Return the bytes that an array would take in memory. Raises ValueError for a packed one, which could
    hold a thousand times its size."""
    if member.compress_type != zipfile.ZIP_STORED:
        raise ValueError(f"{member.filename} is packed")
    with archive.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        if version not in read:
            raise ValueError(f"{member.filename} is of version {version}")
        shape, _, kind = read[version](stream)
    return max(math.prod(shape) * kind.itemsize, member.file_size)
