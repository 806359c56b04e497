"""A painted glTF file given back as it came: the same document with new texture coordinates, image and
materials.

Nodes, names, skins, animations, morph targets, normals, extras, primitives and every number in them stay. A
vertex on a border of charts is repeated at the end of its primitive's, so the others keep their places.

Letters: f triangles, v vertices of a primitive, e repeated ones, n elements, k components.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pipeline.mesh.companion_files import beside
from pipeline.mesh.gltf import (
    ARRAY_BUFFER,
    ELEMENT_ARRAY_BUFFER,
    FLOAT,
    SAMPLER,
    UNSIGNED_INT,
    container,
)
from pipeline.mesh.gltf_document import Document
from pipeline.mesh.gltf_reader import TRIANGLES, Piece
from pipeline.mesh.materials import Material
from pipeline.paint.gltf_materials import Painter, drop_unused

LARGEST = {5121: 254, 5123: 65_534, UNSIGNED_INT: 2**32 - 2}
"""The greatest index of each type; the one above restarts strips."""
MIME = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}


class Corners(NamedTuple):
    """What the corners of a piece's triangles show."""

    rows: Int[np.ndarray, "f 3"]
    """Of `values`."""
    values: Float[np.ndarray, "n k"]
    """Texture points (k = 2), or linear colours (k = 3)."""


class Split(NamedTuple):
    """A primitive whose vertices have one value each."""

    corners: Int[np.ndarray, "f 3"]
    """Rows of the vertices and, after them, of the repeated ones."""
    repeated: Int[np.ndarray, " e"]
    """The vertices that are repeated."""
    values: Float[np.ndarray, "n k"]
    """Of all of both; zeros at vertices without a triangle."""


def split(faces: Int[np.ndarray, "f 3"], corners: Corners, count: int) -> Split:
    """Return `count` vertices and those repeated because their triangles differ in value."""
    pairs = np.stack([faces.ravel(), corners.rows.ravel()], axis=1)
    unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
    first = np.ones(len(unique), bool)
    first[1:] = unique[1:, 0] != unique[:-1, 0]
    place = np.where(first, unique[:, 0], 0)
    place[~first] = count + np.arange((~first).sum())
    values = np.zeros((count + int((~first).sum()), corners.values.shape[1]))
    values[place] = corners.values[unique[:, 1]]
    return Split(place[inverse.reshape(-1, 3)], unique[~first, 0], values)


def painted_glb(
    document: Document,
    pieces: Sequence[Piece],
    painted: Sequence[Corners],
    png: bytes | None,
    material: Material,
    folder: Path,
) -> bytes:
    """Return the document as a GLB file with the pieces painted.

    Args:
        folder: where the file lies; images beside it that are still used come into the result.
        painted: for every piece what its corners show, in the order of its triangles as the file winds them:
            texture points if there is a `png` (8-bit sRGB), else colours.
    """
    file = _File(document)
    texture = None if png is None else file.add_texture(png)
    own_uv = png is not None and all(
        piece.uv is not None
        and np.array_equal(np.clip(piece.uv, 0, 1)[piece.faces], shown.values[shown.rows])
        for piece, shown in zip(pieces, painted, strict=True)
    )
    moved = png is not None and not own_uv
    painter = Painter(file.json, {(p.mesh, p.primitive) for p in pieces}, texture, material, moved=moved)
    shown_by = dict[int, int]()
    copies = dict[int, int]()
    for piece, corners in zip(pieces, painted, strict=True):
        again = shown_by.setdefault(piece.mesh, piece.node) != piece.node and not own_uv
        if again and piece.node not in copies:  # another node shows this mesh, in its own colours
            copies[piece.node] = len(file.json["meshes"])
            file.json["meshes"].append(copy.deepcopy(document.json["meshes"][piece.mesh]))
            file.json["nodes"][piece.node]["mesh"] = copies[piece.node]
        row = copies.get(piece.node, piece.mesh)
        primitive = file.json["meshes"][row]["primitives"][piece.primitive]
        given = document.json["meshes"][piece.mesh]["primitives"][piece.primitive]
        painter.paint(primitive, given.get("material"))
        attributes = primitive["attributes"]
        if png is not None and "COLOR_0" in attributes:  # it would tint the texture
            attributes["_COLOR_0"] = attributes.pop("COLOR_0")
        if own_uv:
            continue
        name, kept = (
            ("COLOR_0", "_COLOR_0") if png is None else ("TEXCOORD_0", f"TEXCOORD_{painter.free_set}")
        )
        if name in attributes and (png is None or painter.reads_old_uv(primitive["material"])):
            attributes[kept] = attributes[name]
        file.write(primitive, split(piece.faces, corners, len(piece.vertices)), name)
    painter.finish()
    return file.packed(folder)


