"""The triangles of a glTF scene where viewers show them: nodes placed, morphs and skins in their rest pose.

A mesh that several nodes show is several pieces; so is one of several primitives. Letters: v vertices,
f triangles, k components, j joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pipeline.errors import InputError
from pipeline.mesh.gltf_checks import check_gltf
from pipeline.mesh.gltf_document import Document, open_document
from pipeline.mesh.gltf_json import gltf_fault, shown_nodes

TRIANGLES, STRIP, FAN = 4, 5, 6


class Piece(NamedTuple):
    """One primitive of the mesh of one node."""

    name: str
    """Of the node; with a number where its mesh has several primitives, or the name is taken."""
    node: int
    mesh: int
    primitive: int
    """Rows of the document."""
    vertices: Float[np.ndarray, "v 3"]
    """In the scene, float64."""
    normals: Float[np.ndarray, "v 3"] | None
    """Unit, in the scene."""
    uv: Float[np.ndarray, "v 2"] | None
    """TEXCOORD_0, origin at the top left."""
    faces: Int[np.ndarray, "f 3"]
    """As the file winds them."""
    mirrored: bool
    """Whether the node turns its faces inside out, so that they are to be read the other way round."""


def read_gltf(path: Path) -> tuple[Document, list[Piece]]:
    """Return a document and the pieces of its scene, in the order of nodes and primitives.

    Raises:
        InputError: a file that cannot be read, or whose numbers are not what it says.
    """
    check_gltf(path)
    document = open_document(path)
    try:
        with np.errstate(all="ignore"):  # what is not finite is named by who reads
            return document, list(_pieces(document))
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise InputError(f"{path}: not a readable glTF mesh ({gltf_fault(error)}); export it again") from None


def _pieces(document: Document) -> Iterator[Piece]:
    nodes: list[dict[str, Any]] = document.json.get("nodes", [])
    worlds = _world_matrices(nodes)
    shown = [row for row in shown_nodes(document.json) if "mesh" in nodes[row]]
    taken = {node["name"] for node in nodes if isinstance(node.get("name"), str)}
    used, numbers = set[str](), dict[str, int]()
    for row in shown:
        node = nodes[row]
        mesh = document.json["meshes"][node["mesh"]]
        drawn = [i for i, p in enumerate(mesh["primitives"]) if drawable(p)]
        named = str(node.get("name") or mesh.get("name") or f"node{row}")
        for index in drawn:
            name = named if len(drawn) == 1 and named not in used else _free(named, taken, numbers)
            used.add(name)
            taken.add(name)
            yield _piece(document, name, row, index, worlds)


def _free(name: str, taken: set[str], numbers: dict[str, int]) -> str:
    """Return the name with the least number that makes it another than those taken; `numbers` has the last
    one found for each name."""
    number = numbers.get(name, 0)
    while f"{name}_{number}" in taken:
        number += 1
    numbers[name] = number
    return f"{name}_{number}"


def drawable(primitive: dict[str, Any]) -> bool:
    """Whether a primitive of a document is made of triangles."""
    return (
        primitive.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN) and "POSITION" in primitive["attributes"]
    )


def _world_matrices(nodes: list[dict[str, Any]]) -> Float[np.ndarray, "n 4 4"]:
    """Return where every node's coordinates lie in the scene; `check_gltf` has seen that they are trees."""
    local = [_local_matrix(node) for node in nodes]
    worlds = np.array(local).reshape(-1, 4, 4)
    children = {child for node in nodes for child in node.get("children", ())}
    waiting = [row for row in range(len(nodes)) if row not in children]
    while waiting:
        row = waiting.pop()
        for child in nodes[row].get("children", ()):
            worlds[child] = worlds[row] @ local[child]
            waiting.append(child)
    return worlds


def _local_matrix(node: dict[str, Any]) -> Float[np.ndarray, "4 4"]:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), np.float64)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)), np.float64)
    matrix[:3, 3] = np.array(node.get("translation", (0, 0, 0)), np.float64)
    return matrix


