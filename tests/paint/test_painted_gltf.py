"""A rigged, morphing model of two materials goes through paint and comes back as it was, in new colours."""

import copy
import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pipeline.mesh.gltf import container
from pipeline.mesh.gltf_document import open_document
from pipeline.mesh.gltf_reader import Piece, read_gltf
from pipeline.mesh.materials import PLAIN, Material
from pipeline.mesh.readers import read_mesh
from pipeline.paint.painted_gltf import Corners, painted_glb
from tests.kept_document import assert_kept, assert_same
from tests.rigged_model import RINGS, SCALE, SIDES, rigged_glb
from tests.validator import issues


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rigged") / "rigged.glb"
    path.write_bytes(rigged_glb())
    return path


def image() -> bytes:
    png = io.BytesIO()
    Image.new("RGB", (16, 16), (10, 200, 10)).save(png, format="PNG")
    return png.getvalue()


def torn(pieces: list[Piece]) -> list[Corners]:
    """Return new texture points for every triangle of its own: every vertex is repeated."""
    rng = np.random.default_rng(1)
    made = []
    for piece in pieces:
        count = 3 * len(piece.faces)
        made.append(Corners(np.arange(count).reshape(-1, 3), rng.random((count, 2))))
    return made


def painted(given: Path, how: Any = torn, material: Material = PLAIN, png: bool = True) -> bytes:
    document, pieces = read_gltf(given)
    return painted_glb(document, pieces, how(pieces), image() if png else None, material, given.parent)


def save(given: Path, data: bytes) -> Path:
    path = given.parent / "asset.glb"
    path.write_bytes(data)
    return path


def test_all_but_colours_is_as_it_came(given: Path) -> None:
    before, after = open_document(given), open_document(save(given, painted(given)))
    assert_kept(before, after)
    names = [material["name"] for material in after.json["materials"]]
    assert names == ["cloth", "skin", "wire", "wire"]  # the lines keep the unpainted one
    cloth, skin, unpainted, wire = after.json["materials"]
    assert cloth["extras"] == {"dye": "red"}
    assert cloth["doubleSided"]
    assert unpainted == before.json["materials"][2]
    assert "emissiveFactor" not in skin
    assert "emissiveFactor" not in wire
    assert skin["normalTexture"]["texCoord"] == 1  # the file's own coordinates are the second set now
    colour = after.json["textures"][cloth["pbrMetallicRoughness"]["baseColorTexture"]["index"]]
    assert after.view(after.json["images"][colour["source"]]["bufferView"]) == image()
    assert len(after.json["images"]) == 2  # the one that was replaced is gone, the normal map is not


def test_the_old_coordinates_stay_for_the_normal_map(given: Path) -> None:
    before, after = open_document(given), open_document(save(given, painted(given)))
    lower, upper = (p["attributes"] for p in after.json["meshes"][0]["primitives"])
    assert "TEXCOORD_1" not in lower  # no texture of the cloth reads them
    old = before.json["meshes"][0]["primitives"][1]["attributes"]["TEXCOORD_0"]
    stored = before.elements(old)
    np.testing.assert_array_equal(after.elements(upper["TEXCOORD_1"])[: len(stored)], stored)


def test_new_coordinates_are_those_of_the_corners(given: Path) -> None:
    _, pieces = read_gltf(given)
    wanted = torn(pieces)
    _, again = read_gltf(save(given, painted(given)))
    for piece, new, corners in zip(pieces, again, wanted, strict=True):
        assert new.uv is not None
        np.testing.assert_array_equal(new.uv[new.faces], corners.values[corners.rows].astype(np.float32))
        np.testing.assert_array_equal(new.vertices[new.faces], piece.vertices[piece.faces])
        assert new.name == piece.name


def test_usable_coordinates_leave_every_array_as_it_is(given: Path) -> None:
    def own(pieces: list[Piece]) -> list[Corners]:
        return [Corners(p.faces, np.zeros((0, 2)) if p.uv is None else np.clip(p.uv, 0, 1)) for p in pieces]

    # without the twin, which has no coordinates
    document = copy.deepcopy(open_document(given))
    document.json["scenes"][0]["nodes"].remove(4)
    path = given.parent / "own.glb"
    path.write_bytes(container(document.json, document.buffers[0]))
    before, after = open_document(path), open_document(save(given, painted(path, own)))
    assert_kept(before, after)
    for old, new in zip(before.json["meshes"], after.json["meshes"], strict=True):
        for one, other in zip(old["primitives"], new["primitives"], strict=True):
            for name, row in one["attributes"].items():
                kept = "_COLOR_0" if name == "COLOR_0" else name  # it would tint the painting
                assert_same(before, row, after, other["attributes"][kept])
            if "indices" in one:
                assert_same(before, one["indices"], after, other["indices"])
    assert "texCoord" not in after.json["materials"][1].get("normalTexture", {})


