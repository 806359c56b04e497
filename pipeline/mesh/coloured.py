"""A mesh file with its colours, as any tool writes them: textures, materials, vertex colours.

Colours are sRGB in [0, 1], unlit. Letters: v vertices, f triangles, h x w texels, p pixels along a side.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float, Int
from PIL import Image

from pipeline.cameras import Camera
from pipeline.errors import InputError
from pipeline.mesh.bilinear import sample
from pipeline.mesh.gltf_reader import drawable, read_gltf, triangles
from pipeline.mesh.mesh import Mesh, texture_points
from pipeline.mesh.pictures import FORMATS, MOST_TEXELS, check_pictures
from pipeline.mesh.rasterize import Fragments, rasterize
from pipeline.mesh.readers import read_mesh

SUPERSAMPLING = 2


class Paint(NamedTuple):
    """What the faces of one material show."""

    texture: Float[np.ndarray, "h w 3"] | None
    """None: they show the colours of their corners."""
    factor: Float[np.ndarray, " 3"]
    """That a texture is multiplied by, as linear light (glTF's base colour factor)."""


class ColouredMesh(NamedTuple):
    """Triangles and what each shows."""

    vertices: Float[np.ndarray, "v 3"]
    """float64, in the file's own units and place."""
    faces: Int[np.ndarray, "f 3"]
    """int32"""
    paint: Int[np.ndarray, " f"]
    """Row of `paints`."""
    paints: tuple[Paint, ...]
    uv: Float[np.ndarray, "f 3 2"]
    """Of every corner, origin at the top left; they repeat beyond [0, 1]. Zeros where there is no texture."""
    colours: Float[np.ndarray, "f 3 3"]
    """Of every corner, where there is no texture."""


def read_coloured(path: Path) -> ColouredMesh:
    """Return the triangles of a mesh file with their colours.

    Raises:
        InputError: what `read_mesh` refuses; a texture that is missing, unreadable or too large; no colours.
    """
    given = read_mesh(path)  # all that can be wrong with its triangles
    check_pictures(path)
    textures: dict[int, np.ndarray] = {}
    try:
        scene = trimesh.load_scene(path, file_type=path.suffix.lower()[1:], process=False, validate=False)
        gltf = path.suffix.lower() in (".glb", ".gltf")
        shown = _shown_by_gltf(path, scene) if gltf else _shown(scene)
        pieces = [_piece(geometry, vertices, path, textures) for geometry, vertices in shown]
    except InputError:
        raise
    except Exception as error:  # trimesh and pillow let nearly everything escape
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"{path}: its colours cannot be read ({said}); export it again") from None
    if not any(found for _, found in pieces):
        raise InputError(
            f"{path} has no colours (no texture, no material, no vertex colours): give a textured mesh, or "
            "say SKETCH= for a shape alone"
        )
    joined = joined_meshes([piece for piece, _ in pieces])
    if len(joined.faces) != len(given.faces):
        raise InputError(
            f"{path}: {len(joined.faces)} of its {len(given.faces)} faces could be read with their colours; "
            "export it as GLB"
        )
    return joined


def textured(mesh: Mesh, texture: Float[np.ndarray, "h w 3"]) -> ColouredMesh:
    """Return a mesh with its texture."""
    uv, uv_faces = texture_points(mesh)
    return _mesh(mesh.vertices, mesh.faces, Paint(texture, np.ones(3)), uv.astype(np.float64)[uv_faces], None)


def face_coloured(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], colours: Float[np.ndarray, "f 3"]
) -> ColouredMesh:
    """Return a mesh with a colour a face."""
    corners = np.repeat(colours[:, None], 3, axis=1)
    return _mesh(vertices, faces, Paint(None, np.ones(3)), None, corners)


