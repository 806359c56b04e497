"""The asset turning once: H.264 in MP4, playable by browsers, the same bytes every time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import av
import numpy as np

from pipeline.mesh.mesh import Mesh
from pipeline.report.png import to_bytes
from pipeline.report.preview import Shade, pictures, turn

FRAMES_PER_SECOND = 24
LEAST_SECONDS = 3
"""Of one turn: few frames are shown more slowly."""
SUPERSAMPLING = 2  # motion and the codec hide what more would add
QUALITY = "18"  # x264's constant rate factor: no visible loss


def write_turntable(
    path: Path,
    mesh: Mesh,
    shade: Shade,
    size: int,
    frames: int,
    tell: Callable[[int], None] = lambda done: None,
) -> None:
    """Write one turn of the mesh in `frames` pictures of `size` x `size` pixels (made even: 4:2:0
    wants it).
    """
    size += size % 2
    # The bytes depend on the pictures alone: one thread, no encoder's name or date in the file, no macroblock
    # tree (with it the first video of a process had other bytes in 4 of 14 processes, without it in 0 of 36).
    options = {"movflags": "faststart", "fflags": "+bitexact"}
    with av.open(str(path), "w", format="mp4", options=options) as container:
        stream = container.add_stream(
            "libx264",
            rate=max(1, min(FRAMES_PER_SECOND, frames // LEAST_SECONDS)),
            options={"crf": QUALITY, "preset": "medium", "threads": "1", "x264-params": "mbtree=0"},
        )
        stream.width = stream.height = size
        stream.pix_fmt = "yuv420p"
        views = pictures(mesh, turn(mesh, frames), size, shade, SUPERSAMPLING)
        for done, image in enumerate(map(to_bytes, views), 1):
            container.mux(
                stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24"))
            )
            tell(done)
        container.mux(stream.encode())
