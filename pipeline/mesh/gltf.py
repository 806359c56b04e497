"""A textured mesh as binary glTF 2.0 (the Khronos specification, sections 3 and 4), the same bytes every
time.

+Y up, front +Z, metres. The material is unlit (KHR_materials_unlit): the texture holds the light that the
diffusion model painted, and lighting it again would darken it twice. Viewers without the extension see a
rough dielectric.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

FLOAT, UNSIGNED_INT = 5126, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
LINEAR, LINEAR_MIPMAP_LINEAR, CLAMP_TO_EDGE = 9729, 9987, 33071
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"


class Part(NamedTuple):
    """One named piece, with one index for everything: vertices are repeated where texture points or colours
    differ."""

    name: str
    vertices: Float[np.ndarray, "c 3"]
    """float32"""
    faces: Int[np.ndarray, "f 3"]
    normals: Float[np.ndarray, "c 3"] | None = None
    """Unit; without any, viewers show every face flat."""
    uv: Float[np.ndarray, "c 2"] | None = None
    colours: Float[np.ndarray, "c 3"] | None = None
    """Linear light in [0, 1], as glTF wants vertex colours."""


def glb_bytes(
    parts: Sequence[Part],
    png: bytes | None,
    *,
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0),
    double_sided: bool = False,
) -> bytes:
    """Return a GLB file of a mesh in named parts that share one material; `png`, its base-colour texture
    (8-bit sRGB), is inside.

    `translation` moves the whole: float32 positions far from the origin would lose digits, a node's
    translation does not. Vertices at chart borders are repeated: `Part` holds them so.
    """
    file = _Buffer()
    nodes: list[dict[str, Any]] = []
    meshes: list[dict[str, Any]] = []
    for row, part in enumerate(parts):
        attributes = {"POSITION": file.add(part.vertices, "VEC3", ARRAY_BUFFER, bounds=True)}
        for name, values, kind in (
            ("NORMAL", part.normals, "VEC3"),
            ("TEXCOORD_0", part.uv, "VEC2"),
            ("COLOR_0", part.colours, "VEC3"),
        ):
            if values is not None:
                attributes[name] = file.add(values, kind, ARRAY_BUFFER)
        indices = file.add(part.faces, "SCALAR", ELEMENT_ARRAY_BUFFER)
        primitive = {"attributes": attributes, "indices": indices, "material": 0}
        meshes.append({"name": part.name, "primitives": [primitive]})
        nodes.append({"mesh": row, "name": part.name})
    roots = [*range(len(nodes))]
    if any(translation):
        nodes.append({"name": "place", "translation": [*translation], "children": roots})
        roots = [len(nodes) - 1]
    look = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
    textured = {"baseColorTexture": {"index": 0}} if png is not None else {}
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "latent-nerf-onnx"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": roots}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [
            {
                "name": "albedo",
                "pbrMetallicRoughness": {**textured, **look},
                **({"doubleSided": True} if double_sided else {}),
                "extensions": {"KHR_materials_unlit": {}},
            }
        ],
    }
    if png is not None:
        document |= _texture(file.append(png))
    document |= file.description()
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), JSON_CHUNK) + text
    body += struct.pack("<I4s", len(file.binary), BINARY_CHUNK) + file.binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _texture(view: int) -> dict[str, Any]:
    sampler = {"magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR}
    return {
        "textures": [{"sampler": 0, "source": 0}],
        "images": [{"name": "albedo", "mimeType": "image/png", "bufferView": view}],
        "samplers": [{**sampler, "wrapS": CLAMP_TO_EDGE, "wrapT": CLAMP_TO_EDGE}],
    }


class _Buffer:
    """The binary chunk while it grows, and what describes it."""

    def __init__(self) -> None:
        self.binary = bytearray()
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []

    def append(self, data: bytes, target: int | None = None) -> int:
        """Add bytes, aligned to four, and return the row of their view."""
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)}
        self.views.append(view if target is None else {**view, "target": target})
        self.binary += data + b"\0" * (-len(data) % 4)
        return len(self.views) - 1

    def add(self, values: np.ndarray, kind: str, target: int, bounds: bool = False) -> int:
        """Add an array and return the row of its accessor; `bounds`: say least and greatest values."""
        whole = kind == "SCALAR"
        data = values.astype("<u4" if whole else "<f4")
        accessor = {
            "bufferView": self.append(data.tobytes(), target),
            "componentType": UNSIGNED_INT if whole else FLOAT,
            "count": data.size if whole else len(data),
            "type": kind,
        }
        if bounds:
            accessor |= {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def description(self) -> dict[str, Any]:
        """Return what the JSON chunk says of the binary one."""
        return {
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.binary)}],
        }