def test_a_colour_a_face(given: Path) -> None:
    def shades(pieces: list[Piece]) -> list[Corners]:
        rng = np.random.default_rng(2)
        sizes = [len(p.faces) for p in pieces]
        return [Corners(np.repeat(np.arange(n)[:, None], 3, 1), rng.random((n, 3))) for n in sizes]

    before, after = open_document(given), open_document(save(given, painted(given, shades, png=False)))
    assert_kept(before, after)
    primitive = after.json["meshes"][0]["primitives"][0]
    expected = shades(read_gltf(given)[1])[1]  # after the twin
    shown = after.values(primitive["attributes"]["COLOR_0"])[after.elements(primitive["indices"])[:, 0]]
    np.testing.assert_allclose(shown.reshape(-1, 3, 3), expected.values[expected.rows], atol=1e-7)
    assert "baseColorTexture" not in after.json["materials"][0]["pbrMetallicRoughness"]


def test_two_nodes_of_one_mesh_are_painted_apart(given: Path) -> None:
    document = copy.deepcopy(open_document(given))
    document.json["nodes"].append({"name": "other", "mesh": 1, "translation": [4, 0, 0]})
    document.json["scenes"][0]["nodes"].append(6)
    path = given.parent / "twice.glb"
    path.write_bytes(container(document.json, document.buffers[0]))
    data = save(given, painted(path))
    _, pieces = read_gltf(data)
    wanted = torn(read_gltf(path)[1])
    for piece, corners in zip(pieces, wanted, strict=True):
        assert piece.uv is not None
        np.testing.assert_array_equal(piece.uv[piece.faces], corners.values[corners.rows].astype(np.float32))
    assert len({p.mesh for p in pieces}) == 3


def test_skinned_meshes_stand_where_viewers_show_them(given: Path) -> None:
    """The knee turns what is above by 0.4 about z; the node of the mesh itself moves nothing."""
    document = copy.deepcopy(open_document(given))
    document.json["nodes"][5]["translation"] = [9, 9, 9]
    path = given.parent / "moved.glb"
    path.write_bytes(container(document.json, document.buffers[0]))
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.vertices, read_mesh(given).vertices)
    tube = mesh.vertices[-RINGS * SIDES :]
    np.testing.assert_allclose(tube[:SIDES, 1], 0, atol=1e-6)  # the lowest ring
    top = tube[-SIDES:].mean(axis=0)
    knee, angle = np.array([0, 1.0, 0]), 2 * np.arctan2(0.19866933, 0.98006658)
    np.testing.assert_allclose(top, SCALE * (knee + [-np.sin(angle), np.cos(angle), 0]), atol=1e-6)
    assert mesh.names == ("twin", "tube_0", "tube_1")


def test_the_validator_finds_nothing(given: Path, tmp_path: Path) -> None:
    for name, data in {
        "given": given.read_bytes(),
        "torn": painted(given),
        "unlit": painted(given, material=PLAIN._replace(unlit=True)),
    }.items():
        (tmp_path / f"{name}.glb").write_bytes(data)
        found = issues(tmp_path / f"{name}.glb")
        assert found["numErrors"] == found["numWarnings"] == 0, (name, found["messages"])


def test_separate_files_become_one(given: Path, tmp_path: Path) -> None:
    document = copy.deepcopy(open_document(given))
    (tmp_path / "data.bin").write_bytes(document.buffers[0])
    (tmp_path / "bumps.png").write_bytes(document.view(document.json["images"][1]["bufferView"]))
    document.json["buffers"][0]["uri"] = "data.bin"
    document.json["images"][1] = {"uri": "bumps.png"}
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(document.json))
    result = painted(path)
    (tmp_path / "asset.glb").write_bytes(result)
    after = open_document(tmp_path / "asset.glb")
    assert_kept(open_document(path), after)
    bumps = after.json["images"][0]
    assert after.view(bumps["bufferView"]) == (tmp_path / "bumps.png").read_bytes()
    assert struct.unpack("<I", result[8:12])[0] == len(result)
