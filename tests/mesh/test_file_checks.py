"""What files claim is held against them before they are read."""

from pathlib import Path

import pytest
import trimesh

from pipeline.errors import InputError
from pipeline.mesh import limits
from pipeline.mesh.file_checks import FORMATS, check_file
from pipeline.mesh.readers import read_mesh
from tests.rigged_model import rigged_glb


@pytest.mark.parametrize("suffix", FORMATS)
def test_too_many_faces_are_refused_before_they_are_read(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if suffix == ".gltf":
        for name, content in trimesh.creation.box().export(file_type="gltf").items():
            (tmp_path / name.replace("model", "a")).write_bytes(content)
    else:
        trimesh.creation.box().export(tmp_path / f"a{suffix}")
    monkeypatch.setattr(limits, "MOST_FACES", 12)
    check_file(tmp_path / f"a{suffix}")
    monkeypatch.setattr(limits, "MOST_FACES", 11)
    with pytest.raises(InputError, match="12 faces, expected at most 11"):
        check_file(tmp_path / f"a{suffix}")


def test_a_text_stl_says_no_count_and_an_off_may_have_comments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "MOST_FACES", 11)
    trimesh.creation.box().export(tmp_path / "a.stl", file_type="stl_ascii")
    check_file(tmp_path / "a.stl")
    made = trimesh.creation.box().export(file_type="off").split("\n", 1)
    (tmp_path / "a.off").write_text(f"{made[0]}\n# of a box\n\n{'# ' * 20_000}\n{made[1]}")
    with pytest.raises(InputError, match="12 faces"):
        check_file(tmp_path / "a.off")


def test_a_gltf_counts_what_its_scene_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.glb").write_bytes(rigged_glb())
    shown = len(read_mesh(tmp_path / "a.glb").faces)
    monkeypatch.setattr(limits, "MOST_FACES", shown)
    check_file(tmp_path / "a.glb")
    monkeypatch.setattr(limits, "MOST_FACES", shown - 1)
    with pytest.raises(InputError, match=f"{shown} faces"):
        check_file(tmp_path / "a.glb")
