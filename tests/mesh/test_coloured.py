"""Meshes of other tools with their colours: what is read is what is shown, and what is missing is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.cameras import orbit_camera
from pipeline.errors import InputError
from pipeline.mesh.coloured import face_coloured, picture_of, read_coloured, textured, to_linear, to_srgb
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.readers import read_mesh
from tests.rigged_model import rigged_glb

CAMERA = orbit_camera(0.0, np.pi / 2, 3.0, np.radians(40))
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
"""Origin at the bottom left, as trimesh and OBJ have it."""
QUARTERS = (
    np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 0]]], np.uint8).repeat(32, 0).repeat(32, 1)
)
"""Red and green above, blue and yellow below."""


def square(visual: object) -> trimesh.Trimesh:
    return trimesh.Trimesh(SQUARE, FACES, visual=visual, process=False)


def quarters_of(picture: np.ndarray) -> np.ndarray:
    """Return the colours at the middles of the quarters of a picture that is twice as wide as the square."""
    size = len(picture)
    low, high = round(size * 0.36), round(size * 0.64)
    return np.array([[picture[y, x] for x in (low, high)] for y in (low, high)])


@pytest.mark.parametrize("suffix", ["glb", "gltf", "obj"])
def test_a_texture_is_where_the_file_has_it(suffix: str, tmp_path: Path) -> None:
    image = Image.fromarray(QUARTERS)
    material: Any = trimesh.visual.material.PBRMaterial(
        baseColorTexture=image, baseColorFactor=[255, 255, 255, 255]
    )
    if suffix == "obj":
        material = trimesh.visual.material.SimpleMaterial(image=image)
    made = square(trimesh.visual.TextureVisuals(UV, material=material))
    if suffix == "gltf":
        files: Any = made.export(file_type="gltf")
        for name, content in files.items():
            (tmp_path / name.replace("model", "a")).write_bytes(content)
    else:
        made.export(tmp_path / f"a.{suffix}")
    mesh = read_coloured(tmp_path / f"a.{suffix}")
    picture, opacity = picture_of(mesh, CAMERA, 64)
    np.testing.assert_allclose(quarters_of(picture), QUARTERS[::32, ::32] / 255, atol=0.01)
    assert opacity[32, 32] == 1
    assert opacity[0, 0] == 0
    assert not picture[0, 0].any()


def test_a_factor_multiplies_light_not_numbers(tmp_path: Path) -> None:
    image = Image.fromarray(np.full((4, 4, 3), 188, np.uint8))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, baseColorFactor=[128, 255, 0, 255])
    square(trimesh.visual.TextureVisuals(UV, material=material)).export(tmp_path / "a.glb")
    shown = picture_of(read_coloured(tmp_path / "a.glb"), CAMERA, 64)[0][32, 32]
    light = to_linear(np.full(3, 188 / 255)) * [128 / 255, 1, 0]
    np.testing.assert_allclose(shown, to_srgb(light), atol=0.01)


@pytest.mark.parametrize(("suffix", "linear"), [("ply", False), ("glb", True), ("obj", False)])
def test_vertex_colours_are_read(suffix: str, linear: bool, tmp_path: Path) -> None:
    square(trimesh.visual.ColorVisuals(vertex_colors=np.tile([200, 100, 50, 255], (4, 1)))).export(
        tmp_path / f"a.{suffix}"
    )
    shown = picture_of(read_coloured(tmp_path / f"a.{suffix}"), CAMERA, 64)[0][32, 32]
    said = np.array([200, 100, 50]) / 255
    np.testing.assert_allclose(shown, to_srgb(said) if linear else said, atol=0.01)


def test_several_parts_keep_their_colours_and_places(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for x, colour in ((-0.6, [255, 0, 0, 255]), (0.6, [0, 0, 255, 255])):
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=colour)
        part = square(trimesh.visual.TextureVisuals(UV, material=material)).apply_scale(0.4)
        scene.add_geometry(part, transform=trimesh.transformations.translation_matrix([x, 0, 0]))
    scene.export(tmp_path / "a.glb")
    picture, _ = picture_of(read_coloured(tmp_path / "a.glb"), CAMERA, 64)
    np.testing.assert_allclose(picture[32, 14], [1, 0, 0], atol=0.01)
    np.testing.assert_allclose(picture[32, 50], [0, 0, 1], atol=0.01)


def test_own_meshes_in_texture_and_in_faces() -> None:
    flipped = UV * [1, -1] + [0, 1]
    mesh = Mesh(SQUARE, FACES.astype(np.int32), flipped, FACES.astype(np.int32))
    shown = picture_of(textured(mesh, QUARTERS / np.float32(255)), CAMERA, 64)[0]
    np.testing.assert_allclose(quarters_of(shown), QUARTERS[::32, ::32] / 255, atol=0.01)
    faces = picture_of(face_coloured(SQUARE, FACES, np.array([[1, 0, 0], [0, 1, 0.0]])), CAMERA, 64)[0]
    np.testing.assert_allclose([faces[40, 40], faces[24, 24]], [[1, 0, 0], [0, 1, 0]], atol=0.01)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    trimesh.creation.box().export(tmp_path / "plain.stl")
    with pytest.raises(InputError, match=r"plain\.stl has no colours.*SKETCH="):
        read_coloured(tmp_path / "plain.stl")
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in SQUARE) + "vt 0 0\nusemtl m\nf 1/1 2/1 3/1\n"
    (tmp_path / "a.obj").write_text("mtllib m.mtl\n" + text)
    with pytest.raises(InputError, match=r"material file 'm\.mtl' is missing"):
        read_coloured(tmp_path / "a.obj")
    for said, fault in (
        ("map_Kd none.png", "texture 'none.png' is missing"),
        ("map_Kd ../../secret.png", "lies outside its folder"),
        ("map_Kd -s 1 1 1 broken.png", r"broken\.png: not a readable picture"),
    ):
        (tmp_path / "m.mtl").write_text(f"newmtl m\n{said}\n")
        (tmp_path / "broken.png").write_bytes(b"\x89PNG")
        with pytest.raises(InputError, match=fault):
            read_coloured(tmp_path / "a.obj")
    (tmp_path / "m.mtl").write_text("newmtl m\nKd 1 0 0\n")
    np.testing.assert_allclose(read_coloured(tmp_path / "a.obj").colours[0, 0], [1, 0, 0])


def test_a_rigged_model_is_shown_in_its_rest_pose(tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(rigged_glb())
    given, coloured = read_mesh(tmp_path / "a.glb"), read_coloured(tmp_path / "a.glb")
    np.testing.assert_array_equal(coloured.vertices, given.vertices)
    wanted, found = (np.sort(m.vertices[m.faces].sum(1), axis=0) for m in (given, coloured))
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_twins_of_other_colours_stay_apart(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    for name, colour, x in (("a", [255, 0, 0, 255], -2.0), ("b", [0, 255, 0, 255], 2.0)):
        visual = trimesh.visual.TextureVisuals(
            UV, material=trimesh.visual.material.PBRMaterial(name=name, baseColorFactor=colour)
        )
        scene.add_geometry(
            square(visual), geom_name=name, transform=trimesh.transformations.translation_matrix([x, 0, 0])
        )
    scene.export(tmp_path / "a.glb")
    mesh = read_coloured(tmp_path / "a.glb")
    left = mesh.vertices[mesh.faces].mean(1)[:, 0] < 0
    np.testing.assert_allclose(mesh.colours[left].reshape(-1, 3), np.tile([1.0, 0, 0], (6, 1)), atol=1e-6)
    np.testing.assert_allclose(mesh.colours[~left].reshape(-1, 3), np.tile([0, 1.0, 0], (6, 1)), atol=1e-6)
