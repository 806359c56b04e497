"""The judge: its pictures, labels and file, and that it learns to tell an object from what is left of one."""

import numpy as np
import pytest
import torch
from PIL import Image

from export.everyday_objects.data import kinds
from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.looks import Look
from export.everyday_objects.data.materials import MATERIALS
from export.everyday_objects.data.shapes import RADIUS
from export.everyday_objects.networks.autoencoder import Decoder, Encoder
from export.everyday_objects.networks.judge import (
    FAILED,
    KINDS,
    MADE_OF,
    SIDES,
    Judge,
    judge_images,
    judge_sides,
    load_judge,
    save_judge,
    shrink,
    side_of,
)
from export.everyday_objects.train import judge_pictures, train_judge
from export.everyday_objects.train.augment import sharpen, shift_hues
from export.everyday_objects.train.failures import lump, melt, scatter
from export.everyday_objects.train.judge_pictures import (
    Labels,
    Pool,
    colour_label,
    distilled,
    draw_pool,
    labels_of,
    material_label,
)
from export.everyday_objects.train.train_judge import (
    FAILURES,
    JUDGE,
    head_loss,
    held_out_figures,
    read_failed,
    spoil,
    train,
)
from pipeline.errors import InputError


def pictures(count: int, seed: int) -> Pool:
    """Two kinds that differ in outline, in two colours, plain or striped, some with a face."""
    rng = np.random.default_rng(seed)
    images, rows = np.full((count, 128, 128, 3), 200, np.uint8), []
    for image in images:
        kind, colour = ("cat", "ball")[rng.integers(2)], ("red", "blue")[rng.integers(2)]
        x, y = rng.integers(30, 50, 2)
        striped, facing = rng.random() < 0.4, rng.random() < 0.5
        paint = np.tile(
            np.array((200, 30, 20) if colour == "red" else (20, 40, 200), np.uint8), (128, 128, 1)
        )
        if striped:
            paint[np.arange(128) % 20 < 10] = 250
        r, c = np.mgrid[:128, :128]
        if kind == "cat":
            shape = (
                (r >= y) & (r < y + 50) & (c >= x) & (c < x + 60) & ((r < y + 12) | (np.abs(c - x - 30) > 22))
            )
        else:
            shape = (r - y - 25) ** 2 + (c - x - 25) ** 2 < 900
        image[shape] = paint[shape]
        if kind == "cat" and facing:
            image[y + 15 : y + 40, x + 18 : x + 42] = 0
        azimuth = 0.2 if facing else np.pi
        rows.append([kind, 0, colour, "", {}, "striped" if striped else "", azimuth, False])
    return Pool(images, rows)


def test_it_learns_kinds_colours_materials_and_sides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(train_judge, "LUMPS", 20)
    figures = held_out_figures(train(pictures(300, 1), [], 60, Judge(), batch=16), pictures(120, 2))
    assert figures["kind_top1"] >= 0.8
    assert figures["kind_top5"] >= figures["kind_top1"]
    assert figures["colour_top1"] >= 0.9
    assert min(figures["material_top1"], figures["plain_top1"]) >= 0.7
    assert figures["side_top1"] >= 0.8
    assert figures["back_as_front"] <= 0.3
    assert "kind_top1_decoded" not in figures


def test_its_file_gives_the_same_judge_back(tmp_path) -> None:
    torch.manual_seed(0)
    judge = Judge().eval()
    save_judge(tmp_path / "judge.npz", judge, {"kind_top1": 0.5})
    again, figures = load_judge(tmp_path / "judge.npz")
    images = np.random.default_rng(0).uniform(0, 1, (3, 128, 128, 3)).astype(np.float32)
    assert figures == {"kind_top1": 0.5}
    found = (*judge_images(judge, images), judge_sides(judge, images))
    assert [p.shape[1] for p in found] == [len(KINDS) + 1, len(COLOURS), len(MATERIALS) + 1, 3]
    for first, second in zip(found, (*judge_images(again, images), judge_sides(again, images)), strict=True):
        assert np.abs(first - second).max() < 2e-3  # fp16 weights
        assert np.allclose(first.sum(1), 1, atol=1e-5)


def test_shrink_takes_bytes_and_floats_alike() -> None:
    images = np.random.default_rng(0).integers(0, 256, (2, 128, 128, 3)).astype(np.uint8)
    assert torch.allclose(shrink(images), shrink(images.astype(np.float32) / 255), atol=1e-6)
    flat = shrink(np.full((1, 96, 96, 3), 51, np.uint8))
    assert flat.shape == (1, 3, 64, 64)
    assert torch.allclose(flat, torch.tensor(0.2), atol=1e-6)


