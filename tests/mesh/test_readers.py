"""What people and fuzzers give as a mesh: read as it is, or refused in one line."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.errors import InputError
from pipeline.mesh.companion_files import buffer_files
from pipeline.mesh.readers import InputMesh, read_mesh
from tests.faults import hostile

ONE_MESH = {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}

TWO_PARTS = """
# two squares
o left
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
f 1/1 2/2 3/3 4/4
o right one
v 2.000000001 0 0
v 3 0 0
v 3 1 0
f -3/1/1 -2/2/1 -1/3/1
"""


def save(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def surface(mesh: InputMesh) -> np.ndarray:
    """Return the corners of all triangles, sorted: equal for equal surfaces however they are indexed."""
    corners = mesh.vertices[mesh.faces].reshape(-1, 9)
    return corners[np.lexsort(corners.T)]


def test_obj_keeps_precision_parts_polygons_and_texture_points(tmp_path: Path) -> None:
    mesh = read_mesh(save(tmp_path, "a.obj", TWO_PARTS))
    assert mesh.names == ("left", "right one")
    assert mesh.part.tolist() == [0, 0, 1]
    assert mesh.vertices[4, 0] == 2.000000001
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6]]
    assert mesh.uv is not None
    assert mesh.uv_faces is not None
    assert mesh.uv[mesh.uv_faces[2]].tolist() == [[0, 1], [1, 1], [1, 0]]  # from the bottom to the top


def test_obj_with_tabs_comments_continued_lines_and_colours(tmp_path: Path) -> None:
    text = "v\t0 0 0 1 0 0 # red\r\n  v 1 0 0 1\r\nv 0 1\t0\r\nf\t1// 2// \\\n 3//  # a face\r\nl 1 2\r\n"
    mesh = read_mesh(save(tmp_path, "a.obj", text))
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert mesh.uv is None


def test_obj_with_a_byte_order_mark_keeps_its_first_vertex(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 9\nf 1 2 3\n"
    mesh = read_mesh(save(tmp_path, "bom.obj", "\ufeff" + text))
    assert surface(mesh)[..., 2].max() == 0


def test_obj_with_some_corners_untextured_has_no_texture_points(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\nf 1 2 3\n"
    mesh = read_mesh(save(tmp_path, "plain.obj", text))
    assert mesh.uv is None
    assert mesh.names == ("plain",)


@pytest.mark.parametrize("kind", ["ply", "stl", "off", "glb", "gltf"])
def test_every_format_gives_the_same_surface(tmp_path: Path, kind: str) -> None:
    box = trimesh.creation.box((1, 2, 3))
    scene = trimesh.Scene({"box": box})
    written = scene.export(file_type=kind) if kind in ("glb", "gltf") else box.export(file_type=kind)
    if isinstance(written, dict):
        for name, data in written.items():
            (tmp_path / name).write_bytes(data)
        path = (tmp_path / "model.gltf").rename(tmp_path / "box.gltf")
        assert {file.suffix for file in buffer_files(path)} == {".bin"}
    else:
        path = save(tmp_path, f"box.{kind}", written)
    mesh = read_mesh(path)
    assert len(mesh.vertices) == 8  # STL's 36 corners are welded
    expected = box.triangles.reshape(-1, 9)
    if kind == "stl":  # a corner may come first that did not before
        return
    np.testing.assert_allclose(surface(mesh), expected[np.lexsort(expected.T)], atol=1e-6)


def test_gltf_instances_are_parts_in_their_places(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    box = trimesh.creation.box()
    scene.add_geometry(box, node_name="here", geom_name="box")
    mirrored = np.diag([-1.0, 1, 1, 1])
    mirrored[0, 3] = 5
    scene.add_geometry(box, node_name="there", geom_name="box", transform=mirrored)
    mesh = read_mesh(save(tmp_path, "two.glb", scene.export(file_type="glb")))
    assert sorted(mesh.names) == ["here", "there"]
    for row, name in enumerate(mesh.names):
        faces = mesh.faces[mesh.part == row]
        part = trimesh.Trimesh(mesh.vertices, faces, process=False)
        part.remove_unreferenced_vertices()
        assert part.centroid[0] == pytest.approx(5 if name == "there" else 0)
        assert part.volume == pytest.approx(1)  # outwards, mirrored too


def test_concave_polygons_keep_their_outline(tmp_path: Path) -> None:
    """An L, an arrow (a concave quadrilateral) and a convex pentagon, each turned into space."""
    shapes = {
        "ell": ([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)], 5.0),
        "arrow": ([(2, 0), (0, 1), (-2, 0), (0, 4)], 6.0),
        "pentagon": ([(0, 0), (2, 0), (3, 1), (1, 3), (0, 2)], 6.0),
    }
    turn = trimesh.transformations.random_rotation_matrix(np.random.default_rng(4).random(3))[:3, :3]
    for name, (ring, area) in shapes.items():
        for rows in (ring, ring[::-1], ring[2:] + ring[:2]):
            points = np.array([(*p, 1e6) for p in rows]) @ turn.T
            lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
            lines += [f"vt {x} {y}" for x, y in rows]
            lines.append("f " + " ".join(f"{i}/{i}" for i in range(1, len(rows) + 1)))
            mesh = read_mesh(save(tmp_path, f"{name}.obj", "\n".join(lines)))
            corners = mesh.vertices[mesh.faces]
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
            assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(area, abs=1e-4)
            # all turn as the ring does: their areas add up with one sign
            x, y = np.array(rows).T
            signed = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
            assert normals.sum(0) @ turn[:, 2] == pytest.approx(signed, abs=1e-4)
            assert mesh.uv is not None
            assert mesh.uv_faces is not None
            np.testing.assert_array_equal(mesh.uv_faces, mesh.faces)


def test_a_polygon_that_crosses_itself_is_still_read(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 2 2 0\nv 2 0 0\nv 0 3 0\nv nan 0 0\n"
    assert len(read_mesh(save(tmp_path, "a.obj", text.replace("nan", "9") + "f 1 2 3 4\n")).faces) == 2
    with pytest.raises(InputError, match="NaN"):
        read_mesh(save(tmp_path, "b.obj", text + "f 1 2 3 4 5\n"))
    with pytest.raises(InputError, match="indices"):
        read_mesh(save(tmp_path, "c.obj", text + "f 1 2 3 4 6\n"))


def test_faces_without_texture_points_are_counted(tmp_path: Path) -> None:
    mesh = read_mesh(save(tmp_path, "a.obj", TWO_PARTS + "f 1 2 3 4\n"))
    assert mesh.uv is None
    assert mesh.untextured == 2
    assert read_mesh(save(tmp_path, "b.obj", TWO_PARTS)).untextured == 0
    assert read_mesh(save(tmp_path, "c.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")).untextured == 0


def test_primitives_of_a_mesh_have_the_same_names_every_time(tmp_path: Path) -> None:
    written = trimesh.Scene(
        {"one": trimesh.creation.box(), "two": trimesh.creation.icosphere(subdivisions=1)}
    ).export(file_type="gltf")
    document = json.loads(written["model.gltf"])
    both = [mesh["primitives"][0] for mesh in document["meshes"]]
    document["meshes"] = [{"name": "thing", "primitives": both}]
    document["nodes"] = [
        {"name": "thing", "mesh": 0},
        {"name": "thing_1", "mesh": 0, "translation": [3, 0, 0]},
    ]
    document["scenes"], document["scene"] = [{"nodes": [0, 1]}], 0
    for name, data in written.items():
        (tmp_path / name).write_bytes(data)
    path = save(tmp_path, "model.gltf", json.dumps(document))
    first, second = read_mesh(path), read_mesh(path)
    assert sorted(first.names) == ["thing_0", "thing_1_0", "thing_1_1", "thing_2"]
    assert first.names == second.names
    np.testing.assert_array_equal(first.faces, second.faces)
    np.testing.assert_array_equal(first.vertices, second.vertices)


def test_a_scene_may_name_a_root_again_and_again(tmp_path: Path) -> None:
    children = [{"mesh": 0}] * 1000
    document = hostile.gltf(
        nodes=[{"children": list(range(1, 1001))}, *children], scenes=[{"nodes": [0] * 100_000}]
    )
    (tmp_path / "a.gltf").write_bytes(document)
    assert len(read_mesh(tmp_path / "a.gltf").faces) == 2000


def test_thousands_of_nodes_that_show_one_mesh_get_names_of_their_own(tmp_path: Path) -> None:
    nodes = [{"mesh": 0, "translation": [i, 0, 0]} for i in range(3000)]
    many = hostile.gltf(
        nodes=nodes, scenes=[{"nodes": list(range(3000))}], meshes=[{**ONE_MESH, "name": "thing"}]
    )
    names = read_mesh(save(tmp_path, "many.gltf", many)).names
    assert list(names) == ["thing", *(f"thing_{i}" for i in range(2999))]


def test_gltf_without_scenes_shows_all_its_nodes(tmp_path: Path) -> None:
    document = json.loads(hostile.gltf(nodes=[{"children": [1]}, {"mesh": 0}]))
    del document["scenes"], document["scene"]
    assert len(read_mesh(save(tmp_path, "none.gltf", json.dumps(document))).faces) == 2


@pytest.mark.parametrize(("mode", "corners"), [(4, [0, 1, 2, 0, 2, 3]), (5, [0, 1, 3, 2]), (6, [0, 1, 2, 3])])
def test_strips_and_fans_of_gltf_are_their_triangles(tmp_path: Path, mode: int, corners: list[int]) -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    data = square.tobytes() + np.array(corners, np.uint32).tobytes()
    content = gltf(
        buffers=[{"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()}],
        bufferViews=[
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": len(data) - 48},
        ],
        accessors=[
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": len(corners), "type": "SCALAR"},
        ],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": mode}]}],
    )
    mesh = read_mesh(save(tmp_path, "a.gltf", content))
    assert len(mesh.faces) == 2
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    np.testing.assert_array_equal(normals, [[0, 0, 1], [0, 0, 1]], "both face the front, and make a square")


FAULTS = {
    "missing.obj": None,
    "a.fbx": "x",
    "empty.obj": "",
    "points.obj": "v 0 0 0\nv 1 0 0\n",
    "nan.obj": "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "infinite.obj": "v 1e999 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "range.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n",
    "zero.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n",
    "back.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -4\n",
    "huge.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999999\n",
    "words.obj": "v a b c\n",
    "short.obj": "v 1 2\nv 1 2 3\nf 1 2 2\n",
    "texture.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/2\n",
    "bare.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt\nvt 1 1\nf 1 2 3\n",
    "line.obj": "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
    "dot.obj": "v 0 0 0\nf 1 1 1\n",
    "wide.obj": "v 1e200 0 0\nv -1e200 0 0\nv 0 1 0\nf 1 2 3\n",
    "binary.obj": bytes(range(256)),
    "not.ply": "hello",
    "many.ply": "ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n",
    "cut.ply": "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\0\0",
    "empty.stl": "",
    "cut.stl": b"\0" * 80 + b"\xff\xff\xff\xff" + b"\0" * 50,
    "bad.off": "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n",
    "bad.glb": b"glTF\2\0\0\0",
    "page.gltf": "<html>",
    "list.gltf": "[]",
    "deep.gltf": "[" * 100_000,
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_said_in_one_line(tmp_path: Path, name: str) -> None:
    content = FAULTS[name]
    path = tmp_path / name if content is None else save(tmp_path, name, content)
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def gltf(**changes: object) -> str:
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3"}],
    }
    return json.dumps({**document, **changes})


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"accessors": [{"componentType": 5126, "count": 300_000_000, "type": "VEC3"}]}, "claims"),
        ({"nodes": [{"mesh": 0, "children": [1]}, {"children": [0]}]}, "cycle"),
        ({"nodes": [{"mesh": 0, "children": [0]}]}, "cycle"),
        ({"nodes": [{"mesh": 0, "children": [7]}]}, "tree"),
        ({"buffers": [{"uri": "../secret.bin", "byteLength": 4}]}, "outside"),
        ({"buffers": [{"uri": "/etc/passwd", "byteLength": 4}]}, "outside"),
        ({"buffers": [{"uri": "gone.bin", "byteLength": 4}]}, "missing"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "draco"),
        ({"accessors": "no"}, "not valid"),
        ({"accessors": [{"componentType": 5126, "count": 3, "type": "VEC3", "sparse": {"x": 1}}]}, "'count'"),
        ({"accessors": [{"componentType": 5122, "count": 3, "type": "VEC9"}]}, "VEC9"),
        ({"accessors": [{"componentType": 5126, "count": float("inf"), "type": "VEC3"}]}, "Infinity"),
        ({"buffers": None}, "no list"),
        ({"buffers": 5}, "no list"),
        ({"buffers": [{"uri": "%00", "byteLength": 4}]}, "missing"),
        ({"buffers": [{"uri": "a" * 300, "byteLength": 4}]}, "missing"),
        ({"nodes": [{}], "meshes": []}, "no faces"),
    ],
)  # fmt: skip
def test_hostile_gltf(tmp_path: Path, changes: dict[str, object], word: str) -> None:
    with pytest.raises(InputError, match=word):
        read_mesh(save(tmp_path, "a.gltf", gltf(**changes)))


def test_indices_out_of_range_in_gltf_are_refused(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    written = bytearray(trimesh.Scene(box).export(file_type="glb"))
    indices = box.faces.astype("<u4").tobytes()
    at = bytes(written).index(indices)
    written[at : at + 4] = (10**6).to_bytes(4, "little")
    with pytest.raises(InputError, match="indices"):
        read_mesh(save(tmp_path, "a.glb", bytes(written)))
