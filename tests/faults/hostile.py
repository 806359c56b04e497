"""Hostile files, made as they are needed: none of a stranger's lies in the repository."""

import base64
import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import trimesh

DRAWING = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100">{}</svg>'
POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]], np.float32)


def png(width: int, height: int) -> bytes:
    """Return a legal PNG picture of one bit a pixel: it packs a thousandfold."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    rows = zlib.compress(bytes((width + 7) // 8 + 1) * height, 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def obj(vertices: Iterable[Iterable[float]], faces: Iterable[Iterable[int]]) -> bytes:
    """Return OBJ text of polygons; indices count from 0."""
    lines = ["v " + " ".join(map(repr, map(float, point))) for point in vertices]
    lines += ["f " + " ".join(str(index + 1) for index in face) for face in faces]
    return "\n".join(lines).encode()


def gltf(**changes: Any) -> bytes:
    """Return glTF text of two triangles, with some of its parts exchanged."""
    data = POINTS.tobytes() + np.array([0, 1, 2, 0, 2, 3], np.uint32).tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(data), "uri": uri}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 24},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3",
             "min": [0, 0, 0], "max": [1, 1, 1]},
            {"bufferView": 1, "componentType": 5125, "count": 6, "type": "SCALAR"},
        ],
        **changes,
    }  # fmt: skip
    return json.dumps(document).encode()


def textured_gltf(picture: bytes) -> bytes:
    """Return glTF text of two triangles whose colours are a picture inside it."""
    document = json.loads(gltf())
    uri = "data:image/png;base64," + base64.b64encode(picture).decode()
    document["images"], document["textures"] = [{"uri": uri}], [{"source": 0}]
    document["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    primitive = document["meshes"][0]["primitives"][0]
    primitive["material"], primitive["attributes"]["TEXCOORD_0"] = 0, 2
    document["accessors"].append({"componentType": 5126, "count": 4, "type": "VEC2"})
    return json.dumps(document).encode()


def glb(text: bytes, version: int = 2) -> bytes:
    """Return a GLB file around JSON text."""
    body = struct.pack("<I4s", len(text), b"JSON") + text
    return struct.pack("<4sII", b"glTF", version, 12 + len(body)) + body


def packed(content: bytes) -> bytes:
    """Return a zip archive of one packed file."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a/data/0", content)
    return stream.getvalue()


def ply(claim: str, data: bytes) -> bytes:
    """Return a binary PLY file of three vertices and what a line claims of its faces."""
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    return f"{head}property float z\n{claim}\nend_header\n".encode() + POINTS[:3].tobytes() + data


def svg(inside: str, before: str = "") -> bytes:
    """Return a drawing of 100 x 100 units."""
    return (before + DRAWING.format(inside)).encode()


def ball(kind: str) -> bytes:
    """Return a whole mesh."""
    written = trimesh.creation.icosphere(1).export(file_type=kind)
    return written if isinstance(written, bytes) else str(written).encode()


def _apart() -> bytes:
    ball = trimesh.creation.icosphere(1)
    return obj(np.concatenate([ball.vertices, ball.vertices + 1e20]),
               np.concatenate([ball.faces, ball.faces + len(ball.vertices)]))  # fmt: skip


