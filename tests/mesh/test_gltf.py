import io
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.mesh.gltf import Part, glb_bytes
from pipeline.mesh.materials import Material
from pipeline.mesh.mesh import SplitMesh, split_seams
from pipeline.mesh.unwrap import unwrap_mesh
from tests import shapes
from tests.validator import issues

MATT = Material(1.0, 0.0)


def whole(mesh: SplitMesh) -> Part:
    return Part("asset", mesh.vertices, mesh.faces, mesh.normals, mesh.uv)


@pytest.fixture(scope="module")
def mesh() -> SplitMesh:
    return split_seams(unwrap_mesh(shapes.mesh_of(shapes.torus(0.5, 0.2), 24), 128, 2)[0])


@pytest.fixture(scope="module")
def image() -> Image.Image:
    return Image.fromarray(np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8))


@pytest.fixture(scope="module")
def glb(mesh: SplitMesh, image: Image.Image) -> bytes:
    png = io.BytesIO()
    image.save(png, format="PNG")
    return glb_bytes([whole(mesh)], png.getvalue(), MATT)


def test_another_program_reads_the_same_mesh_and_image(
    glb: bytes, mesh: SplitMesh, image: Image.Image
) -> None:
    scene = trimesh.load_scene(io.BytesIO(glb), file_type="glb")
    (loaded,) = scene.geometry.values()
    np.testing.assert_array_equal(loaded.vertices, mesh.vertices)
    np.testing.assert_array_equal(loaded.faces, mesh.faces)
    np.testing.assert_allclose(loaded.vertex_normals, mesh.normals, atol=1e-6)
    uv = loaded.visual.uv  # trimesh counts from the bottom
    np.testing.assert_allclose(np.c_[uv[:, 0], 1 - uv[:, 1]], mesh.uv, atol=1e-6)
    material = loaded.visual.material
    np.testing.assert_array_equal(np.asarray(material.baseColorTexture), np.asarray(image))
    assert material.metallicFactor == 0
    assert material.roughnessFactor == 1


def test_the_same_mesh_gives_the_same_bytes(glb: bytes, mesh: SplitMesh, image: Image.Image) -> None:
    png = io.BytesIO()
    image.save(png, format="PNG")
    assert glb_bytes([whole(mesh)], png.getvalue(), MATT) == glb


def test_unlit_is_an_extension_and_lit_is_none(glb: bytes, mesh: SplitMesh, image: Image.Image) -> None:
    assert b"KHR_materials_unlit" not in glb
    png = io.BytesIO()
    image.save(png, format="PNG")
    unlit = glb_bytes([whole(mesh)], png.getvalue(), MATT._replace(unlit=True), name="torus")
    assert unlit.count(b"KHR_materials_unlit") == 2


def test_the_khronos_validator_finds_nothing(glb: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(glb)
    found = issues(tmp_path / "a.glb")
    assert found["numErrors"] == found["numWarnings"] == 0, found["messages"]
    # A damaged file does not pass, so the silence above means something.
    (tmp_path / "a.glb").write_bytes(glb.replace(b'"count":', b'"kount":', 1))
    assert issues(tmp_path / "a.glb")["numErrors"] > 0
