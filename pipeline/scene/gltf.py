"""A textured mesh as binary glTF 2.0 (the Khronos specification, sections 3 and 4), the same bytes every
time.

+Y up, front +Z, metres. The material is unlit (KHR_materials_unlit): the texture holds the light that the
diffusion model painted, and lighting it again would darken it twice. Viewers without the extension see a
rough dielectric.
"""

from __future__ import annotations

import json
import struct
from typing import Any

from pipeline.scene.mesh import SplitMesh

FLOAT, UNSIGNED_INT = 5126, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
LINEAR, LINEAR_MIPMAP_LINEAR, CLAMP_TO_EDGE = 9729, 9987, 33071
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"


def glb_bytes(mesh: SplitMesh, png: bytes, name: str) -> bytes:
    """Return a GLB file of one mesh with one base-colour texture (8-bit sRGB PNG) inside.

    `name` is shown by viewers as the name of the object. Vertices at chart borders are repeated: `mesh` says
    where.
    """
    parts: list[tuple[bytes, int | None]] = [
        (mesh.vertices.astype("<f4").tobytes(), ARRAY_BUFFER),
        (mesh.normals.astype("<f4").tobytes(), ARRAY_BUFFER),
        (mesh.uv.astype("<f4").tobytes(), ARRAY_BUFFER),
        (mesh.faces.astype("<u4").tobytes(), ELEMENT_ARRAY_BUFFER),
        (png, None),
    ]
    views: list[dict[str, int]] = []
    binary = b""
    for data, target in parts:
        view = {"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)}
        views.append(view if target is None else {**view, "target": target})
        binary += data + b"\0" * (-len(data) % 4)
    count = len(mesh.vertices)
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "latent-nerf-onnx"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name}],
        "meshes": [
            {
                "name": name,
                "primitives": [
                    {"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}, "indices": 3, "material": 0}
                ],
            }
        ],
        "materials": [
            {
                "name": "albedo",
                "pbrMetallicRoughness": {
                    "baseColorTexture": {"index": 0},
                    "metallicFactor": 0.0,
                    "roughnessFactor": 1.0,
                },
                "extensions": {"KHR_materials_unlit": {}},
            }
        ],
        "textures": [{"sampler": 0, "source": 0}],
        "images": [{"name": "albedo", "mimeType": "image/png", "bufferView": 4}],
        "samplers": [
            {
                "magFilter": LINEAR,
                "minFilter": LINEAR_MIPMAP_LINEAR,
                "wrapS": CLAMP_TO_EDGE,
                "wrapT": CLAMP_TO_EDGE,
            }
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": FLOAT,
                "count": count,
                "type": "VEC3",
                "min": mesh.vertices.min(axis=0).tolist(),
                "max": mesh.vertices.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": FLOAT, "count": count, "type": "VEC3"},
            {"bufferView": 2, "componentType": FLOAT, "count": count, "type": "VEC2"},
            {"bufferView": 3, "componentType": UNSIGNED_INT, "count": mesh.faces.size, "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), JSON_CHUNK) + text
    body += struct.pack("<I4s", len(binary), BINARY_CHUNK) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