LISTS = "property list uint int vertex_indices"
BOX = '<rect width="50" height="50"/>'
MESHES: dict[str, tuple[Callable[[], bytes], str]] = {
    "empty.obj": (lambda: b"", "0 bytes"),
    "words.obj": (lambda: b"v a b c\nf 1 2 3\n", "line 1"),
    "nan.obj": (lambda: obj([(0, 0, 0), (1, float("nan"), 0), (0, 1, 0)], [(0, 1, 2)]), "NaN"),
    "infinite.obj": (lambda: obj([(0, 0, 0), (1, float("inf"), 0), (0, 1, 0)], [(0, 1, 2)]), "infinite"),
    "beyond.obj": (lambda: b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "indices"),
    "backwards.obj": (lambda: b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -9\n", "line 4"),
    "huge-index.obj": (lambda: b"v 0 0 0\nf 1 1 99999999999999999999\n", "line 2"),
    "wide.obj": (lambda: "v 0 0 0\nf 1 1 1\n".encode("utf-16"), "UTF-16"),
    "points.obj": (lambda: b"v 0 0 0\nv 1 0 0\n", "no faces"),
    "flat.obj": (lambda: b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "area"),
    "speck.obj": (lambda: b"v 0 0 0\nv 1e-35 0 0\nv 0 1e-35 0\nf 1 2 3\n", "wide"),
    "vast.obj": (lambda: b"v 0 0 0\nv 1e35 0 0\nv 0 1e35 0\nf 1 2 3\n", "wide"),
    "digits.ply": (lambda: ply(f"element face {'9' * 5000}\n{LISTS}", b""), "claims"),
    "claims.ply": (lambda: ply("element face 4000000000\n" + LISTS, b""), "claims"),
    "corners.ply": (
        lambda: ply("element face 1\n" + LISTS, struct.pack("<Iiii", 4_000_000_000, 0, 1, 2)),
        "not a readable ply",
    ),
    "points.ply": (lambda: ply("comment no faces", b""), "3 points but no faces"),
    "strips.ply": (lambda: ply("element tristrips 1\n" + LISTS, bytes(16)), "triangle strips"),
    "headless.ply": (lambda: b"ply\nformat ascii 1.0\n", "no PLY header"),
    "cut.stl": (lambda: ball("stl")[:1000], "claims 80 triangles"),
    "claims.stl": (lambda: bytes(80) + struct.pack("<I", 4_000_000_000), "claims 4000000000 triangles"),
    "cut-text.stl": (lambda: ball("stl_ascii")[:500], "endsolid"),
    "cut.off": (lambda: b"OFF\n3 1 0\n0 0 0\n1 0 0\n", "not a readable off"),
    "past.gltf": (lambda: gltf(asset={"version": "1.0"}), "glTF 1.0 is not read: convert it to 2.0"),
    "past.glb": (lambda: glb(gltf(), version=1), "past.glb: glTF 1 is not read: convert it to 2.0"),
    "deep.gltf": (lambda: b"[" * 200_000, "nested too deeply"),
    "nan.gltf": (lambda: gltf(nodes=[{"mesh": 0, "translation": [float("nan"), 0, 0]}]), "NaN"),
    "claims.gltf": (
        lambda: gltf(accessors=[{"componentType": 5126, "count": 300_000_000, "type": "VEC3"}]),
        "claims 300000000",
    ),
    "cycle.gltf": (lambda: gltf(nodes=[{"mesh": 0}, {"children": [2]}, {"children": [1]}]), "cycle"),
    "nested.gltf": (
        lambda: gltf(nodes=[*({"children": [i + 1]} for i in range(400)), {"mesh": 0}]),
        "more than 100 deep",
    ),
    "no-count.gltf": (lambda: gltf(accessors=[{"type": "VEC3"}]), "'count' is missing"),
    "no-buffer.gltf": (lambda: gltf(buffers=[{}]), "'byteLength' is missing"),
    "numbers.gltf": (
        lambda: gltf(
            accessors=[
                {"bufferView": i, "componentType": t, "count": 4, "type": "SCALAR"}
                for i, t in enumerate((5126, 5125))
            ]
        ),
        "POSITION has 1 components a vertex, expected 3",
    ),
    "no-mesh.gltf": (lambda: gltf(nodes=[{"mesh": 7}]), "refers to what is not there"),
    "hidden.gltf": (lambda: gltf(scenes=[{"nodes": []}]), "none in its scene"),
    "lines.gltf": (
        lambda: gltf(meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": 1}]}]),
        "made of lines",
    ),
    "escapes.gltf": (
        lambda: gltf(buffers=[{"uri": "../../../../etc/passwd", "byteLength": 72}]),
        "outside its folder",
    ),
    "page.glb": (lambda: b"<!doctype html><html>", "a web page"),
    "pointer.obj": (lambda: b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
    "crossing.obj": (
        lambda: b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf" + b" 1 2 3" * 30_000,
        "polygons of up to 90000 corners",
    ),
    "corners.off": (
        lambda: b"OFF # a comment\n\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4000000000 0 1 2\n",
        "claims '4000000000' corners and has 3",
    ),
    "far.gltf": (lambda: gltf(nodes=[{"mesh": 0, "translation": [1e300, 0, 0]}]), "from the origin"),
    "large.gltf": (lambda: gltf(nodes=[{"mesh": 0, "scale": [1e308] * 3}]), "units wide"),
    "many-nodes.gltf": (lambda: gltf(nodes=[{"mesh": 0}, *[{}] * 100_000]), "100001 glTF nodes"),
    "zeros.gltf": (
        lambda: gltf(
            nodes=[{"mesh": 0}] * 100,
            scenes=[{"nodes": list(range(100))}],
            accessors=[
                {"componentType": 5126, "count": 2_000_000, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5125, "count": 6, "type": "SCALAR"},
            ],
        ),
        "200000000 vertices",
    ),
    "a-picture.obj": (lambda: png(8, 8), "obj"),
    "readme.md": (lambda: b"# hello", "the ending is .md"),
}
"""What is refused as MESH: how it is made, and what the error says."""
UNPAINTABLE: dict[str, tuple[Callable[[], bytes], str]] = {
    "thin.obj": (
        lambda: obj(
            [(0, 0, 0), (1e6, 0, 0), (1e6, 1e-6, 0), (0, 0, 1e-6)],
            [(0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)],
        ),
        "lost in its extent",
    ),
    "apart.obj": (_apart, "lost in its extent"),
}
"""Meshes that only their stage can refuse."""
TOKENS: dict[str, tuple[Callable[[], bytes], str]] = {
    "nothing.pt": (lambda: b"", "0 bytes"),
    "page.pt": (lambda: b"<!doctype html>", "no readable torch file"),
    "cut.pt": (lambda: packed(b"x" * 100)[:60], "no readable torch file"),
    "bomb.pt": (lambda: packed(bytes(10_000_000)), "packed into"),
    "header.safetensors": (lambda: struct.pack("<Q", 2**63) + b"{}", "no readable safetensors"),
    "page.safetensors": (lambda: b"<!doctype html>", "no readable safetensors"),
    "readme.md": (lambda: b"# hello", "the ending is '.md'"),
}
"""What is refused as TOKEN before a stage starts."""
DRAWINGS: dict[str, tuple[Callable[[], bytes], str]] = {
    "nested.svg": (lambda: svg("<g>" * 500 + BOX + "</g>" * 500), "nests more than 200"),
    "bomb.svg": (
        lambda: svg(
            '<image width="50" height="50" href="data:image/png;base64,'
            f'{base64.b64encode(png(20_000, 20_000)).decode()}"/>'
        ),
        "cannot be drawn within",
    ),
    "clips.svg": (
        lambda: svg(
            "".join(f'<clipPath id="c{i}" clip-path="url(#c{i + 1})">{BOX}</clipPath>' for i in range(5000))
            + '<rect clip-path="url(#c0)" width="60" height="60"/>'
        ),
        "cannot be drawn within",
    ),
    "entities.svg": (
        lambda: svg("<text>" + "&a;" * 30_000 + "</text>", f'<!DOCTYPE svg [<!ENTITY a "{"x" * 30_000}">]>'),
        "not a readable SVG",
    ),
    "laughs.svg": (
        lambda: svg("<text>&b;</text>", '<!DOCTYPE svg [<!ENTITY a "xx"><!ENTITY b "&a;&a;">]>'),
        "entities made of entities",
    ),
    "outside-entity.svg": (
        lambda: svg("<text>&a;</text>", '<!DOCTYPE svg [<!ENTITY a SYSTEM "file:///etc/passwd">]>'),
        "another file",
    ),
    "outside-picture.svg": (lambda: svg('<image id=">" href="/etc/other.png"/>'), "/etc/other.png"),
    "outside-late.svg": (
        lambda: svg("<svg:feImage xmlns:svg='http://www.w3.org/2000/svg' href='&#104;ttp://x/y.png'/>"),
        "http://x/y.png",
    ),
    "empty.svg": (lambda: b"", "not a readable SVG"),
    "nothing.svg": (lambda: svg(""), "no silhouette"),
    "cut.svg": (lambda: svg(BOX)[:-8], "not a readable SVG"),
    "huge.png": (lambda: png(20_000, 20_000), "pixels"),
    "cut.png": (lambda: png(64, 64)[:44], "not a readable PNG"),
    "gif.png": (lambda: b"GIF89a" + bytes(40), "no PNG header"),
    "one-colour.png": (lambda: png(64, 64), "no silhouette"),
}
"""What is refused as SKETCH."""
ENDLESS = {
    "morphology": '<feMorphology radius="1000000" operator="dilate"/>',
    "turbulence": '<feTurbulence numOctaves="1000000000" baseFrequency="0.1"/>',
}
"""Filters that would take minutes to hours."""