def joined_meshes(meshes: list[ColouredMesh]) -> ColouredMesh:
    """Return all meshes in one."""
    vertex = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    paint = np.cumsum([0, *(len(mesh.paints) for mesh in meshes)])
    return ColouredMesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([m.faces + v for m, v in zip(meshes, vertex, strict=False)]).astype(np.int32),
        np.concatenate([m.paint + p for m, p in zip(meshes, paint, strict=False)]).astype(np.int32),
        tuple(paint for mesh in meshes for paint in mesh.paints),
        np.concatenate([mesh.uv for mesh in meshes]),
        np.concatenate([mesh.colours for mesh in meshes]),
    )


def picture_of(
    mesh: ColouredMesh, camera: Camera, size: int, supersampling: int = SUPERSAMPLING
) -> tuple[Float[np.ndarray, "p p 3"], Float[np.ndarray, "p p"]]:
    """Return what a camera sees before nothing (colours multiplied by their opacity), and the opacity."""
    fragments = rasterize(camera, mesh.vertices, mesh.faces, size * supersampling)
    shape = (size, supersampling, size, supersampling)
    colours = shown_colours(mesh, fragments) * fragments.mask[..., None]
    opacity = fragments.mask.astype(np.float32).reshape(shape).mean((1, 3))
    return colours.reshape(*shape, 3).mean((1, 3)).astype(np.float32), opacity.astype(np.float32)


def shown_colours(mesh: ColouredMesh, fragments: Fragments) -> Float[np.ndarray, "p p 3"]:
    """Return the colour of every pixel that sees a face; anything elsewhere."""
    face, weights = np.maximum(fragments.triangle, 0), fragments.barycentric
    colours = np.einsum("hwk,hwkc->hwc", weights, mesh.colours[face])
    uv = np.einsum("hwk,hwkc->hwc", weights, mesh.uv[face])
    shown = np.where(fragments.mask, mesh.paint[face], -1)
    for row, paint in enumerate(mesh.paints):
        mine = shown == row
        if paint.texture is not None and mine.any():
            places = uv[mine]
            texels = sample(paint.texture, np.where((places < 0) | (places > 1), places % 1, places))
            plain = np.array_equal(paint.factor, np.ones(3))
            colours[mine] = texels if plain else to_srgb(to_linear(texels) * paint.factor)
    return np.asarray(colours, np.float32)


def to_linear(colours: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Return sRGB colours as linear light (IEC 61966-2-1)."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def to_srgb(light: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Return linear light as sRGB colours."""
    light = np.clip(light, 0, 1)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)


def _mesh(
    vertices: np.ndarray,
    faces: np.ndarray,
    paint: Paint,
    uv: np.ndarray | None,
    colours: np.ndarray | None,
) -> ColouredMesh:
    count = len(faces)
    return ColouredMesh(
        np.asarray(vertices, np.float64),
        np.asarray(faces, np.int32),
        np.zeros(count, np.int32),
        (paint,),
        np.zeros((count, 3, 2)) if uv is None else np.asarray(uv, np.float64),
        np.full((count, 3, 3), 0.5) if colours is None else np.asarray(colours, np.float64),
    )


Shown = list[tuple[trimesh.Trimesh, Float[np.ndarray, "v 3"]]]
"""Parts with their vertices where viewers show them."""


def _shown(scene: trimesh.Scene) -> Shown:
    found = []
    for matrix, name in (scene.graph[node] for node in sorted(scene.graph.nodes_geometry)):
        part = scene.geometry[name]
        if isinstance(part, trimesh.Trimesh) and len(part.faces):
            found.append((part, np.asarray(part.vertices, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]))
    return found


