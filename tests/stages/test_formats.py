"""What stage formats writes is opened by readers that are not ours."""

import dataclasses
import io
import zipfile
from pathlib import Path
from typing import Any

import lib3mf
import numpy as np
import pymeshlab
import pytest
import trimesh
from PIL import Image

from pipeline.mesh.gltf import Part, glb_bytes
from pipeline.mesh.materials import Material
from pipeline.mesh.mesh import split_seams
from pipeline.mesh.tangents import vertex_tangents
from pipeline.mesh.unwrap import unwrap_mesh
from pipeline.options.job import Job
from pipeline.run.stage import Context
from pipeline.stages import formats
from tests import shapes

pxr = pytest.importorskip("pxr", reason="the extra usd is not installed")
NAMES = {f"as_{kind}": f"asset.{kind}" for kind in ("ply", "stl", "3mf", "usdz")}
RED, BLUE = (200, 30, 40), (20, 60, 220)


def write(folder: Path) -> dict[str, Any]:
    """Run the stage on folder.parent / asset.glb."""
    folder.mkdir()
    outputs = {label: folder / name for label, name in NAMES.items()}
    job = dataclasses.replace(Job(prompt="a torus"), formats="ply,stl,3mf,usdz")
    context = Context(job, {"glb": folder.parent / "asset.glb"}, outputs, folder / "scratch")
    formats.main(context)
    return context.metrics


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A torus, 0.14 m wide, whose right half is red and whose left half blue, in all formats."""
    path = tmp_path_factory.mktemp("formats")
    mesh, _ = unwrap_mesh(shapes.mesh_of(shapes.torus(0.5, 0.2), 24), 128, 2)
    split = split_seams(mesh._replace(vertices=(0.1 * mesh.vertices).astype(np.float32)))
    uv = split.uv.copy()
    uv[:, 0] = np.where(split.vertices[:, 0] > 0, 0.25, 0.75)
    picture = Image.new("RGB", (64, 64), BLUE)
    picture.paste(RED, (0, 0, 32, 64))
    png, bumps = io.BytesIO(), io.BytesIO()
    picture.save(png, format="PNG")
    Image.new("RGB", (64, 64), (128, 128, 255)).save(bumps, format="PNG")
    part = Part("torus", split.vertices, split.faces, split.normals, uv, vertex_tangents(split))
    glb = glb_bytes([part], png.getvalue(), Material(0.3, 1.0), name="torus", normal_png=bumps.getvalue())
    (path / "asset.glb").write_bytes(glb)
    write(path / "out")
    return path


def test_ply_has_colours_normals_and_texture_coordinates(folder: Path) -> None:
    path = folder / "out" / "asset.ply"
    (folder / "out" / "albedo.png").write_bytes(b"")
    raw = trimesh.load_mesh(path, process=False)
    properties = raw.metadata["_ply_raw"]["vertex"]["data"]
    red = raw.vertices[:, 0] > 0
    for name, first, second in zip(("red", "green", "blue"), RED, BLUE, strict=True):
        np.testing.assert_array_equal(properties[name].ravel(), np.where(red, first, second))
    np.testing.assert_array_equal(properties["s"].ravel(), np.where(red, 0.25, 0.75).astype(np.float32))
    (glb,) = trimesh.load_scene(folder / "asset.glb").geometry.values()
    np.testing.assert_array_equal(raw.triangles, glb.triangles)
    other = pymeshlab.MeshSet()
    other.load_new_mesh(str(path))
    assert other.current_mesh().face_number() == len(glb.faces)
    assert other.current_mesh().has_vertex_color()


def test_stl_and_3mf_are_the_same_closed_solid_upright_in_millimetres(folder: Path) -> None:
    stl = trimesh.load_mesh(folder / "out" / "asset.stl")
    assert stl.is_watertight
    np.testing.assert_allclose(stl.extents, [140, 140, 40], rtol=0.02)
    np.testing.assert_allclose(stl.bounds[0], 0, atol=1e-4)
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(folder / "out" / "asset.3mf"))
    assert reader.GetWarningCount() == 0
    objects = model.GetMeshObjects()
    assert objects.MoveNext()
    mesh = objects.GetCurrentMeshObject()
    assert mesh.IsManifoldAndOriented()
    assert mesh.GetName() == "torus"
    assert mesh.GetTriangleCount() == len(stl.faces)
    assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter
    points = np.array([list(point.Coordinates) for point in mesh.GetVertices()])
    np.testing.assert_allclose(points.max(axis=0), stl.extents, atol=1e-3)
    colours = model.GetColorGroups()
    assert colours.MoveNext()
    group = colours.GetCurrentColorGroup()
    found = {(c.Red, c.Green, c.Blue) for c in map(group.GetColor, group.GetAllPropertyIDs())}
    assert found == {RED, BLUE}


def test_usdz_is_a_package_that_usd_opens(folder: Path) -> None:
    from pxr import Usd, UsdGeom, UsdShade, UsdValidation

    path = folder / "out" / "asset.usdz"
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        data = path.read_bytes()
        for info in archive.infolist():
            assert info.compress_type == zipfile.ZIP_STORED
            head = info.header_offset
            start = (
                head + 30 + sum(int.from_bytes(data[head + at : head + at + 2], "little") for at in (26, 28))
            )
            assert start % 64 == 0
            assert data[start : start + info.file_size] == archive.read(info)
    assert names == ["asset.usdc", "textures/albedo.png", "textures/normal.png"]
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    prim = stage.GetDefaultPrim()
    assert prim.GetName() == "torus"
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/torus/mesh"))
    (glb,) = trimesh.load_scene(folder / "asset.glb").geometry.values()
    points = np.array(mesh.GetPointsAttr().Get())
    np.testing.assert_array_equal(
        points[np.array(mesh.GetFaceVertexIndicesAttr().Get())].reshape(-1, 3, 3), glb.triangles
    )
    st = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get())
    np.testing.assert_allclose(st, glb.visual.uv, atol=1e-6)
    material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
    surface = material.ComputeSurfaceSource()[0]
    assert surface.GetInput("metallic").Get() == 1
    assert surface.GetInput("roughness").Get() == pytest.approx(0.3)
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert not [error.GetMessage() for error in context.Validate(stage)]


def test_the_same_bytes_again_and_figures_for_the_printer(folder: Path) -> None:
    metrics = write(folder / "again")
    for name in NAMES.values():
        assert (folder / "again" / name).read_bytes() == (folder / "out" / name).read_bytes(), name
        assert metrics["bytes"][name] > 0
    assert not metrics["wrapped"]
    assert metrics["median_wall_mm"] == pytest.approx(40, rel=0.1)
    assert metrics["size_mm"][2] == pytest.approx(40, rel=0.03)


def test_an_asset_without_a_texture_keeps_its_colours(tmp_path: Path) -> None:
    ball = shapes.mesh_of(shapes.ball(0.5), 16)
    green = np.tile([0.0, 0.5, 0.0], (len(ball.vertices), 1))
    part = Part("ball", ball.vertices, ball.faces, colours=green)
    (tmp_path / "asset.glb").write_bytes(glb_bytes([part], None, Material(0.5, 0.0)))
    write(tmp_path / "out")
    read = trimesh.load_mesh(tmp_path / "out" / "asset.ply", process=False)
    visual: Any = read.visual
    assert (visual.vertex_colors[:, :3] == [0, 188, 0]).all(), "linear 0.5 is sRGB 188"
    assert "TextureFile" not in (tmp_path / "out" / "asset.ply").read_bytes()[:400].decode("latin-1")
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(tmp_path / "out" / "asset.usdz"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/ball/mesh"))
    np.testing.assert_allclose(mesh.GetDisplayColorAttr().Get()[0], [0, 0.5, 0], atol=2e-3)