def _piece(document: Document, name: str, row: int, index: int, worlds: Float[np.ndarray, "n 4 4"]) -> Piece:
    node = document.json["nodes"][row]
    mesh = document.json["meshes"][node["mesh"]]
    primitive = mesh["primitives"][index]
    attributes = primitive["attributes"]
    weights = node.get("weights", mesh.get("weights", []))
    vertices = _morphed(document, primitive, "POSITION", weights)
    normals = _morphed(document, primitive, "NORMAL", weights) if "NORMAL" in attributes else None
    if "skin" in node and "JOINTS_0" in attributes:
        # A skinned mesh stands where its joints are; the transform of its own node does not count.
        matrices = _skinned(document, node["skin"], attributes, worlds)
    else:
        matrices = worlds[row][None]
    if not np.array_equal(matrices, np.eye(4)[None]):
        vertices = _apply(matrices[:, :3, :3], vertices) + matrices[:, :3, 3]
        if normals is not None:
            normals = _apply(_cofactors(matrices[:, :3, :3]), normals)
    if normals is not None:
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return Piece(
        name,
        row,
        node["mesh"],
        index,
        vertices,
        normals,
        _columns(document, attributes["TEXCOORD_0"], "TEXCOORD_0", 2) if "TEXCOORD_0" in attributes else None,
        triangles(document, primitive, len(vertices)),
        bool(np.linalg.det(matrices[0, :3, :3]) < 0),
    )


def _apply(
    matrices: Float[np.ndarray, "m 3 3"], points: Float[np.ndarray, "v 3"]
) -> Float[np.ndarray, "v 3"]:
    """Return the points, each by its matrix; m is v, or 1 for all."""
    if len(matrices) == 1:
        return points @ matrices[0].T
    return np.asarray(np.einsum("vij,vj->vi", matrices, points))


def _cofactors(matrices: Float[np.ndarray, "m 3 3"]) -> Float[np.ndarray, "m 3 3"]:
    """Return what turns normals as the matrices turn surfaces, up to length; no inverse, which may not be."""
    a, b, c = (matrices[:, k] for k in range(3))
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)


def _morphed(
    document: Document, primitive: dict[str, Any], name: str, weights: list[float]
) -> Float[np.ndarray, "v 3"]:
    """Return positions or normals with the morph targets that the file's own weights ask for."""
    values = _columns(document, primitive["attributes"][name], name, 3)
    for weight, target in zip(weights, primitive.get("targets", []), strict=False):
        if weight and name in target:
            values = values + float(weight) * _columns(document, target[name], name, 3)
    return values


def _columns(document: Document, accessor: int, name: str, count: int) -> Float[np.ndarray, "v k"]:
    """Return the first `count` components of an accessor's elements."""
    values = document.values(accessor)
    if values.shape[1] < count:
        raise ValueError(f"{name} has {values.shape[1]} components a vertex, expected {count}")
    return values[:, :count]


def _skinned(
    document: Document, skin: int, attributes: dict[str, int], worlds: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, "v 4 4"]:
    """Return the matrix of every vertex: the mean of its joints' by its weights."""
    described = document.json["skins"][skin]
    joints = worlds[described["joints"]]
    if "inverseBindMatrices" in described:
        inverse = document.values(described["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        joints = joints @ inverse[: len(joints)]
    count = len(document.elements(attributes["JOINTS_0"]))
    total, blended = np.zeros(count), np.zeros((count, 4, 4))
    for number in range(len(attributes)):
        if f"JOINTS_{number}" not in attributes:
            break
        which = document.elements(attributes[f"JOINTS_{number}"]).astype(np.int64)
        share = document.values(attributes[f"WEIGHTS_{number}"])
        blended = blended + np.einsum("vk,vkij->vij", share, joints[which])
        total = total + share.sum(axis=1)
    still = total <= 0  # a vertex without weights stays where it is
    blended = np.where(still[:, None, None], np.eye(4), blended / np.where(still, 1.0, total)[:, None, None])
    return np.asarray(blended)


def triangles(document: Document, primitive: dict[str, Any], count: int) -> Int[np.ndarray, "f 3"]:
    """Return the corners of a primitive's triangles; strips and fans are taken apart."""
    mode = primitive.get("mode", TRIANGLES)
    indices = primitive.get("indices")
    order = np.arange(count) if indices is None else document.elements(indices)[:, 0].astype(np.int64)
    if mode == TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    step = np.arange(max(len(order) - 2, 0))
    if mode == FAN:
        return np.stack([order[step + 1], order[step + 2], order[np.zeros_like(step)]], axis=1)
    odd = step % 2  # every other triangle of a strip turns the other way
    return np.stack([order[step], order[step + 1 + odd], order[step + 2 - odd]], axis=1)
