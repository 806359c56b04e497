"""Multi-resolution hash grid over the box [-1, 1]^3 (Mueller et al. 2022, Instant NGP).

Letters: n points, l levels, 2 features a level, e table entries of all levels together.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

FEATURES = 2
"""Features a level (fixed: the kernels unroll them)."""


class HashGrid(NamedTuple):
    """The layout of a table: which cells a level has and where its entries lie."""

    resolutions: Int[np.ndarray, " l"]
    """Cells a side of each level, int32."""
    offsets: Int[np.ndarray, " l+1"]
    """First table entry of each level, int64; the last element is the number of entries."""

    @property
    def entries(self) -> int:
        """Number of table entries of all levels."""
        return int(self.offsets[-1])

    @property
    def width(self) -> int:
        """Number of features of an encoded point."""
        return FEATURES * len(self.resolutions)


def hash_grid(levels: int, coarsest: int, finest: int, table_log2: int) -> HashGrid:
    """Lay out `levels` resolutions in geometric progression with at most 2^`table_log2` entries each."""
    steps = np.arange(levels) / max(levels - 1, 1)
    resolutions = np.floor(coarsest * (finest / coarsest) ** steps + 1e-6).astype(np.int32)
    entries = np.minimum((resolutions.astype(np.int64) + 1) ** 3, 2**table_log2)
    return HashGrid(resolutions, np.concatenate([[0], np.cumsum(entries)]).astype(np.int64))
