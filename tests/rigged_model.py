"""A glTF model with everything that painting must keep: two materials, a rig of two joints that is animated,
a morph target with sparse numbers, vertex colours, a normal map, a mirrored mesh, extras, a camera, lines.

A tube along +Y bends at its middle; its lower half is one primitive, its upper half another.
"""

import io
import json
from typing import Any

import numpy as np
from PIL import Image

from pipeline.mesh.gltf import container

RINGS, SIDES = 9, 12
SCALE = 0.5
"""Of the armature, which moves the joints, and through them the mesh."""


class _File:
    def __init__(self) -> None:
        self.binary, self.views, self.accessors = bytearray(), list[dict[str, Any]](), list[dict[str, Any]]()

    def view(self, data: bytes, **more: int) -> int:
        self.views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **more})
        self.binary += data + b"\0" * (-len(data) % 4)
        return len(self.views) - 1

    def add(self, values: np.ndarray, kind: str, *, bounds: bool = False, **more: Any) -> int:
        types = {"f4": 5126, "u1": 5121, "u2": 5123}
        accessor = {"componentType": types[values.dtype.str[1:]], "count": len(values), "type": kind, **more}
        if bounds:
            flat = values.reshape(len(values), -1)
            accessor |= {"min": flat.min(0).tolist(), "max": flat.max(0).tolist()}
        target = {} if kind == "MAT4" or more.pop("plain", False) else {"target": 34962}
        accessor.pop("plain", None)
        self.accessors.append({"bufferView": self.view(values.tobytes(), **target), **accessor})
        return len(self.accessors) - 1


def tube() -> dict[str, np.ndarray]:
    """Return the vertices of the tube, ring by ring, with all their attributes."""
    ring, side = (grid.ravel() for grid in np.meshgrid(np.arange(RINGS), np.arange(SIDES), indexing="ij"))
    angle, height = 2 * np.pi * side / SIDES, 2 * ring / (RINGS - 1)
    out = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)
    bend = np.clip(height - 0.5, 0, 1)
    rng = np.random.default_rng(0)
    return {
        "POSITION": (0.3 * out + height[:, None] * [0, 1, 0]).astype("<f4"),
        "NORMAL": out.astype("<f4"),
        "TEXCOORD_0": np.stack([side / SIDES, ring / RINGS], axis=1).astype("<f4"),
        "COLOR_0": rng.integers(0, 256, (len(ring), 4), np.uint8),
        "TANGENT": np.stack([-np.sin(angle), 0 * angle, np.cos(angle), 1 + 0 * angle], axis=1).astype("<f4"),
        "JOINTS_0": (bend[:, None] > 0) * np.array([0, 1, 0, 0], np.uint8),
        "WEIGHTS_0": np.stack([1 - bend, bend, 0 * bend, 0 * bend], axis=1).astype("<f4"),
    }


def triangles(first: int, last: int) -> np.ndarray:
    """Return the triangles between two rings, facing outwards."""
    ring, side = (
        grid.ravel() for grid in np.meshgrid(np.arange(first, last), np.arange(SIDES), indexing="ij")
    )
    a, b = ring * SIDES + side, ring * SIDES + (side + 1) % SIDES
    faces = np.concatenate([np.stack([a, a + SIDES, b], 1), np.stack([b, a + SIDES, b + SIDES], 1)])
    return faces.astype("<u1").reshape(-1, 3)


