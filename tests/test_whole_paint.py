"""From a prompt and a mesh to a painted asset through the front door, every real stage, with a tiny model."""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.files import file_sha256
from pipeline.mesh.gltf_document import open_document
from pipeline.mesh.gltf_json import read_gltf_json
from pipeline.mesh.readers import read_mesh
from tests.fake_project import ROOT, clean_environment, kill_group
from tests.kept_document import assert_kept
from tests.rigged_model import rigged_glb
from tests.tiny_bundle import write_tiny_bundle

OPTIONS = """
prepare: {resolution: 128}
train_paint: {steps: 40, cameras_per_step: 2, views: 8, texture: 32, supersampling: 2, checkpoint_every: 5}
refinement: {steps: 4, cameras_per_step: 2, checkpoint_every: 2}
bake_paint: {views: 6, texture: 128}
publish: {preview_size: 48, turntable_size: 48, turntable_frames: 6}
"""


def command(folder: Path, mesh: str, out: str, **more: str) -> list[str]:
    given = {
        "PROMPT": "a red ball",
        "MESH": str(folder / mesh),
        "MODEL": str(folder / "model"),
        "JOB": str(folder / "job.yaml"),
        "OUT": str(folder / out),
        "IN_VENV": sys.executable,
        "THREADS": "2",
        **more,
    }
    return ["make", "-o", ".venv/.runtime", "run", *(f"{name}={value}" for name, value in given.items())]


