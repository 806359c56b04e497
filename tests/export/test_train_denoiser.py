"""The denoiser's training: batches, Muon, and that a stopped training goes on to the same weights."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from export.everyday_objects.data.kind import DESIGNS
from export.everyday_objects.train import train_denoiser
from export.everyday_objects.train.batches import (
    TIMESTEPS,
    VIEWS,
    camera_rows,
    draw_batch,
    draw_timesteps,
    load_objects,
    locate,
    shard_numbers,
)
from export.everyday_objects.train.muon import Muon, orthogonal
from export.everyday_objects.train.train_denoiser import train

SMALL = {"channels": (16, 24, 32), "heads": (0, 2, 2), "embedding": 32}


def write_pictures(folder: Path, number: int) -> None:
    """A shard of 3 objects in flat latents."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(number)
    flat = rng.normal(size=(3, 8, 4)).astype(np.float32)
    np.save(
        folder / f"{number:05d}.npy", np.repeat(flat[..., None, None], 32, 3).repeat(32, 4).astype(np.float16)
    )
    cameras = np.stack([np.arange(8) * np.pi / 4, np.full(8, 1.2), np.full(8, 2.5), np.full(8, 0.69)], 1)
    rows = [["chair", 0, "red", "", {}, ""], ["car", 1, "", "", {}, "steel"], ["horse", 2, "", "", {}, ""]]
    said = {"cameras": np.tile(cameras.astype(np.float32), (3, 1, 1)), "backdrops": flat}
    np.savez(folder / f"{number:05d}.npz", **said, rows=np.array(json.dumps(rows)))


def test_timesteps_favour_what_distillation_visits():
    drawn = np.concatenate([draw_timesteps(np.random.default_rng(i), 64) for i in range(200)])
    assert drawn.min() >= 0
    assert drawn.max() < TIMESTEPS
    assert (drawn < 0.2 * TIMESTEPS).mean() == pytest.approx(0.1, abs=0.01)
    assert (drawn >= 0.7 * TIMESTEPS).mean() == pytest.approx(0.5, abs=0.01)


def test_a_batch_shows_four_sides_of_each_object_at_one_noise_level(tmp_path):
    write_pictures(tmp_path, 0)
    objects = load_objects(tmp_path, shard_numbers(tmp_path))
    told = texts = 0
    for step in range(40):
        batch = draw_batch(objects, step, 8)
        levels = batch.timesteps.reshape(-1, VIEWS)
        assert (levels == levels[:, :1]).all()
        azimuths = batch.cameras[:, 1].reshape(-1, VIEWS)
        known = batch.cameras[:, 0].reshape(-1, VIEWS)[:, 0] > 0
        np.testing.assert_allclose(np.diff(azimuths[known], axis=1), np.pi / 2, atol=1e-5)
        assert not batch.cameras[batch.cameras[:, 0] == 0, 1:5].any()
        np.testing.assert_allclose(batch.clean[batch.cameras[:, 5] == 1][:, :, 0, 0],
                                   batch.cameras[batch.cameras[:, 5] == 1, 6:], atol=2e-3)  # fmt: skip
        told += known.sum()
        texts += sum(bool(t) for t in batch.texts[::VIEWS])
    assert 0.8 < told / 320 < 0.97
    assert 0.8 < texts / 320 < 0.97
    again = draw_batch(objects, 39, 8)
    np.testing.assert_array_equal(again.noise, batch.noise)
    assert again.texts == batch.texts


def test_designs_that_are_not_trained_on_are_left_out_and_others_keep_their_pictures(tmp_path):
    write_pictures(tmp_path, 0)
    with np.load(tmp_path / "00000.npz") as said:
        rows, cameras, backdrops = json.loads(str(said["rows"])), said["cameras"], said["backdrops"]
    whole = load_objects(tmp_path, ["00000"])
    rows[0][1] = DESIGNS
    np.savez(tmp_path / "00000.npz", cameras=cameras, backdrops=backdrops, rows=np.array(json.dumps(rows)))
    left = load_objects(tmp_path, ["00000"])
    assert left.rows[0] == rows[1:]
    for name in ("latents", "cameras", "backdrops"):
        np.testing.assert_array_equal(getattr(left, name)[0], getattr(whole, name)[0][1:])