def rigged_glb() -> bytes:
    """Return the model. Its texture coordinates wrap around the tube: they cannot be painted as they are."""
    file, given = _File(), tube()
    kinds = {"POSITION": "VEC3", "NORMAL": "VEC3", "TEXCOORD_0": "VEC2"}
    attributes = {
        name: file.add(
            values,
            kinds.get(name, "VEC4"),
            bounds=name == "POSITION",
            **({"normalized": True} if name == "COLOR_0" else {}),
        )
        for name, values in given.items()
    }
    swollen = np.array([SIDES * (RINGS - 1) + i for i in range(SIDES)], "<u2")
    moves = (0.2 * given["NORMAL"][swollen]).astype("<f4")
    file.accessors.append(
        {
            "componentType": 5126, "count": len(given["POSITION"]), "type": "VEC3",
            "min": np.minimum(moves.min(0), 0).tolist(), "max": np.maximum(moves.max(0), 0).tolist(),
            "sparse": {
                "count": len(swollen),
                "indices": {"bufferView": file.view(swollen.tobytes()), "componentType": 5123},
                "values": {"bufferView": file.view(moves.tobytes())},
            },
        }
    )  # fmt: skip
    target = len(file.accessors) - 1
    inverse = np.tile(np.eye(4, dtype="<f4"), (2, 1, 1))
    inverse[1, 1, 3] = -1  # the second joint sits at height 1
    bind = file.add(inverse.transpose(0, 2, 1).copy().reshape(2, 16), "MAT4")
    times = file.add(np.array([0, 0.5, 1], "<f4")[:, None], "SCALAR", bounds=True, plain=True)
    turn = np.array([0, 0.4, 0.8])
    quaternions = np.stack([0 * turn, 0 * turn, np.sin(turn / 2), np.cos(turn / 2)], axis=1).astype("<f4")
    turns = file.add(quaternions, "VEC4", plain=True)
    weights = file.add(np.array([0, 1, 0], "<f4")[:, None], "SCALAR", plain=True)
    images = []
    for colour in ((200, 40, 40), (128, 128, 255)):
        png = io.BytesIO()
        Image.new("RGB", (8, 8), colour).save(png, format="PNG")
        images.append({"mimeType": "image/png", "bufferView": file.view(png.getvalue())})
    half = RINGS // 2

    def primitive(first: int, last: int, material: int) -> dict[str, Any]:
        indices = file.add(triangles(first, last).reshape(-1, 1), "SCALAR")
        file.views[file.accessors[indices]["bufferView"]]["target"] = 34963
        return {
            "attributes": {**attributes}, "indices": indices, "material": material,
            "targets": [{"POSITION": target}], "extras": {"half": material},
        }  # fmt: skip

    line = file.add(np.array([[0, 0, 0], [0, 3, 0]], "<f4"), "VEC3", bounds=True)
    metal = {"baseColorTexture": {"index": 0}, "metallicFactor": 0.9}
    document = {
        "asset": {"version": "2.0", "generator": "a script", "copyright": "nobody", "extras": {"a": [1]}},
        "scene": 0,
        "scenes": [{"name": "stage", "nodes": [0, 3, 4, 5]}],
        "nodes": [
            {"name": "armature", "children": [1], "scale": [SCALE] * 3, "extras": {"rig": "two bones"}},
            {"name": "hip", "children": [2]},
            {"name": "knee", "translation": [0, 1, 0], "rotation": [0, 0, 0.19866933, 0.98006658]},
            {"name": "eye", "camera": 0, "translation": [0, 0, 5]},
            {"name": "twin", "mesh": 1, "scale": [-1, 1, 1], "translation": [2, 0, 0]},
            {"name": "tube", "mesh": 0, "skin": 0, "extras": {"answer": 42}},
        ],
        "meshes": [
            {
                "name": "limb", "primitives": [primitive(0, half, 0), primitive(half, RINGS - 1, 1)],
                "weights": [0.0], "extras": {"targetNames": ["swell"]},
            },
            {
                "name": "still",
                "primitives": [
                    {"attributes": {"POSITION": attributes["POSITION"]}, "indices": 0, "material": 2},
                    {"attributes": {"POSITION": line}, "mode": 1, "material": 2},
                ],
            },
        ],
        "skins": [{"name": "rig", "joints": [1, 2], "inverseBindMatrices": bind, "skeleton": 1}],
        "animations": [
            {
                "name": "bend",
                "channels": [
                    {"sampler": 0, "target": {"node": 2, "path": "rotation"}},
                    {"sampler": 1, "target": {"node": 5, "path": "weights"}},
                ],
                "samplers": [
                    {"input": times, "output": turns},
                    {"input": times, "output": weights, "interpolation": "STEP"},
                ],
            }
        ],
        "cameras": [{"type": "perspective", "name": "wide", "perspective": {"yfov": 1.0, "znear": 0.1}}],
        "materials": [
            {"name": "cloth", "doubleSided": True, "pbrMetallicRoughness": metal, "extras": {"dye": "red"}},
            {"name": "skin", "normalTexture": {"index": 1}, "emissiveFactor": [1, 0, 0]},
            {"name": "wire", "emissiveFactor": [0, 1, 0]},
        ],
        "textures": [{"source": 0, "sampler": 0}, {"source": 1, "sampler": 0}],
        "samplers": [{"wrapS": 10497}],
        "images": images,
    }  # fmt: skip
    meshes: Any = document["meshes"]
    meshes[1]["primitives"][0]["indices"] = meshes[0]["primitives"][0]["indices"]
    document |= {"accessors": file.accessors, "bufferViews": file.views}
    document["buffers"] = [{"byteLength": len(file.binary)}]
    return container(json.loads(json.dumps(document)), bytes(file.binary))
