"""What a glTF file claims, checked before it is read: trimesh believes counts, and follows cycles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.mesh.companion_files import buffer_files
from pipeline.mesh.gltf_json import gltf_fault, read_gltf_json, shown_nodes
from pipeline.mesh.limits import MOST_FACES, check_count

MOST_VERTICES = 3 * MOST_FACES
"""Of the pieces that a glTF scene shows; also of an accessor without data, which stands for zeros."""
MOST_NODES = 100_000
"""They are placed one by one, in two seconds."""
MOST_DEPTH = 100
"""Of glTF nodes: a hand's skeleton has ten levels, and placing a node takes as long as it is deep."""
_TRIANGLES = {4: "triangles", 5: "triangle strips", 6: "triangle fans"}
_OTHERS = {0: "points", 1: "lines", 2: "line loops", 3: "line strips"}
"""What glTF can draw beside these (specification, 3.7.2.1)."""
SUPPORTED_EXTENSIONS = (
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "EXT_texture_",
    "KHR_mesh_quantization",
)


def check_gltf(path: Path) -> None:
    """Raise InputError for a glTF file with claims its data cannot keep, cyclic nodes, unknown compression or
    buffers outside its folder."""
    document = read_gltf_json(path)
    _check_version(document, path)
    buffer_files(path)
    try:
        needed = [str(name) for name in document.get("extensionsRequired", ())]
        views, accessors = document.get("bufferViews", []), document.get("accessors", [])
        for index, accessor in enumerate(accessors):
            count = int(accessor["count"])
            view = accessor.get("bufferView")
            most = MOST_VERTICES if view is None else int(views[view]["byteLength"])
            if not 0 <= count <= most:
                raise InputError(f"{path}: accessor {index} claims {count} elements; the file is damaged")
        if len(document.get("nodes", ())) > MOST_NODES:
            raise InputError(
                f"{path}: {len(document['nodes'])} glTF nodes, expected at most {MOST_NODES}; join the parts"
            )
        children = [[int(child) for child in node.get("children", ())] for node in document.get("nodes", [])]
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise InputError(f"{path}: not valid glTF ({gltf_fault(error)}); export it again") from None
    for name in needed:
        if not name.startswith(SUPPORTED_EXTENSIONS):
            raise InputError(f"{path}: needs the glTF extension {name[:60]}; export the mesh without it")
    _check_tree(children, path)
    try:
        _check_shown(document, path)
        faces, vertices = _shown_counts(document)
        check_count(faces, path)
        if vertices > MOST_VERTICES:
            raise InputError(
                f"{path}: {vertices} vertices, expected at most {MOST_VERTICES}; decimate the mesh first"
            )
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise InputError(f"{path}: not valid glTF ({gltf_fault(error)}); export it again") from None


def _check_version(document: dict[str, Any], path: Path) -> None:
    asset = document.get("asset")
    version = asset.get("version", "1.0") if isinstance(asset, dict) else "1.0"
    if not str(version).startswith("2."):
        raise InputError(f"{path}: glTF {str(version)[:20]} is not read: convert it to 2.0")


def _shown_counts(document: dict[str, Any]) -> tuple[int, int]:
    """Return how many triangles and vertices the scene of a document that was checked shows; a mesh counts
    once a node, a primitive as its longest attribute."""
    counts = [int(accessor["count"]) for accessor in document.get("accessors", ())]
    triangles = vertices = 0
    for node in (document["nodes"][row] for row in shown_nodes(document)):
        for primitive in document["meshes"][node["mesh"]]["primitives"] if "mesh" in node else ():
            mode, attributes = int(primitive.get("mode", 4)), primitive["attributes"]
            if mode in _TRIANGLES and "POSITION" in attributes:
                corners = counts[primitive.get("indices", attributes["POSITION"])]
                triangles += corners // 3 if mode == 4 else max(corners - 2, 0)
                morphed = [row for target in primitive.get("targets", ()) for row in target.values()]
                vertices += max(counts[row] for row in (*attributes.values(), *morphed))
    return triangles, vertices


def _check_shown(document: dict[str, Any], path: Path) -> None:
    """Raise InputError where no node of the scene has a mesh, or no mesh has triangles."""
    meshes = document.get("meshes", [])
    modes = {int(primitive.get("mode", 4)) for mesh in meshes for primitive in mesh["primitives"]}
    if modes and not modes & _TRIANGLES.keys():
        names = ", ".join(_OTHERS.get(mode, f"mode {mode}") for mode in sorted(modes))
        raise InputError(f"{path}: is made of {names}; export it as triangles")
    if meshes and not any("mesh" in document["nodes"][row] for row in shown_nodes(document)):
        raise InputError(
            f"{path}: has {len(meshes)} meshes, but none in its scene; export it with a scene that shows them"
        )


def _check_tree(children: list[list[int]], path: Path) -> None:
    """glTF nodes are trees: every node has at most one parent, and no node is its own ancestor."""
    parent: dict[int, int] = {}
    for node, below in enumerate(children):
        for child in below:
            if not 0 <= child < len(children) or child in parent:
                raise InputError(
                    f"{path}: glTF node {child} has no place in a tree of nodes; export it again"
                )
            parent[child] = node
    rooted = [(node, 1) for node in range(len(children)) if node not in parent]
    reached = 0
    while rooted:
        reached += 1
        node, depth = rooted.pop()
        if depth > MOST_DEPTH:
            raise InputError(
                f"{path}: its glTF nodes are nested more than {MOST_DEPTH} deep; export the mesh without them"
            )
        rooted += [(child, depth + 1) for child in children[node]]
    if reached != len(children):
        raise InputError(f"{path}: its glTF nodes form a cycle; export it again")