def _shown_by_gltf(path: Path, scene: trimesh.Scene) -> Shown:
    """Return the parts of a glTF scene: placed as `gltf_reader` places them, since trimesh knows no skins and
    no morphs, coloured as trimesh reads them. Both find the numbers of a primitive, in one order."""
    document, pieces = read_gltf(path)
    waiting: dict[tuple[bytes, bytes], list[trimesh.Trimesh]] = {}
    for part in scene.geometry.values():
        if isinstance(part, trimesh.Trimesh):
            waiting.setdefault(_numbers(part.vertices, part.faces), []).append(part)
    parts = {}
    for row, mesh in enumerate(document.json["meshes"]):
        for index, primitive in enumerate(mesh["primitives"]):
            if drawable(primitive):
                vertices = document.values(primitive["attributes"]["POSITION"])
                same = waiting.get(_numbers(vertices, triangles(document, primitive, len(vertices))))
                if same:
                    parts[row, index] = same.pop(0)
    known = [piece for piece in pieces if (piece.mesh, piece.primitive) in parts]
    return [(parts[piece.mesh, piece.primitive], piece.vertices) for piece in known]


def _numbers(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> tuple[bytes, bytes]:
    """Return what is the same for the same triangles, in whatever order and from whichever corner."""
    rows = np.sort(np.asarray(faces, np.int64), axis=1)
    return np.asarray(vertices, np.float64).tobytes(), rows[np.lexsort(rows.T)].tobytes()


def _piece(
    geometry: Any, vertices: Float[np.ndarray, "v 3"], path: Path, textures: dict[int, np.ndarray]
) -> tuple[ColouredMesh, bool]:
    """Return one part of trimesh's scene, and whether it says what colours it has."""
    faces = np.asarray(geometry.faces, np.int64)
    linear = path.suffix.lower() in (".glb", ".gltf")
    visual = geometry.visual
    uv, material = getattr(visual, "uv", None), getattr(visual, "material", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is not None and uv is not None and len(uv) == len(vertices):
        corners = (np.asarray(uv, np.float64)[:, :2] * [1, -1] + [0, 1])[faces]
        factor = np.ones(3)
        said = getattr(material, "baseColorFactor", None)
        if linear and said is not None:
            factor = _unit(said)[:3]
        return _mesh(vertices, faces, Paint(_texture(image, path, textures), factor), corners, None), True
    colours = None
    if visual.kind == "vertex":
        colours = _unit(visual.vertex_colors)[:, :3][faces]
    elif visual.kind == "face":
        colours = np.repeat(_unit(visual.face_colors)[:, None, :3], 3, axis=1)
    else:
        said = getattr(material, "baseColorFactor", None)
        if said is None and getattr(material, "name", None) is not None:  # of a file: trimesh's own has none
            said = getattr(material, "diffuse", None)
        if said is not None:
            colours = np.broadcast_to(_unit(said)[:3], (len(faces), 3, 3))
    found = colours is not None
    if colours is not None and linear:
        colours = to_srgb(colours)
    return _mesh(vertices, faces, Paint(None, np.ones(3)), None, colours), found


def _unit(values: Any) -> np.ndarray:
    """Return colours that are bytes, or floats, as floats in [0, 1]."""
    array = np.asarray(values)
    return array / 255 if array.dtype == np.uint8 else np.clip(array.astype(np.float64), 0, 1)


def _texture(image: Image.Image, path: Path, known: dict[int, np.ndarray]) -> Float[np.ndarray, "h w 3"]:
    """Return a picture's colours; `known` are those of others, which it joins, by the picture's identity."""
    if id(image) not in known:
        texels = image.width * image.height + sum(texture.size // 3 for texture in known.values())
        if texels > MOST_TEXELS:
            raise InputError(
                f"{path}: its textures have {texels} texels, expected {MOST_TEXELS} at most; "
                "make them smaller"
            )
        # What the checks missed is not decoded; MPO is a JPEG of several, None was decoded by trimesh.
        if image.format not in (*FORMATS, "MPO", None):
            raise InputError(f"{path}: a texture is {image.format}, expected {', '.join(FORMATS)}")
        known[id(image)] = np.asarray(image.convert("RGB"), np.float32)
        known[id(image)] /= 255
    return known[id(image)]
