"""PLY, as scanners' and researchers' tools read it: colours at the vertices and texture coordinates."""

from __future__ import annotations

import numpy as np

from pipeline.formats.asset import Asset


def ply_bytes(asset: Asset, texture: str) -> bytes:
    """Return a binary PLY file: positions [m, +Y up], normals where there are any, 8-bit sRGB colours, and
    texture coordinates (s, t; origin at the bottom left) of the picture `texture`, which lies beside it."""
    columns = [(name, "<f4", asset.vertices[:, axis]) for axis, name in enumerate("xyz")]
    if asset.normals is not None:
        columns += [(f"n{name}", "<f4", asset.normals[:, axis]) for axis, name in enumerate("xyz")]
    if asset.uv is not None:
        columns += [("s", "<f4", asset.uv[:, 0]), ("t", "<f4", 1 - asset.uv[:, 1])]
    bytes_of = np.rint(255 * asset.colours)
    columns += [(name, "u1", bytes_of[:, axis]) for axis, name in enumerate(("red", "green", "blue"))]
    points = np.empty(len(asset.vertices), [(name, kind) for name, kind, _ in columns])
    for name, _, values in columns:
        points[name] = values
    corners = np.empty(len(asset.faces), [("count", "u1"), ("rows", "<i4", 3)])
    corners["count"], corners["rows"] = 3, asset.faces
    kinds = {"<f4": "float", "u1": "uchar"}
    head = [
        "ply",
        "format binary_little_endian 1.0",
        *([f"comment TextureFile {texture}"] if asset.uv is not None else []),
        f"element vertex {len(points)}",
        *(f"property {kinds[kind]} {name}" for name, kind, _ in columns),
        f"element face {len(corners)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    return "\n".join(head).encode("ascii") + points.tobytes() + corners.tobytes()
