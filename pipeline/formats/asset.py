"""A finished asset, as its GLB file shows it.

Letters: v vertices (repeated on chart borders), f triangles.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from PIL import Image

from pipeline.mesh.bilinear import sample
from pipeline.mesh.coloured import to_srgb
from pipeline.mesh.gltf_document import Document
from pipeline.mesh.gltf_reader import Piece, read_gltf


class Asset(NamedTuple):
    """All parts in one, in metres: +Y up, front +Z, faces counter-clockwise seen from outside."""

    name: str
    """Of its first part."""
    vertices: Float[np.ndarray, "v 3"]
    """float64"""
    faces: Int[np.ndarray, "f 3"]
    normals: Float[np.ndarray, "v 3"] | None
    """Unit; None: some part has none and is flat."""
    uv: Float[np.ndarray, "v 2"] | None
    """Origin at the top left; None: it has no texture."""
    colours: Float[np.ndarray, "v 3"]
    """sRGB in [0, 1]: those of its vertices, or of the texture there."""
    albedo: bytes | None
    """Its texture, a PNG file."""
    normal_map: bytes | None
    """In tangent space, a PNG file; None: none, or the parts have several."""
    roughness: float
    metallic: float
    """Of its first material; both in [0, 1]."""


def read_asset(path: Path) -> Asset:
    """Return the asset of a GLB file that stage publish or publish_paint wrote.

    Raises:
        InputError: a file that cannot be read.
    """
    document, pieces = read_gltf(path)
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    faces = [
        (piece.faces[:, ::-1] if piece.mirrored else piece.faces) + start
        for piece, start in zip(pieces, starts, strict=False)
    ]
    normals = [piece.normals for piece in pieces if piece.normals is not None]
    material = _material(document, pieces[0])
    surface = material.get("pbrMetallicRoughness", {})
    albedo = _image(document, surface.get("baseColorTexture"))
    uv = None
    if albedo is not None:
        uv = np.concatenate([np.zeros((len(p.vertices), 2)) if p.uv is None else p.uv for p in pieces])
        with Image.open(io.BytesIO(albedo), formats=["PNG"]) as picture:
            texture = np.asarray(picture.convert("RGB"), np.float32) / 255
        colours = sample(texture, uv)
    else:
        colours = np.concatenate([_corner_colours(document, piece) for piece in pieces])
    one = all(_material(document, piece) == material for piece in pieces)
    bumps = material.get("normalTexture") if one else None
    if bumps and (bumps.get("texCoord", 0) != 0 or "extensions" in bumps):
        bumps = None  # it reads texture coordinates that no other format gets
    return Asset(
        pieces[0].name,
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate(faces),
        np.concatenate(normals) if len(normals) == len(pieces) else None,
        uv,
        np.clip(colours, 0, 1),
        albedo,
        _image(document, bumps),
        float(surface.get("roughnessFactor", 1.0)),
        float(surface.get("metallicFactor", 1.0)),
    )


def _material(document: Document, piece: Piece) -> dict[str, Any]:
    primitive = document.json["meshes"][piece.mesh]["primitives"][piece.primitive]
    row = primitive.get("material")
    return {} if row is None else document.json["materials"][row]


def _image(document: Document, info: dict[str, Any] | None) -> bytes | None:
    """Return the PNG file of a texture; None where there is none, or another kind of picture."""
    if info is None:
        return None
    image = document.json["images"][document.json["textures"][info["index"]]["source"]]
    if image.get("mimeType") != "image/png" or "bufferView" not in image:
        return None
    return document.view(image["bufferView"])


def _corner_colours(document: Document, piece: Piece) -> Float[np.ndarray, "v 3"]:
    """Return a piece's vertex colours as sRGB; white without any."""
    row = document.json["meshes"][piece.mesh]["primitives"][piece.primitive]["attributes"].get("COLOR_0")
    return to_srgb(document.values(row)[:, :3]) if row is not None else np.ones((len(piece.vertices), 3))
