import dataclasses
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.errors import InputError
from pipeline.mesh.gltf_json import read_gltf_json
from pipeline.mesh.mesh import read_obj, write_obj
from pipeline.mesh.shading import Light, shade
from pipeline.mesh.texture import paint, surface_texels
from pipeline.mesh.topology import topology
from pipeline.mesh.unwrap import unwrap_mesh
from pipeline.options.job import Job
from pipeline.run.stage import Context
from pipeline.stages import publish
from tests import shapes
from tests.validator import issues

NAMES = {
    "glb": "asset.glb",
    "lod1": "asset_lod1.glb",
    "lod2": "asset_lod2.glb",
    "obj": "asset.obj",
    "mtl": "asset.mtl",
    "albedo": "albedo.png",
    "preview": "preview.png",
    "turntable": "turntable.mp4",
}


def run(
    folder: Path, out: str, prompt: str = "a torus", light: list[float] | None = None, **more: Any
) -> dict[str, Any]:
    (folder / out).mkdir()
    job = Job(prompt=prompt)
    small = {"preview_size": 48, "turntable_size": 48, "turntable_frames": 4, **more}
    options = dataclasses.replace(job.publish, **small)
    inputs = {"mesh": folder / "mesh_uv.obj", "albedo": folder / "albedo_baked.png"}
    if light:
        inputs["description"] = folder / out / "bundle.json"
        inputs["description"].write_text(json.dumps({"light": light}))
        inputs["albedo"] = folder / "albedo_lit.png"
    context = Context(
        dataclasses.replace(job, publish=options),
        inputs,
        {key: folder / out / name for key, name in NAMES.items()},
        folder / "scratch",
    )
    publish.main(context)
    return context.metrics


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("publish")
    mesh, _ = unwrap_mesh(shapes.mesh_of(shapes.torus(0.5, 0.2), 24), 128, 2)
    write_obj(path / "mesh_uv.obj", mesh)
    noise = np.random.default_rng(0).integers(0, 256, (128, 128, 3), np.uint8)
    Image.fromarray(noise).save(path / "albedo_baked.png")
    return path


@pytest.fixture(scope="module")
def metrics(folder: Path) -> dict[str, Any]:
    return run(folder, "first")


def test_figures(folder: Path, metrics: dict[str, Any]) -> None:
    mesh = read_obj(folder / "mesh_uv.obj")
    assert metrics["faces"] == len(mesh.faces)
    assert metrics["vertices"] == len(mesh.vertices) < metrics["vertices_with_seams"]
    assert metrics["manifold"]
    assert metrics["watertight"]
    assert metrics["components"] == topology(mesh).components == 1
    assert metrics["texture"] == 128
    for key, name in NAMES.items():
        assert metrics["bytes"][key] == (folder / "first" / name).stat().st_size > 0


def test_the_obj_opens_with_its_material_and_texture(folder: Path, metrics: dict[str, Any]) -> None:
    loaded = trimesh.load_mesh(folder / "first" / "asset.obj", process=False)
    visual: Any = loaded.visual
    texture = np.asarray(visual.material.image.convert("RGB"))
    np.testing.assert_array_equal(texture, np.asarray(Image.open(folder / "albedo_baked.png")))
    assert len(loaded.faces) == metrics["faces"]
    assert "illum 2" in (folder / "first" / "asset.mtl").read_text()
    assert "\no torus\n" in (folder / "first" / "asset.obj").read_text()


def test_obj_and_glb_agree(folder: Path, metrics: dict[str, Any]) -> None:
    obj = trimesh.load_mesh(folder / "first" / "asset.obj", process=False)
    (glb,) = trimesh.load_scene(folder / "first" / "asset.glb").geometry.values()
    assert glb.vertices.shape == (metrics["vertices_with_seams"], 3)
    np.testing.assert_allclose(obj.triangles, glb.triangles, atol=1e-7)
    obj_visual: Any = obj.visual
    glb_visual: Any = glb.visual
    np.testing.assert_allclose(obj_visual.uv[obj.faces], glb_visual.uv[glb.faces], atol=1e-6)


def test_the_preview_is_a_sheet_of_twelve(folder: Path, metrics: dict[str, Any]) -> None:
    with Image.open(folder / "first" / "preview.png") as image:
        assert image.size == (4 * 56 + 8, 3 * 56 + 8)


