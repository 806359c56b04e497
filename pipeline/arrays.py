"""Named arrays as bytes: .npz with fixed timestamps and order, so that equal arrays are equal bytes."""

import io
import zipfile
from collections.abc import Mapping

import numpy as np

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
        ValueError: the bytes are no such archive, are damaged, or hold pickled objects.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (zipfile.BadZipFile, EOFError, OSError, KeyError, AttributeError) as error:
        raise ValueError(f"not a readable .npz archive: {error}") from None
