"""CLIP's vocabulary, which single-file checkpoints lack, from the package open_clip_torch.

The file of merges is read where the package is installed; the package itself is never imported. It is
installed without its dependencies: PyPI's torchvision does not load beside the CPU build of torch, and then
diffusers does not either.
"""

from __future__ import annotations

import gzip
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from pipeline.errors import InputError

MERGES = 49152 - 256 - 2
_FILE = "open_clip/bpe_simple_vocab_16e6.txt.gz"


def clip_merges() -> list[tuple[str, str]]:
    """Return CLIP's 48,894 merges in order.

    Raises InputError when open_clip_torch is not installed.
    """
    try:
        path = Path(str(distribution("open_clip_torch").locate_file(_FILE)))
    except PackageNotFoundError:
        raise InputError(
            "open_clip_torch is not installed, expected it for CLIP's vocabulary: "
            "pip install --no-deps open_clip_torch"
        ) from None
    lines = gzip.decompress(path.read_bytes()).decode("utf-8").split("\n")[1 : MERGES + 1]
    pairs = [line.split(" ") for line in lines]
    return [(first, second) for first, second in pairs]