def make(folder: Path, mesh: str, out: str, **more: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        command(folder, mesh, out, **more),
        cwd=ROOT,
        env=clean_environment(),
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a model, a job, a mesh in two parts and a finished run in `runs`."""
    folder = tmp_path_factory.mktemp("paint")
    write_tiny_bundle(folder / "model")
    (folder / "job.yaml").write_text(OPTIONS)
    ball, box = trimesh.creation.icosphere(2), trimesh.creation.box((0.5, 0.5, 0.5))
    box.apply_translation((0.0, 1.2, 0.0))
    text, start = "", 1
    for name, part in (("the ball", ball), ("box", box)):
        text += f"o {name}\n" + "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in part.vertices.tolist())
        text += "".join("f " + " ".join(str(i + start) for i in f) + "\n" for f in part.faces.tolist())
        start += len(part.vertices)
    (folder / "a: {mesh} 'x'.obj").write_text(text)
    result = make(folder, "a: {mesh} 'x'.obj", "runs")
    assert result.returncode == 0, result.stderr
    return folder


def test_the_asset_is_the_mesh_that_was_given(folder: Path) -> None:
    given = read_mesh(folder / "a: {mesh} 'x'.obj")
    latest = folder / "runs" / "latest"
    scene = trimesh.load_scene(latest / "asset.glb", process=False)
    assert set(scene.graph.nodes_geometry) == {"the ball", "box"}
    for name, row in (("the ball", 0), ("box", 1)):
        part = scene.geometry[scene.graph[name][1]]
        expected = given.vertices[given.faces[given.part == row]].astype(np.float32)
        np.testing.assert_array_equal(part.vertices[part.faces].astype(np.float32), expected)
        assert part.visual.material.baseColorTexture.size == (128, 128)
    again = read_mesh(latest / "asset.obj")
    np.testing.assert_array_equal(again.vertices, given.vertices)
    np.testing.assert_array_equal(again.faces, given.faces)
    assert again.names == given.names
    assert "illum 2" in (latest / "asset.mtl").read_text()


def test_a_rig_comes_back_with_new_colours_and_nothing_else(folder: Path) -> None:
    (folder / "rigged.glb").write_bytes(rigged_glb())
    result = make(folder, "rigged.glb", "rigged", UNLIT="1")
    assert result.returncode == 0, result.stderr
    asset = folder / "rigged" / "latest" / "asset.glb"
    assert_kept(open_document(folder / "rigged.glb"), after := open_document(asset))
    colour = after.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"]
    view = after.json["images"][after.json["textures"][colour]["source"]]["bufferView"]
    assert after.view(view) == asset.with_name("albedo.png").read_bytes()
    assert "KHR_materials_unlit" in after.json["extensionsUsed"]
    again = make(folder, "rigged.glb", "rigged", UNLIT="1")
    assert "nothing to do" in again.stderr


def test_the_manifest_reports_coordinates_coverage_and_seams(folder: Path) -> None:
    manifest = json.loads((folder / "runs" / "latest" / "manifest.json").read_text())
    stages = {entry["stage"]: entry["metrics"] for entry in manifest["stages"]}
    assert list(stages) == ["embed", "prepare", "train_paint", "bake_paint", "publish_paint"]
    assert stages["prepare"]["uv"] == "new (xatlas)"
    assert 0.5 < stages["train_paint"]["seen_share"] <= 1
    baked = stages["bake_paint"]
    assert 0.5 < baked["texel_coverage"] <= 1
    assert baked["seam_edges"] > 0
    assert 0 <= baked["seam_error"] < 0.2
    assert baked["psnr"] > 15


def test_killed_in_training_and_continued_is_the_same_asset(folder: Path) -> None:
    process = subprocess.Popen(
        command(folder, "a: {mesh} 'x'.obj", "killed"),
        cwd=ROOT, env=clean_environment(), stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    deadline = time.monotonic() + 240
    while not list(folder.glob("killed/*/checkpoints/train_paint/*.checkpoint")):
        assert process.poll() is None, "ended before the first checkpoint"
        assert time.monotonic() < deadline
        time.sleep(0.01)
    kill_group(process)
    assert not list(folder.glob("killed/*/painted.npz")), "killed too late to test anything"
    result = make(folder, "a: {mesh} 'x'.obj", "killed")
    assert result.returncode == 0, result.stderr
    for name in ("painted.npz", "asset.glb", "albedo.png", "preview.png"):
        one, other = (folder / out / "latest" / name for out in ("killed", "runs"))
        assert file_sha256(one) == file_sha256(other), name


def test_one_colour_a_face_is_exported_as_vertex_colours(folder: Path) -> None:
    result = make(folder, "a: {mesh} 'x'.obj", "faces", PARAM="face")
    assert result.returncode == 0, result.stderr
    latest = folder / "faces" / "latest"
    assert not (latest / "albedo.png").exists()
    assert "albedo.png" not in (latest / "report.html").read_text()
    document = read_gltf_json(latest / "asset.glb")
    attributes = [mesh["primitives"][0]["attributes"] for mesh in document["meshes"]]
    assert [set(a) for a in attributes] == [{"POSITION", "COLOR_0"}] * 2
    coloured = [
        [float(word) for word in line.split()[1:]]
        for line in (latest / "asset.obj").read_text().splitlines()
        if line.startswith("v ")
    ]
    assert {len(row) for row in coloured} == {6}
    assert np.std(np.array(coloured)[:, 3:], axis=0).max() > 0.01


@pytest.mark.parametrize(
    ("text", "word"),
    [("v 0 0 0\n", "no faces"), ("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "NaN"), (None, "does not exist")],
)
def test_a_mesh_that_cannot_be_painted_is_said_in_one_line(folder: Path, text: str | None, word: str) -> None:
    if text is not None:
        (folder / "bad.obj").write_text(text)
    result = make(folder, "gone.obj" if text is None else "bad.obj", "bad")
    assert result.returncode != 0
    errors = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert word in errors[0]


@pytest.mark.parametrize("param", ["texture", "face"])
def test_refined_starts_from_the_baked_colours(folder: Path, param: str) -> None:
    result = make(folder, "a: {mesh} 'x'.obj", "runs", REFINE="1", PARAM=param)
    assert result.returncode == 0, result.stderr
    latest = folder / "runs" / "latest"
    stages = [entry["stage"] for entry in json.loads((latest / "manifest.json").read_text())["stages"]]
    assert stages == ["embed", "prepare", "train_paint", "bake_paint", "refine_paint", "publish_paint"]
    pictures = []
    for name in ("albedo_baked.png", "albedo_refined.png"):
        with Image.open(latest / name, formats=["PNG"]) as image:
            pictures.append(np.asarray(image.convert("RGB"), np.float32) / 255)
    change = np.abs(pictures[1] - pictures[0])
    assert 0 < change.max() < 0.1
    assert change.mean() > 1e-4
    reused = [line.split(":")[0] for line in result.stderr.splitlines() if "reused from" in line]
    assert ("bake_paint" in reused) == (param == "texture")