class _File:
    """The document while it is changed; arrays are appended, and what is not used any more dropped at the
    end."""

    def __init__(self, document: Document) -> None:
        self.given = document
        self.json: dict[str, Any] = copy.deepcopy(document.json)
        self.added: dict[int, bytes] = {}
        self.repeats: dict[tuple[int, bytes], int] = {}
        for view in self.json.get("bufferViews", []):  # of an extension: where its data would be compressed
            view.pop("extensions", None)

    def view(self, data: bytes, **more: int) -> int:
        """Append a buffer view and return its row."""
        views = self.json.setdefault("bufferViews", [])
        views.append({"buffer": 0, "byteOffset": 0, "byteLength": len(data), **more})
        self.added[len(views) - 1] = data
        return len(views) - 1

    def accessor(self, view: int, **described: Any) -> int:
        """Append an accessor and return its row."""
        self.json.setdefault("accessors", []).append({"bufferView": view, **described})
        return len(self.json["accessors"]) - 1

    def add_texture(self, png: bytes) -> int:
        """Append image, sampler and texture; return the texture's row."""
        image = {"name": "albedo", "mimeType": "image/png", "bufferView": self.view(png)}
        for name, value in (("images", image), ("samplers", {**SAMPLER})):
            self.json.setdefault(name, []).append(value)
        texture = {"sampler": len(self.json["samplers"]) - 1, "source": len(self.json["images"]) - 1}
        self.json.setdefault("textures", []).append(texture)
        return len(self.json["textures"]) - 1

    def write(self, primitive: dict[str, Any], made: Split, name: str) -> None:
        """Give a primitive its values under the attribute `name`, and repeat the vertices that need it."""
        attributes = primitive["attributes"]
        attributes.pop(name, None)
        if len(made.repeated):
            for group in (attributes, *primitive.get("targets", [])):
                for attribute, row in group.items():
                    group[attribute] = self._repeated(row, made.repeated)
            primitive["indices"] = self._indices(primitive.get("indices"), made.corners)
            if primitive.get("mode", TRIANGLES) != TRIANGLES:
                primitive["mode"] = TRIANGLES
        values = made.values.astype("<f4")
        view = self.view(values.tobytes(), target=ARRAY_BUFFER)
        kind = f"VEC{values.shape[1]}"
        attributes[name] = self.accessor(view, componentType=FLOAT, count=len(values), type=kind)

    def _repeated(self, row: int, vertices: Int[np.ndarray, " e"]) -> int:
        """Return an accessor with the elements of these vertices after its own."""
        key = row, vertices.tobytes()
        if key not in self.repeats:
            stored = self.given.elements(row)
            whole = np.concatenate([stored, stored[vertices]])
            data = whole.view(np.uint8).reshape(len(whole), -1)
            padded = np.pad(data, ((0, 0), (0, -data.shape[1] % 4)))
            stride = {"byteStride": padded.shape[1]} if padded.shape[1] != data.shape[1] else {}
            view = self.view(padded.tobytes(), target=ARRAY_BUFFER, **stride)
            described = {**self.given.json["accessors"][row], "count": len(whole)}
            for gone in ("bufferView", "byteOffset", "sparse"):
                described.pop(gone, None)
            self.repeats[key] = self.accessor(view, **described)
        return self.repeats[key]

    def _indices(self, row: int | None, corners: Int[np.ndarray, "f 3"]) -> int:
        """Return an accessor of the corners, as wide as the one before if that is wide enough."""
        given = {} if row is None else self.given.json["accessors"][row]
        kind = given.get("componentType", 5123)
        kind = next(k for k, most in LARGEST.items() if k >= kind and corners.max() <= most)
        data = corners.astype({5121: "<u1", 5123: "<u2", UNSIGNED_INT: "<u4"}[kind])
        view = self.view(data.tobytes(), target=ELEMENT_ARRAY_BUFFER)
        kept = {name: value for name, value in given.items() if name in ("name", "extras")}
        return self.accessor(view, componentType=kind, count=corners.size, type="SCALAR", **kept)

    def packed(self, folder: Path) -> bytes:
        """Return the GLB file: what is used, in one buffer, in its order."""
        self._take_images(folder)
        views: list[dict[str, Any]] = self.json.get("bufferViews", [])
        data = {id(view): self.added.get(row) for row, view in enumerate(views)}
        rows = {id(view): row for row, view in enumerate(views)}
        drop_unused(self.json)
        binary = bytearray()
        for view in self.json.get("bufferViews", []):
            content = data[id(view)]
            if content is None:
                content = self.given.view(rows[id(view)])
            view |= {"buffer": 0, "byteOffset": len(binary), "byteLength": len(content)}
            binary += content + b"\0" * (-len(content) % 4)
        self.json.pop("buffers", None)
        if binary:
            self.json["buffers"] = [{"byteLength": len(binary)}]
        return container(self.json, bytes(binary))

    def _take_images(self, folder: Path) -> None:
        """Put images beside the file into the buffer; what is not there stays as it is named."""
        for image in self.json.get("images", []):
            uri = image.get("uri", "data:")
            file = None if uri.startswith("data:") else beside(folder, uri)
            if file is not None and (kind := MIME.get(file.suffix.lower())):
                del image["uri"]
                image |= {"mimeType": kind, "bufferView": self.view(file.read_bytes())}
