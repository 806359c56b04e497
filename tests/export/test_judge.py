"""The judge: its pictures, its file, and that it learns to tell an object from what is left of one."""

import json

import numpy as np
import torch

from export.everyday_objects import procedural
from export.everyday_objects.captions import COLOURS
from export.everyday_objects.failures import lump, melt, scatter
from export.everyday_objects.judge import FAILED, KINDS, Judge, judge_images, load_judge, save_judge, shrink
from export.everyday_objects.train_judge import (
    FAILURES,
    colour_label,
    held_out_figures,
    read_failed,
    sharpen,
    shift_hues,
    train,
)


def pictures(count, seed):
    """Two kinds that differ in outline, in two colours, and their rows."""
    rng = np.random.default_rng(seed)
    images = np.full((count, 128, 128, 3), 200, np.uint8)
    rows = []
    for image in images:
        kind, colour = ("table", "ball")[rng.integers(2)], ("red", "blue")[rng.integers(2)]
        x, y = rng.integers(30, 50, 2)
        paint = (200, 30, 20) if colour == "red" else (20, 40, 200)
        if kind == "table":
            image[y : y + 12, x : x + 60] = paint
            image[y : y + 50, x : x + 8] = image[y : y + 50, x + 52 : x + 60] = paint
        else:
            r, c = np.mgrid[:128, :128]
            image[(r - y - 25) ** 2 + (c - x - 25) ** 2 < 900] = paint
        rows.append({"noun": kind, "look": colour})
    return images, rows


def work_folder(tmp_path):
    for folder, seed, name in (("judge", 1, "900"), ("held_out", 2, "000")):
        images, rows = pictures(300, seed)
        (tmp_path / folder).mkdir()
        np.save(tmp_path / folder / f"{name}.npy", images)
        (tmp_path / folder / f"{name}.json").write_text(json.dumps(rows))
    return tmp_path


def test_it_learns_kinds_colours_and_failures(tmp_path, monkeypatch):
    monkeypatch.setattr("export.everyday_objects.train_judge.LUMPS", 20)
    work = work_folder(tmp_path)
    figures = held_out_figures(train(work, [], 40, Judge(), batch=16), work)
    assert figures["kind_top1"] >= 0.8
    assert figures["colour_top1"] >= 0.9
    assert figures["kind_top5"] >= figures["kind_top1"]


def test_its_file_gives_the_same_judge_back(tmp_path):
    torch.manual_seed(0)
    judge = Judge().eval()
    save_judge(tmp_path / "judge.npz", judge, {"kind_top1": 0.5})
    again, figures = load_judge(tmp_path / "judge.npz")
    images = np.random.default_rng(0).uniform(0, 1, (3, 128, 128, 3)).astype(np.float32)
    assert figures == {"kind_top1": 0.5}
    for first, second in zip(judge_images(judge, images), judge_images(again, images), strict=True):
        assert np.abs(first - second).max() < 2e-3  # fp16 weights
        assert np.allclose(first.sum(1), 1, atol=1e-5)


def test_shrink_takes_bytes_and_floats_alike():
    images = np.random.default_rng(0).integers(0, 256, (2, 128, 128, 3)).astype(np.uint8)
    assert torch.allclose(shrink(images), shrink(images.astype(np.float32) / 255), atol=1e-6)
    flat = shrink(np.full((1, 96, 96, 3), 51, np.uint8))
    assert flat.shape == (1, 3, 64, 64)
    assert torch.allclose(flat, torch.tensor(0.2), atol=1e-6)


def test_failures_keep_the_size_and_lose_the_picture():
    image = pictures(1, 0)[0][0]
    for spoil in (melt, scatter):
        spoilt = spoil(np.random.default_rng(4), image)
        assert spoilt.shape == image.shape
        assert spoilt.dtype == np.uint8
        assert (spoilt != image).any(-1).mean() > 0.05
        assert np.array_equal(spoilt, spoil(np.random.default_rng(4), image))
    model = lump(np.random.default_rng(3))
    assert np.isfinite(model.vertices).all()
    assert model.faces.max() < len(model.vertices)


def test_only_single_colours_are_judged():
    assert colour_label("red") == COLOURS.index("red")
    assert [colour_label(look) for look in ("", "wooden", "red and blue")] == [-1, -1, -1]
    assert len(KINDS) == FAILED
    assert set(procedural.MAKERS) <= set(KINDS)


def test_failed_results_are_read_as_pictures(tmp_path):
    from PIL import Image

    Image.new("RGB", (300, 300), (10, 20, 30)).save(tmp_path / "a.png")
    (found,) = read_failed(tmp_path)
    assert found.shape == (128, 128, 3)
    assert (found == (10, 20, 30)).all()
    assert len(read_failed(FAILURES)) > 20


def test_turned_hues_keep_grey_and_brightness():
    images = torch.rand(8, 3, 5, 5, dtype=torch.float64).float() * 0.2 + 0.4  # far from being clamped
    turned = shift_hues(np.random.default_rng(0), images)
    torch.testing.assert_close(turned.mean(1), images.mean(1))
    assert (turned - images).abs().amax((1, 2, 3)).min() > 0.01
    grey = images.mean(1, keepdim=True).expand(-1, 3, -1, -1)
    torch.testing.assert_close(shift_hues(np.random.default_rng(0), grey), grey)


def test_sharpening_leaves_flat_pictures_and_steepens_edges():
    flat = torch.full((2, 3, 16, 16), 0.3)
    torch.testing.assert_close(sharpen(np.random.default_rng(0), flat), flat)
    edge = flat.clone()
    edge[..., 8:] = 0.6
    step = sharpen(np.random.default_rng(0), edge).diff(dim=-1)[..., 7]
    assert (step > 0.3).all()