def test_objects_are_found_by_number_in_shards_of_any_size():
    places = [locate(np.cumsum([2, 0, 3]), number) for number in range(5)]
    assert places == [(0, 0), (0, 1), (2, 0), (2, 1), (2, 2)]


def test_camera_rows_tell_what_they_are_to():
    rows = camera_rows(
        np.full((2, 4), 2.0), np.full((2, 4), 3.0), np.array([True, False]), np.array([False, True])
    )
    np.testing.assert_array_equal(rows, [[1, 2, 2, 2, 2, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1, 3, 3, 3, 3]])


def test_orthogonal_steps_have_singular_values_near_one():
    torch.manual_seed(0)
    for shape in ((16, 48), (48, 16), (20, 20)):
        values = torch.linalg.svdvals(orthogonal(torch.randn(shape), torch.float32))
        assert values.min() > 0.3
        assert values.max() < 1.3


def test_muon_finds_a_matrix():
    torch.manual_seed(0)
    wanted, found = torch.randn(6, 10), torch.nn.Parameter(torch.zeros(6, 10))
    optimiser = Muon([found], 0.1, 0.0, torch.float32)
    for step in range(150):
        optimiser.param_groups[0]["lr"] = 0.1 * (1 - step / 150)
        optimiser.zero_grad()
        (found - wanted).square().sum().backward()
        optimiser.step()
    assert (found - wanted).abs().max() < 0.1


def test_a_stopped_training_goes_on_to_the_same_weights(tmp_path, monkeypatch):
    monkeypatch.setattr(train_denoiser, "SAVE_EVERY", 2)
    monkeypatch.setattr(train_denoiser, "LOOK_FOR_SHARDS_EVERY", 3)
    monkeypatch.setattr(train_denoiser, "VOCABULARY", 600)
    monkeypatch.setattr(train_denoiser, "example_texts", lambda count: ["a red chair", "a steel car"])
    for place in ("whole", "parts"):
        write_pictures(tmp_path / place / "pictures", 0)
        write_pictures(tmp_path / place / "held_out_pictures", 90000)
    train(tmp_path / "whole", 4, objects_a_step=2, figures_every=4, **SMALL)
    train(tmp_path / "parts", 2, objects_a_step=2, **SMALL)
    train(tmp_path / "parts", 4, objects_a_step=2, **SMALL)
    whole, parts = (torch.load(tmp_path / p / "denoiser.pt", weights_only=True) for p in ("whole", "parts"))
    assert whole.keys() == parts.keys()
    for name, value in whole.items():
        assert torch.equal(value, parts[name]), name
    log = (tmp_path / "whole" / "denoiser.log").read_text()
    for arm in ("right", "wrong camera", "no camera", "no backdrop", "wrong text", "no text", "views apart"):
        assert f"step 4 {arm}: " in log
    # Rates of nothing move nothing, whatever the fall.
    train(tmp_path / "parts", 5, fall=2, rates=0.0, objects_a_step=2, **SMALL)
    still = torch.load(tmp_path / "parts" / "denoiser.state.pt", weights_only=True)["model"]
    before = torch.load(tmp_path / "whole" / "denoiser.state.pt", weights_only=True)["model"]
    assert all(torch.equal(value, still[name]) for name, value in before.items())
    # `restore` knows of no shards, and its step is any.
    state = tmp_path / "parts" / "denoiser.state.pt"
    torch.save(torch.load(state, weights_only=True) | {"shards": 0}, state)
    train(tmp_path / "parts", 6, objects_a_step=2, **SMALL)
    assert torch.load(state, weights_only=True)["shards"] == 1
