"""A scene's file: complete, the same bytes every time, refused when damaged."""

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

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


CLAIMS: dict[str, Callable[[dict[str, Any]], object]] = {
    "levels": lambda header: header["field"].update(levels=10**9),
    "table": lambda header: header["field"].update(table_log2=60),
    "more": lambda header: header["field"].update(table_log2=22),
    "cells": lambda header: header["field"].update(finest=-5),
    "radius": lambda header: header["field"].update(blob_radius=0),
    "text": lambda header: header["field"].update(coarsest="16"),
    "samples": lambda header: header.update(samples_per_ray=10**12),
    "number": lambda header: header.update(field=3),
    "unknown": lambda header: header["field"].update(depth=3),
}


@pytest.mark.parametrize("name", CLAIMS)
def test_a_header_that_its_arrays_do_not_keep(tmp_path: Path, name: str) -> None:
    """Of a stranger's run, as START: memory and kernels go by it."""
    path = tmp_path / "field.npz"
    save_scene(path, make_scene())
    values = arrays.unpack(path.read_bytes())
    header = json.loads(values["header"].tobytes())
    CLAIMS[name](header)
    values["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    path.write_bytes(arrays.pack(values))
    with pytest.raises(InputError, match=r"field\.npz is no scene") as error:
        load_scene(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("shape", [(4, 8, 8), (8, 8), (0, 0, 0)])
def test_a_grid_that_is_no_cube(tmp_path: Path, shape: tuple[int, ...]) -> None:
    scene = make_scene()
    scene.occupancy = Occupancy(np.zeros(shape, np.float32), np.zeros(shape, np.bool_))
    save_scene(tmp_path / "field.npz", scene)
    with pytest.raises(InputError, match="occupied cells of shape"):
        load_scene(tmp_path / "field.npz")


def test_arrays_that_claim_more_than_the_file_are_not_unpacked() -> None:
    alone = io.BytesIO()
    np.save(alone, np.zeros(3))
    with pytest.raises(ValueError, match=r"not a readable \.npz archive"):
        arrays.unpack(alone.getvalue())
    packed = io.BytesIO()
    np.savez_compressed(packed, a=np.zeros(10_000_000, np.uint8))
    with pytest.raises(ValueError, match="is packed"):
        arrays.unpack(packed.getvalue())
    plain = io.BytesIO()
    with zipfile.ZipFile(plain, "w") as archive:
        head = io.BytesIO()
        np.lib.format.write_array_header_1_0(
            head, {"descr": "<f4", "fortran_order": False, "shape": (10**12,)}
        )
        archive.writestr("a.npy", head.getvalue() + bytes(64))
    with pytest.raises(ValueError, match="claim 4000000000000 bytes"):
        arrays.unpack(plain.getvalue())
