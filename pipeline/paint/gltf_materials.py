"""The materials of a glTF document once its primitives are painted, and what nothing uses any more.

A painted material keeps its name, extras, sidedness, normal map and occlusion; its colour is the painting,
and metallic and roughness are the prompt's. Emission, transparency and other extensions would show other
colours than those painted, and go.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any

from pipeline.documents import whole_number
from pipeline.mesh.gltf import material_properties
from pipeline.mesh.materials import Material

UNLIT = "KHR_materials_unlit"
TRANSFORM = "KHR_texture_transform"
KEPT = ("name", "extras", "doubleSided", "normalTexture", "occlusionTexture")
KNOWN = ("KHR_lights_punctual", "KHR_materials_variants")
"""Extensions of the whole document that refer to no texture, image, accessor or buffer view."""


class Painter:
    """The materials while primitives are painted."""

    def __init__(
        self,
        json: dict[str, Any],
        painted: set[tuple[int, int]],
        texture: int | None,
        material: Material,
        *,
        moved: bool,
    ) -> None:
        """`painted` has rows of meshes and primitives; `moved`: texture coordinates that were the first are
        those of `free_set`, where a normal map or occlusion reads them."""
        primitives = [
            ((row, i), primitive)
            for row, mesh in enumerate(json.get("meshes", []))
            for i, primitive in enumerate(mesh["primitives"])
        ]
        sets = [
            whole_number(name.removeprefix("TEXCOORD_")) or 0
            for _, primitive in primitives
            for name in primitive["attributes"]
        ]
        self.free_set = max([0, *sets]) + 1
        self._json, self._texture, self._material, self._moved = json, texture, material, moved
        self._others = {p.get("material") for place, p in primitives if place not in painted}
        self._rows = dict[int | None, int]()
        self._old_uv = set[int]()

    def paint(self, primitive: dict[str, Any], given: int | None) -> None:
        """Give a primitive the painted form of its material; None: the file gave it none."""
        if given not in self._rows:
            self._rows[given] = self._painted(given)
        primitive["material"] = self._rows[given]

    def reads_old_uv(self, row: int) -> bool:
        """Whether a painted material has a texture that reads the file's first texture coordinates."""
        return row in self._old_uv

    def _painted(self, given: int | None) -> int:
        materials: list[dict[str, Any]] = self._json.setdefault("materials", [])
        old: dict[str, Any] = {"name": "albedo"} if given is None else materials[given]
        made = {name: copy.deepcopy(value) for name, value in old.items() if name in KEPT}
        made |= material_properties(self._material, self._texture)
        row = len(materials) if given is None or given in self._others else given
        for name in ("normalTexture", "occlusionTexture"):
            info = made.get(name, {})
            transform = info.get("extensions", {}).get(TRANSFORM, {})
            place = transform if "texCoord" in transform else info
            if info and place.get("texCoord", 0) == 0:
                self._old_uv.add(row)
                if self._moved:
                    place["texCoord"] = self.free_set
        materials[row : row + 1] = [made]
        return row

    def finish(self) -> None:
        """List the extensions of materials and textures that are used."""
        text = set(_keys([self._json.get(name) for name in ("materials", "textures", "meshes")]))
        names = [
            name
            for name in self._json.get("extensionsUsed", [])
            if not name.startswith(("KHR_materials_", "KHR_texture_", "EXT_texture_")) or name in text
        ]
        if UNLIT in text and UNLIT not in names:
            names.append(UNLIT)
        required = [name for name in self._json.get("extensionsRequired", []) if name in names]
        for key, values in (("extensionsUsed", names), ("extensionsRequired", required)):
            self._json.pop(key, None)
            if values:
                self._json[key] = values


def drop_unused(json: dict[str, Any]) -> None:
    """Remove textures, images, accessors and buffer views that nothing refers to; the others count anew.

    Nothing is removed where an extension of the document, or instancing, may refer to them by other names.
    """
    if set(json.get("extensions", {})) - {*KNOWN} or "EXT_mesh_gpu_instancing" in json.get(
        "extensionsUsed", []
    ):
        return
    _sweep(json, "textures", lambda: _texture_slots(json.get("materials", [])))
    _sweep(json, "images", lambda: _slots(json.get("textures", []), "source"))
    _sweep(json, "accessors", lambda: _accessor_slots(json))
    _sweep(json, "bufferViews", lambda: _slots([json.get("accessors"), json.get("images")], "bufferView"))


Slot = tuple[Any, Any]
"""A dict or list and the key of a row that it holds."""


def _sweep(json: dict[str, Any], name: str, slots: Callable[[], Iterator[Slot]]) -> None:
    used = sorted({holder[key] for holder, key in slots()})
    new = {row: place for place, row in enumerate(used)}
    for holder, key in [*slots()]:
        holder[key] = new[holder[key]]
    if name in json:
        json[name] = [json[name][row] for row in used]
        if not used:
            del json[name]


def _slots(value: Any, key: str) -> Iterator[Slot]:
    """Give every place under a value where `key` holds a whole number."""
    if isinstance(value, dict):
        for name, inner in value.items():
            if name == key and isinstance(inner, int):
                yield value, name
            elif name != "extras":
                yield from _slots(inner, key)
    elif isinstance(value, list):
        for inner in value:
            yield from _slots(inner, key)


def _texture_slots(value: Any, named: bool = False) -> Iterator[Slot]:
    """Give every `index` of a texture: it stands in what is called something with "Texture"."""
    if isinstance(value, dict):
        for name, inner in value.items():
            if name == "index" and named:
                yield value, name
            elif name != "extras":
                yield from _texture_slots(inner, name.lower().endswith("texture"))
    elif isinstance(value, list):
        for inner in value:
            yield from _texture_slots(inner)


def _accessor_slots(json: dict[str, Any]) -> Iterator[Slot]:
    for mesh in json.get("meshes", []):
        for primitive in mesh["primitives"]:
            for group in (primitive["attributes"], *primitive.get("targets", [])):
                yield from ((group, name) for name in group)
            if "indices" in primitive:
                yield primitive, "indices"
    for skin in json.get("skins", []):
        if "inverseBindMatrices" in skin:
            yield skin, "inverseBindMatrices"
    for animation in json.get("animations", []):
        for sampler in animation["samplers"]:
            yield from ((sampler, name) for name in ("input", "output"))


def _keys(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield name
            yield from _keys(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _keys(inner)
