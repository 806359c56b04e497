"""The stage on a tiny bundle: real files in, real files out, through the real denoiser graph."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline import arrays
from pipeline.cameras import sphere
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.view_gradient import load_embeddings
from pipeline.errors import InputError
from pipeline.nerf import step
from pipeline.nerf import train as nerf_train
from pipeline.nerf.rendering import Views, render_views
from pipeline.nerf.scene import density, load_scene
from pipeline.options.job import Job
from pipeline.options.nerf import TrainNerf
from pipeline.report.latents import latent_preview
from pipeline.run.stage import Context
from pipeline.sketch.lattice import Sketch, look_up, save_sketch, volume_iou
from pipeline.sketch.winding import tabulate
from pipeline.stages import train_nerf
from pipeline.training import loop
from pipeline.training.loop import PREVIEW
from tests.nerf.test_step import SMALL
from tests.tiny_bundle import DISC, write_tiny_bundle

STEPS = 30
COND = np.random.default_rng(1).standard_normal((8, 16)).astype(np.float32)
OPTIONS = {
    **SMALL,
    "steps": STEPS,
    "updates_per_call": 1,
    "guidance_scale": 3.0,
    "checkpoint_every": 10,
    "preview_every": 10,
    "learning_rate": 5e-3,
    "grid_learning_rate": 4e-2,
}


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_bundle(tmp_path_factory.mktemp("models") / "tiny", latent_size=12)


@pytest.fixture(scope="module")
def bar() -> Sketch:
    """A bar along x: quite another shape than the disc that the tiny bundle's denoiser knows."""
    box = trimesh.creation.box([1.4, 0.4, 0.4])
    return tabulate(box.vertices, box.faces, 32, "bar")


def write_embeddings(path: Path, backgrounds: bool = True) -> Path:
    rng = np.random.default_rng(0)
    values = {
        "cond": np.repeat(COND[None], 16, axis=0),
        "uncond": np.zeros((8, 16), np.float32),
        "view_prompts": np.array("eight"),
    }
    if backgrounds:
        values["backgrounds"] = rng.standard_normal((10, 4)).astype(np.float32)
        values["background_rgb"] = np.linspace(0, 1, 10, dtype=np.float32)[:, None].repeat(3, 1)
    path.write_bytes(arrays.pack(values))
    return path


def make_context(run: Path, bundle: Path, backgrounds: bool = True, **options: object) -> Context:
    run.mkdir(exist_ok=True)
    inputs = {
        "embeddings": write_embeddings(run / "embeddings.npz", backgrounds),
        "unet": bundle / "unet",
        "scheduler": bundle / "scheduler",
    }
    outputs = {"scene": run / "field.npz", "history": run / "training.json"}
    scratch = run / "checkpoints"
    scratch.mkdir(exist_ok=True)
    job = Job(prompt="a red ball", seed=3, train_nerf=TrainNerf(**{**OPTIONS, **options}))
    return Context(job, inputs, outputs, scratch)


@pytest.fixture(scope="module")
def finished(bundle: Path, tmp_path_factory: pytest.TempPathFactory) -> Context:
    context = make_context(tmp_path_factory.mktemp("runs") / "whole", bundle)
    train_nerf.main(context)
    return context


def test_writes_a_scene_its_history_and_figures(finished: Context) -> None:
    scene = load_scene(finished.outputs["scene"])
    views = render_views(scene, sphere(3, 1.25, 1.0), 12)
    assert 0.05 < views.opacity.mean() < 0.95
    history = json.loads(finished.outputs["history"].read_text())
    assert [row["step"] for row in history] == list(range(1, STEPS + 1))
    assert all(row["gradient_norm"] > 0 and 0 < row["opacity"] < 1 for row in history)
    for part in ("render", "denoiser", "backward", "rest"):
        assert finished.metrics["seconds"][part] > 0
    assert finished.metrics["resolution"] == 12
    assert finished.metrics["warnings"] == []
    with Image.open(finished.scratch / PREVIEW, formats=["PNG"]) as image:
        assert image.size == (4 * 12 * 4, 2 * 12 * 4)
        assert np.asarray(image).std() > 5


def test_the_middle_takes_the_denoisers_colour(finished: Context) -> None:
    """The tiny bundle's denoiser knows one thing, a disc whose colour is an affine function of the text."""
    projection = 0.3 * np.random.default_rng(0).normal(size=(16, 4))
    colour = DISC + OPTIONS["guidance_scale"] * COND.mean(axis=0) @ projection
    trained = load_scene(finished.outputs["scene"])
    embeddings = load_embeddings(finished.inputs["embeddings"])
    assert embeddings.backgrounds is not None
    untrained = step.initial_state(finished.job.train_nerf, embeddings.backgrounds, 3).scene
    errors = []
    for scene in (trained, untrained):
        views = render_views(scene, sphere(6, 1.25, 1.0), 12, np.zeros(4, np.float32))
        errors.append(np.abs(views.latents[:, :, 5:7, 5:7].mean(axis=(0, 2, 3)) - colour).mean())
    assert errors[0] < 0.5 * errors[1]


