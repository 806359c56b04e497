"""A textured mesh as binary glTF 2.0 (the Khronos specification, sections 3 and 4), the same bytes every
time.

+Y up, front +Z, metres. The material is metallic-roughness, or unlit (KHR_materials_unlit): the texture as it
is, with the light that the diffusion model painted and no other.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pipeline.mesh.materials import Material

FLOAT, UNSIGNED_INT = 5126, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
LINEAR, LINEAR_MIPMAP_LINEAR, CLAMP_TO_EDGE = 9729, 9987, 33071
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"
GENERATOR = "latent-nerf-onnx"
SAMPLER = {
    "magFilter": LINEAR,
    "minFilter": LINEAR_MIPMAP_LINEAR,
    "wrapS": CLAMP_TO_EDGE,
    "wrapT": CLAMP_TO_EDGE,
}


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
    tangents: Float[np.ndarray, "c 4"] | None = None
    """Unit, in the direction of growing u, and the sign of the bitangent: what a normal map refers to."""
    colours: Float[np.ndarray, "c 3"] | None = None
    """Linear light in [0, 1], as glTF wants vertex colours."""


def glb_bytes(
    parts: Sequence[Part],
    png: bytes | str | None,
    material: Material,
    *,
    name: str = "albedo",
    normal_png: bytes | str | None = None,
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0),
    double_sided: bool = False,
) -> bytes:
    """Return a GLB file of a mesh in named parts that share one material, called `name`; `png`, its
    base-colour texture (8-bit sRGB), and `normal_png`, its normal map in tangent space, are inside; or, where
    these are names, files beside it.

    `translation` moves the whole: float32 positions far from the origin would lose digits, a node's
    translation does not. Vertices at chart borders are repeated: `Part` holds them so.
    """
    file = _Buffer()
    nodes: list[dict[str, Any]] = []
    meshes: list[dict[str, Any]] = []
    for row, part in enumerate(parts):
        attributes = {"POSITION": file.add(part.vertices, "VEC3", ARRAY_BUFFER, bounds=True)}
        for attribute, values, kind in (
            ("NORMAL", part.normals, "VEC3"),
            ("TANGENT", part.tangents, "VEC4"),
            ("TEXCOORD_0", part.uv, "VEC2"),
            ("COLOR_0", part.colours, "VEC3"),
        ):
            if values is not None:
                attributes[attribute] = file.add(values, kind, ARRAY_BUFFER)
        indices = file.add(part.faces, "SCALAR", ELEMENT_ARRAY_BUFFER)
        primitive = {"attributes": attributes, "indices": indices, "material": 0}
        meshes.append({"name": part.name, "primitives": [primitive]})
        nodes.append({"mesh": row, "name": part.name})
    roots = [*range(len(nodes))]
    if any(translation):
        nodes.append({"name": "place", "translation": [*translation], "children": roots})
        roots = [len(nodes) - 1]
    images = [
        (label, image) for label, image in (("albedo", png), ("normal", normal_png)) if image is not None
    ]
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": GENERATOR},
        **({"extensionsUsed": ["KHR_materials_unlit"]} if material.unlit else {}),
        "scene": 0,
        "scenes": [{"nodes": roots}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [
            {
                "name": name,
                **material_properties(material, 0 if png is not None else None),
                **({"normalTexture": {"index": len(images) - 1}} if normal_png is not None else {}),
                **({"doubleSided": True} if double_sided else {}),
            }
        ],
    }
    if images:
        document |= _textures([_image(label, image, file) for label, image in images])
    document |= file.description()
    return container(document, bytes(file.binary))


def container(document: dict[str, Any], binary: bytes) -> bytes:
    """Return a GLB file of a document and the bytes of its one buffer (a multiple of four)."""
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), JSON_CHUNK) + text
    if binary:
        body += struct.pack("<I4s", len(binary), BINARY_CHUNK) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def material_properties(material: Material, texture: int | None) -> dict[str, Any]:
    """Return what a glTF material says of light; `texture` is the row of its base colour (None: white)."""
    factors = {"metallicFactor": material.metallic, "roughnessFactor": material.roughness}
    colour = {} if texture is None else {"baseColorTexture": {"index": texture}}
    unlit: dict[str, Any] = {"extensions": {"KHR_materials_unlit": {}}} if material.unlit else {}
    return {"pbrMetallicRoughness": {**colour, **factors}, **unlit}


def _image(name: str, image: bytes | str, file: _Buffer) -> dict[str, Any]:
    if isinstance(image, str):
        return {"name": name, "uri": image}
    return {"name": name, "mimeType": "image/png", "bufferView": file.append(image)}


def _textures(images: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "textures": [{"sampler": 0, "source": row} for row in range(len(images))],
        "images": images,
        "samplers": [SAMPLER],
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
