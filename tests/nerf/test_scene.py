"""A scene's file: complete, the same bytes every time, refused when damaged."""

import io
from pathlib import Path

import numpy as np
import pytest

from pipeline import arrays
from pipeline.cameras import sphere
from pipeline.errors import InputError
from pipeline.nerf.field import FieldShape, LatentField
from pipeline.nerf.occupancy import Occupancy
from pipeline.nerf.rendering import render_views
from pipeline.nerf.scene import Scene, density, load_scene, save_scene
from pipeline.training.background import FlatBackground, LearnedBackground


def make_scene(learned: bool = False) -> Scene:
    rng = np.random.default_rng(0)
    field = LatentField(
        FieldShape(levels=3, finest=24, table_log2=10, blob_radius=0.3, density_bias=-1.5), rng
    )
    field.sharpening = 1.75
    grid = Occupancy(rng.random((8, 8, 8), np.float32), rng.random((8, 8, 8)) < 0.7)
    colours = rng.standard_normal((5, 4)).astype(np.float32)
    return Scene(field, grid, LearnedBackground(rng) if learned else FlatBackground(colours), 40)


@pytest.mark.parametrize("learned", [False, True])
def test_a_loaded_scene_renders_the_same_and_saves_the_same_bytes(tmp_path: Path, learned: bool) -> None:
    scene = make_scene(learned)
    save_scene(tmp_path / "a.npz", scene)
    loaded = load_scene(tmp_path / "a.npz")
    save_scene(tmp_path / "b.npz", loaded)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    cameras = sphere(2, 1.4, 0.9)
    for left, right in zip(render_views(scene, cameras, 12), render_views(loaded, cameras, 12), strict=True):
        np.testing.assert_array_equal(left, right)
    points = np.random.default_rng(1).uniform(-1, 1, (100, 3)).astype(np.float32)
    np.testing.assert_array_equal(density(scene, points), density(loaded, points))


def test_density_is_the_same_in_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = make_scene()
    points = np.random.default_rng(1).uniform(-1, 1, (1000, 3)).astype(np.float32)
    whole = density(scene, points)
    monkeypatch.setattr("pipeline.nerf.scene._POINTS_PER_CHUNK", 64)
    np.testing.assert_allclose(density(scene, points), whole, rtol=1e-5)
    assert density(scene, points[:0]).shape == (0,)


@pytest.mark.parametrize("damage", ["truncated", "emptied", "text", "part"])
def test_a_damaged_scene_is_refused(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "field.npz"
    save_scene(path, make_scene())
    whole = path.read_bytes()
    values = arrays.unpack(whole)
    del values["field.weight2"]
    path.write_bytes(
        {"truncated": whole[:-500], "emptied": b"", "text": b"<html>", "part": arrays.pack(values)}[damage]
    )
    with pytest.raises(InputError, match=r"field\.npz"):
        load_scene(path)


def test_packed_arrays_are_a_plain_npz() -> None:
    values = {"a": np.arange(5), "b": np.array("text"), "c": np.zeros((0, 3), np.float32)}
    data = arrays.pack(values)
    with np.load(io.BytesIO(data)) as archive:
        for name, value in values.items():
            np.testing.assert_array_equal(archive[name], value)
    assert data == arrays.pack(values)


def test_pickled_objects_are_neither_packed_nor_unpacked() -> None:
    with pytest.raises(ValueError, match="pickle"):
        arrays.pack({"a": np.array([{}], dtype=object)})
    stream = io.BytesIO()
    np.savez(stream, a=np.array([{}], dtype=object))
    with pytest.raises(ValueError, match="pickle"):
        arrays.unpack(stream.getvalue())
