"""Pictures of strangers' meshes: only those of known formats and sizes are decoded, wherever they lie."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import InputError
from pipeline.mesh.coloured import read_coloured
from pipeline.mesh.pictures import FORMATS, check_pictures
from tests.faults import hostile

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 10 10\n%%EndComments\n(executed) (w) file closefile\n"
BAD = {
    "a program": (EPS, "PS-Ado.*expected PNG"),
    "too large": (hostile.png(20_000, 20_000), "20000|pixels"),
    "cut": (hostile.png(64, 64)[:40], "not a readable picture"),
    "nothing": (b"", "begins with b''"),
    "large": (hostile.png(9000, 9000), "9000 x 9000 texels"),
}


def in_obj(folder: Path, picture: bytes) -> Path:
    (folder / "a.obj").write_text("mtllib a.mtl\n" + TRIANGLE)
    (folder / "a.mtl").write_text("newmtl m\nmap_Kd skin.png\n")
    (folder / "skin.png").write_bytes(picture)
    return folder / "a.obj"


def in_ply(folder: Path, picture: bytes) -> Path:
    names = "".join(f"property float {name}\n" for name in "xyzst")
    head = f"ply\nformat ascii 1.0\ncomment TextureFile skin.png\nelement vertex 3\n{names}"
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (folder / "a.ply").write_text(head + "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n")
    (folder / "skin.png").write_bytes(picture)
    return folder / "a.ply"


def in_gltf(folder: Path, picture: bytes) -> Path:
    (folder / "a.gltf").write_bytes(hostile.textured_gltf(picture))
    return folder / "a.gltf"


def picture_of(kind: str) -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", (4, 4), "red").save(stream, kind)
    return stream.getvalue()


@pytest.mark.parametrize("kind", FORMATS)
def test_every_known_format_is_a_texture(tmp_path: Path, kind: str) -> None:
    for place in (in_obj, in_ply, in_gltf):
        mesh = read_coloured(place(tmp_path, picture_of(kind)))
        (paint,) = mesh.paints
        assert paint.texture is not None
        np.testing.assert_allclose(paint.texture[1, 1], [1, 0, 0], atol=0.02)


@pytest.mark.parametrize("place", [in_obj, in_ply, in_gltf])
@pytest.mark.parametrize("name", BAD)
def test_others_are_refused_before_anything_decodes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: object, name: str
) -> None:
    def decode(*_: object, **__: object) -> None:
        raise AssertionError("decoded")

    monkeypatch.setattr(Image.Image, "convert", decode)
    picture, words = BAD[name]
    assert callable(place)
    with pytest.raises(InputError, match=words) as error:
        read_coloured(place(tmp_path, picture))
    assert "\n" not in str(error.value)
    assert "BytesIO" not in str(error.value)


def test_a_picture_that_is_not_there(tmp_path: Path) -> None:
    path = in_gltf(tmp_path, picture_of("PNG"))
    document = json.loads(path.read_text())
    for image in ({"bufferView": 9}, {}, 3, {"uri": 3}, {"uri": "data:;base64,*"}, {"bufferView": 0}):
        path.write_text(json.dumps({**document, "images": [image]}))
        with pytest.raises(InputError, match=r"a\.gltf"):
            check_pictures(path)