def test_only_single_colours_of_the_objects_own_are_judged() -> None:
    assert colour_label(Look("red")) == COLOURS.index("red")
    assert colour_label(Look("red", parts={"roof": "blue"})) == COLOURS.index("red")
    assert colour_label(Look("red", material=MATERIALS["striped"])) == COLOURS.index("red")
    others = (Look(), Look("red", "blue"), Look(material=MATERIALS["golden"]), Look(parts={"roof": "blue"}))
    assert [colour_label(look) for look in others] == [-1] * 4
    assert material_label(Look("red")) == MADE_OF.index("plain")
    assert material_label(Look(material=MATERIALS["brick"])) == MADE_OF.index("brick")
    assert tuple(k.words[0] for k in kinds.KINDS) == KINDS
    assert len(KINDS) == FAILED


@pytest.mark.parametrize(
    ("degrees", "side"),
    [(0, "front"), (44, "front"), (316, "front"), (46, "side"), (270, "side"), (136, "back"), (225, "back")],
)
def test_sides_change_at_45_degrees(degrees: float, side: str) -> None:
    assert side_of(np.radians(degrees)) == side


def test_what_has_no_front_has_no_side() -> None:
    look = ["", "", {}, ""]
    rows = [["horse", 0, *look, 3.1, False], ["ball", 0, *look, 3.1, False], ["horse", 1, *look, 1.5, True]]
    labels = labels_of(rows)
    assert labels.side.tolist() == [SIDES.index("back"), -1, SIDES.index("side")]
    assert labels.kind.tolist() == [KINDS.index("horse"), KINDS.index("ball"), KINDS.index("horse")]


def test_unlabelled_rows_cost_nothing() -> None:
    logits = torch.tensor([[2.0, 0.0], [0.0, 5.0]], requires_grad=True)
    assert head_loss(logits, np.array([-1, -1])).item() == 0
    loss = head_loss(logits, np.array([0, -1]))
    torch.testing.assert_close(loss, torch.log1p(torch.exp(torch.tensor(-2.0))))
    loss.backward()
    assert logits.grad is not None
    assert not logits.grad[1].any()


def save_autoencoder(folder) -> tuple[Encoder, Decoder]:
    torch.manual_seed(0)
    encoder, decoder = Encoder().eval(), Decoder().eval()
    torch.save({"encoder": encoder.state_dict(), "decoder": decoder.state_dict()}, folder / "autoencoder.pt")
    return encoder, decoder


def test_the_pool_is_drawn_once_and_shows_what_its_rows_say(tmp_path, monkeypatch) -> None:
    save_autoencoder(tmp_path)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    monkeypatch.setattr(judge_pictures, "_BLOCK", 3)
    pool = draw_pool(tmp_path, "held_out", 10)
    assert pool.images.shape == (10, 128, 128, 3)
    assert len(pool.rows) == 10
    for first, second in zip(pool.rows[::2], pool.rows[1::2], strict=True):
        assert first[:6] == second[:6]
        assert first[6] != second[6]
        kind = kinds.BY_WORD[first[0]]
        assert kind.variants <= first[1]
    assert 0 < sum(row[7] for row in pool.rows) < 10
    clean = [image for image, row in zip(pool.images, pool.rows, strict=True) if not row[7]]
    assert all((image[0] == image[0, 0]).all() for image in clean)  # the flat backdrop
    written = (tmp_path / "judge" / "held_out.npy").stat().st_mtime_ns
    again = draw_pool(tmp_path, "held_out", 10)
    assert again.rows == pool.rows
    assert (tmp_path / "judge" / "held_out.npy").stat().st_mtime_ns == written


def test_distilled_pictures_keep_their_place_and_half_their_backdrop(tmp_path) -> None:
    autoencoder = save_autoencoder(tmp_path)
    images = np.full((40, 64, 64, 3), 90, np.uint8)
    images[:, 20:44, 20:44] = (200, 40, 30)
    found = distilled(np.random.default_rng(0), autoencoder, images, np.full((40, 3), 90, np.uint8))
    assert found.shape == images.shape
    assert found.dtype == np.uint8
    assert ((found != images).any((1, 2, 3))).all()
    kept = (found[:, :16] == 90).all((1, 2, 3))
    assert 8 <= kept.sum() <= 32
    assert np.abs(found[1].astype(int) - found[0]).max() > 0  # noise of its own