def test_killed_and_resumed_gives_the_same_bytes(
    finished: Context, bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = make_context(tmp_path / "killed", bundle)
    real = step.training_step

    def killed(state, *arguments, **named):
        if state.step == 23:
            raise KeyboardInterrupt
        return real(state, *arguments, **named)

    monkeypatch.setattr(nerf_train, "training_step", killed)
    with pytest.raises(KeyboardInterrupt):
        train_nerf.main(context)
    monkeypatch.undo()
    newest = max(context.scratch.glob("*.checkpoint"))
    newest.write_bytes(newest.read_bytes()[:1000])
    again = make_context(tmp_path / "killed", bundle)
    train_nerf.main(again)
    assert again.metrics["resumed_at"] == 10
    assert any(newest.name in warning for warning in again.metrics["warnings"])
    assert again.outputs["scene"].read_bytes() == finished.outputs["scene"].read_bytes()


def test_previews_change_nothing_however_many_there_are(
    finished: Context, bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """When they come depends on the clock; the asset must not."""
    monkeypatch.setattr(loop, "SHOW_SECONDS", -1.0)
    context = make_context(tmp_path / "watched", bundle, preview_every=0)
    train_nerf.main(context)
    assert context.outputs["scene"].read_bytes() == finished.outputs["scene"].read_bytes()


def test_a_bundle_without_encoder_trains_on_made_up_backgrounds(bundle: Path, tmp_path: Path) -> None:
    context = make_context(tmp_path / "run", bundle, backgrounds=False, steps=2, guidance_scale=1.0)
    train_nerf.main(context)
    assert len(load_scene(context.outputs["scene"]).background.colours) == 64


def test_the_default_background_is_a_light_grey(tmp_path: Path) -> None:
    embeddings = load_embeddings(write_embeddings(tmp_path / "e.npz"))
    values = arrays.unpack((tmp_path / "e.npz").read_bytes())
    assert embeddings.backgrounds is not None
    np.testing.assert_array_equal(embeddings.backgrounds[0], values["backgrounds"][6])
    assert sorted(map(tuple, embeddings.backgrounds)) == sorted(map(tuple, values["backgrounds"]))


def test_damaged_embeddings_are_named(bundle: Path, tmp_path: Path) -> None:
    context = make_context(tmp_path / "run", bundle)
    context.inputs["embeddings"].write_bytes(b"PK")
    with pytest.raises(InputError, match=r"embeddings\.npz is damaged"):
        train_nerf.main(context)


def test_preview_uses_the_bundles_colours_or_three_channels(bundle: Path) -> None:
    latents = np.zeros((2, 4, 5, 5), np.float32)
    latents[1, 0] = 1
    views = Views(latents, np.full((2, 5, 5), 0.5, np.float32), np.zeros((2, 5, 5), np.float32))
    picture = np.asarray(latent_preview(views.latents, views.opacity, open_bundle(bundle)))
    grey, tinted = picture[2, 2] / 255, picture[2, 22] / 255
    np.testing.assert_allclose(grey, 0.5, atol=0.01)
    np.testing.assert_allclose(
        tinted - grey, [0.5, 0.2, 0.0], atol=0.02
    )  # 0.3, 0.1, 0.0 over scale 0.5, cut at 1
    assert (picture[-1] == 128).all()


def sketched(run: Path, bundle: Path, sketch: Sketch, **options: object) -> Context:
    context = make_context(run, bundle, **options)
    context.inputs["sketch"] = run / "sketch.npz"
    save_sketch(context.inputs["sketch"], sketch)
    train_nerf.main(context)
    return context


def agreement(context: Context, sketch: Sketch) -> float:
    """Return the volume IoU of a trained scene and its sketch."""
    points = np.random.default_rng(0).uniform(-1, 1, (20_000, 3)).astype(np.float32)
    scene = load_scene(context.outputs["scene"])
    cells = np.minimum(((points + 1) * 32).astype(int), 63)
    dense = (density(scene, points) * 0.2 > np.log(2)) & scene.occupancy.occupied[tuple(cells.T)]
    return volume_iou(dense, look_up(sketch, points)[0])


def test_a_sketch_shapes_the_scene_as_strictly_as_asked(bundle: Path, bar: Sketch, tmp_path: Path) -> None:
    """The regression test of Sketch-Shape: figures of the day it was written, with room."""
    strict, free = (
        sketched(tmp_path / f"{sigma}", bundle, bar, sigma_s=sigma, steps=40) for sigma in (0.05, 1.5)
    )
    found = agreement(strict, bar), agreement(free, bar)
    assert found[0] > 0.8
    assert found[0] > found[1] + 0.1
    assert strict.metrics["shape_loss"] < 0.05
    history = json.loads(strict.outputs["history"].read_text())
    assert all(row["shape"] >= 0 for row in history)


def test_a_sketched_scene_is_the_same_when_killed_and_resumed(
    bundle: Path, bar: Sketch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = sketched(tmp_path / "whole", bundle, bar, steps=12, checkpoint_every=5, shape_start=5)
    real = step.training_step

    def killed(state, *arguments, **named):
        if state.step == 8:
            raise KeyboardInterrupt
        return real(state, *arguments, **named)

    monkeypatch.setattr(nerf_train, "training_step", killed)
    with pytest.raises(KeyboardInterrupt):
        sketched(tmp_path / "killed", bundle, bar, steps=12, checkpoint_every=5, shape_start=5)
    monkeypatch.undo()
    again = sketched(tmp_path / "killed", bundle, bar, steps=12, checkpoint_every=5, shape_start=5)
    assert again.metrics["resumed_at"] == 5
    assert again.outputs["scene"].read_bytes() == whole.outputs["scene"].read_bytes()