def test_everything_is_the_same_the_second_time(folder: Path, metrics: dict[str, Any]) -> None:
    assert run(folder, "second") == metrics
    for name in NAMES.values():
        assert (folder / "first" / name).read_bytes() == (folder / "second" / name).read_bytes(), name


def extents(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and greatest coordinates of an asset, and see that GLB and OBJ agree on them."""
    glb = trimesh.load_scene(folder / "asset.glb").bounds
    np.testing.assert_allclose(trimesh.load_mesh(folder / "asset.obj").bounds, glb, atol=1e-6)
    return glb[0], glb[1]


def test_the_asset_stands_on_the_floor_in_metres_under_its_name(
    folder: Path, metrics: dict[str, Any]
) -> None:
    low, high = extents(folder / "first")
    np.testing.assert_allclose([low[1], *(low + high)[[0, 2]]], 0, atol=1e-6)
    found = run(folder, "centred", "a golden torus", pivot="centre", size_m=3.0, unlit=True)
    low, high = extents(folder / "centred")
    np.testing.assert_allclose(low + high, 0, atol=1e-5)
    assert (high - low).max() == pytest.approx(3)
    assert found["material"] == {"word": "golden", "roughness": 0.3, "metallic": 1.0, "unlit": True}
    assert metrics["material"]["word"] == ""
    document = read_gltf_json(folder / "centred" / "asset.glb")
    named = [document[what][0]["name"] for what in ("nodes", "meshes", "materials")]
    assert named == ["golden_torus"] * 3
    assert "illum 0" in (folder / "centred" / "asset.mtl").read_text()


def test_levels_have_fewer_faces_the_same_place_and_one_texture(
    folder: Path, metrics: dict[str, Any]
) -> None:
    low, high = extents(folder / "first")
    texture = np.asarray(Image.open(folder / "first" / "albedo.png"))
    most = [round(share * metrics["faces"]) for share in (0.25, 0.06)]
    for number, level in enumerate(metrics["levels"], 1):
        path = folder / "first" / f"asset_lod{number}.glb"
        assert read_gltf_json(path)["images"] == [{"name": "albedo", "uri": "albedo.png"}]
        assert path.stat().st_size < 0.4 * (folder / "first" / "asset.glb").stat().st_size
        (mesh,) = trimesh.load_scene(path).geometry.values()
        assert len(mesh.faces) == level["faces"] <= 1.5 * most[number - 1]
        np.testing.assert_allclose(mesh.bounds, [low, high], atol=0.05)
        visual: Any = mesh.visual
        np.testing.assert_array_equal(np.asarray(visual.material.baseColorTexture.convert("RGB")), texture)
        assert 0 <= visual.uv.min() <= visual.uv.max() <= 1
    first, second = (level["silhouette_iou"] for level in metrics["levels"])
    assert first > 0.97
    assert second > 0.9
    found = issues(folder / "first" / "asset_lod1.glb")
    assert found["numErrors"] == found["numWarnings"] == 0, found


def test_the_light_of_the_training_pictures_is_divided_out_where_a_viewer_adds_its_own(folder: Path) -> None:
    mesh = read_obj(folder / "mesh_uv.obj")
    texels = surface_texels(mesh, 128)
    towards = np.array([0.0, 0.8, 0.6])
    lit = 0.4 * shade(texels.normal, towards, Light(0.6, 0.4, 1.0))[:, None] * np.ones(3)
    texture = paint(lit.astype(np.float32), texels, 8)
    Image.fromarray(np.round(255 * texture).astype(np.uint8)).save(folder / "albedo_lit.png")
    found = run(folder, "divided", light=[0.0, 0.8, 0.6])
    assert found["light_divided_out"]["explained"] > 0.9
    values = np.asarray(Image.open(folder / "divided" / "albedo.png")).reshape(-1, 3)[texels.place]
    assert np.ptp(values.astype(int), axis=0).max() < 20 < 100 * np.ptp(lit)
    assert "light_divided_out" not in run(folder, "kept", light=[0.0, 0.8, 0.6], unlit=True)
    before, after = ((folder / f"{name}").read_bytes() for name in ("albedo_lit.png", "kept/albedo.png"))
    np.testing.assert_array_equal(*(np.asarray(Image.open(io.BytesIO(data))) for data in (before, after)))
    with pytest.raises(InputError, match="light has length 2, expected 1"):
        run(folder, "wrong", light=[0.0, 2.0, 0.0])