def test_failures_keep_the_size_and_lose_the_picture() -> None:
    image = pictures(1, 0).images[0]
    for break_up in (melt, scatter):
        spoilt = break_up(np.random.default_rng(4), image)
        assert spoilt.shape == image.shape
        assert spoilt.dtype == np.uint8
        assert (spoilt != image).any(-1).mean() > 0.05
        assert np.array_equal(spoilt, break_up(np.random.default_rng(4), image))


def test_lumps_are_shapes_that_can_be_drawn() -> None:
    materials = set()
    for seed in range(12):
        shape, looks = lump(np.random.default_rng(seed))
        assert np.linalg.norm(shape.vertices, axis=1).max() == pytest.approx(RADIUS, rel=1e-4)
        assert shape.faces.max() < len(shape.vertices)
        assert len(looks.colours) == len(looks.others) == len(looks.codes) == len(shape.paints)
        materials.add(int(looks.codes[0]))
        picture = train_judge.draw_lump(np.random.default_rng(seed))
        assert picture.shape == (128, 128, 3)
        assert 0.05 < (picture != picture[0, 0]).any(-1).mean() < 0.7
    assert 0 in materials
    assert len(materials) > 1


def test_spoiled_pictures_are_failures_and_nothing_else() -> None:
    pool = pictures(50, 3)
    images, labels = pool.images.copy(), Labels(*(v.copy() for v in labels_of(pool.rows)))
    lumps, failed = [np.full((128, 128, 3), 7, np.uint8)], [np.full((128, 128, 3), 9, np.uint8)]
    spoil(np.random.default_rng(0), images, labels, lumps, failed)
    assert (labels.kind[:6] == FAILED).all()
    assert (labels.material[:6] == -1).all()
    assert (labels.side[:6] == -1).all()
    assert (images[6:] == pool.images[6:]).all()
    for before, after in zip(labels_of(pool.rows), labels, strict=True):
        assert (before[6:] == after[6:]).all()


def test_failed_results_are_read_as_pictures(tmp_path) -> None:
    Image.new("RGB", (300, 300), (10, 20, 30)).save(tmp_path / "a.png")
    (found,) = read_failed(tmp_path)
    assert found.shape == (128, 128, 3)
    assert (found == (10, 20, 30)).all()
    assert len(read_failed(FAILURES)) > 20
    assert JUDGE.is_file()


def test_turned_hues_keep_grey_and_brightness() -> None:
    images = torch.rand(8, 3, 5, 5, dtype=torch.float64).float() * 0.2 + 0.4  # far from being clamped
    turned = shift_hues(np.random.default_rng(0), images)
    torch.testing.assert_close(turned.mean(1), images.mean(1))
    assert (turned - images).abs().amax((1, 2, 3)).min() > 0.01
    grey = images.mean(1, keepdim=True).expand(-1, 3, -1, -1)
    torch.testing.assert_close(shift_hues(np.random.default_rng(0), grey), grey)


def test_sharpening_leaves_flat_pictures_and_steepens_edges() -> None:
    flat = torch.full((2, 3, 16, 16), 0.3)
    torch.testing.assert_close(sharpen(np.random.default_rng(0), flat), flat)
    edge = flat.clone()
    edge[..., 8:] = 0.6
    step = sharpen(np.random.default_rng(0), edge).diff(dim=-1)[..., 7]
    assert (step > 0.3).all()


def test_a_judge_of_other_kinds_is_named(tmp_path):
    judge = Judge().eval()
    judge.kind = torch.nn.Linear(judge.kind.in_features, 3)
    save_judge(tmp_path / "judge.npz", judge, {})
    with pytest.raises(InputError, match=r"judge\.npz is a judge of other kinds.*train"):
        load_judge(tmp_path / "judge.npz")


@pytest.mark.skipif(
    "material.weight" not in np.load(JUDGE).files, reason="the judge has not been trained anew"
)
def test_the_judge_that_ships_is_right_more_often_than_not() -> None:
    judge, figures = load_judge(JUDGE)
    assert figures["kind_top1"] >= 0.7
    assert figures["colour_top1"] >= 0.85
    assert figures["material_top1"] >= 0.7
    assert figures["side_top1"] >= 0.7
    failed = judge_images(judge, np.stack(read_failed(FAILURES)))[0].argmax(1) == FAILED
    assert failed.mean() >= 0.8
