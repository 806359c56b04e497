"""RGB refinement of a trained tiny scene: through the encoder's gradient, or without it."""

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.sessions import vae_decoder
from pipeline.errors import InputError
from pipeline.nerf import step
from pipeline.nerf.refining import render_rgb
from pipeline.nerf.scene import load_scene
from pipeline.nerf.train import preview_cameras
from pipeline.options.job import Job
from pipeline.options.nerf import Refinement, TrainNerf
from pipeline.run.stage import Context
from pipeline.stages import refine, train_nerf
from pipeline.stages.refine import latent_to_rgb, likeness
from pipeline.training.loop import PREVIEW
from tests.stages.test_train_nerf import OPTIONS, make_context
from tests.tiny_bundle import LATENT_TO_RGB, RGB_BIAS, SCALE, write_tiny_bundle

REFINEMENT = {
    "fit_steps": 6, "steps": 12, "resolution": 16, "guidance_scale": 3.0, "checkpoint_every": 5,
    "preview_every": 10, "learning_rate": 5e-3, "grid_learning_rate": 2e-2,
}  # fmt: skip


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_bundle(tmp_path_factory.mktemp("models") / "tiny", latent_size=12, encoder_vjp=True)


@pytest.fixture(scope="module")
def trained(bundle: Path, tmp_path_factory: pytest.TempPathFactory) -> Context:
    context = make_context(tmp_path_factory.mktemp("runs") / "trained", bundle)
    train_nerf.main(context)
    return context


def to_refine(folder: Path, bundle: Path, trained: Context, without: str = "", **options: object) -> Context:
    graphs = {n: bundle / n for n in ("vae_encoder", "vae_encoder_vjp", "vae_decoder") if n != without}
    inputs = {**trained.inputs, **graphs, "scene": trained.outputs["scene"]}
    (folder / "checkpoints").mkdir(parents=True, exist_ok=True)
    job = Job(
        prompt="a red ball", seed=3, refine=True, train_nerf=TrainNerf(**OPTIONS),
        refinement=Refinement(**{**REFINEMENT, **options}),
    )  # fmt: skip
    outputs = {"scene": folder / "field_rgb.npz", "history": folder / "refinement.json"}
    return Context(job, inputs, outputs, folder / "checkpoints")


@pytest.fixture(scope="module")
def finished(bundle: Path, trained: Context, tmp_path_factory: pytest.TempPathFactory) -> Context:
    context = to_refine(tmp_path_factory.mktemp("runs") / "refined", bundle, trained)
    refine.main(context)
    return context


def test_it_starts_as_the_decoded_scene_and_ends_as_an_rgb_scene(finished: Context) -> None:
    """The tiny decoder is linear: the first RGB render is the decoded one, to the bilinear enlargement."""
    assert finished.metrics["start_psnr"] > 25
    assert finished.metrics["gradient"] == "encoder"
    assert finished.metrics["warnings"] == []
    scene = load_scene(finished.outputs["scene"])
    assert scene.rgb is not None
    history = json.loads(finished.outputs["history"].read_text())
    assert [row["step"] for row in history] == list(range(1, 19))
    assert (finished.scratch / PREVIEW).is_file()


def test_fitting_brings_a_field_with_wrong_colours_to_the_decoded_ones(
    bundle: Path, trained: Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = refine.latent_to_rgb

    def wrong(bundle):
        layer = right(bundle)
        layer.bias.data += 0.3
        return layer

    monkeypatch.setattr(refine, "latent_to_rgb", wrong)
    context = to_refine(tmp_path, bundle, trained, fit_steps=40, steps=0)
    refine.main(context)
    assert context.metrics["end_psnr"] > context.metrics["start_psnr"] + 6


def test_killed_and_resumed_gives_the_same_bytes(
    finished: Context, bundle: Path, trained: Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = step.training_step

    def killed(state, *arguments, **named):
        if state.step == 12:
            raise KeyboardInterrupt
        return real(state, *arguments, **named)

    monkeypatch.setattr(refine, "training_step", killed)
    with pytest.raises(KeyboardInterrupt):
        refine.main(to_refine(tmp_path, bundle, trained))
    monkeypatch.undo()
    again = to_refine(tmp_path, bundle, trained)
    refine.main(again)
    assert again.metrics["resumed_at"] == 10
    assert again.outputs["scene"].read_bytes() == finished.outputs["scene"].read_bytes()
    assert again.metrics["start_psnr"] == finished.metrics["start_psnr"]


def test_without_the_encoders_gradient_it_says_so_and_goes_the_other_way(
    bundle: Path, trained: Context, tmp_path: Path
) -> None:
    context = to_refine(tmp_path, bundle, trained, "vae_encoder_vjp", fit_steps=1, steps=2, shading=1.0)
    refine.main(context)
    assert context.metrics["gradient"] == "image"
    (warning,) = context.metrics["warnings"]
    assert "vae_encoder_vjp" in warning
    asked = to_refine(tmp_path / "asked", bundle, trained, fit_steps=1, steps=1, gradient="image")
    refine.main(asked)
    assert asked.metrics["gradient"] == "image"
    assert asked.metrics["warnings"] == []


def test_a_model_without_encoder_is_an_error(bundle: Path, trained: Context, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no vae_encoder"):
        refine.main(to_refine(tmp_path, bundle, trained, "vae_encoder"))


def test_the_layer_is_the_bundles_map_or_the_papers(bundle: Path, tmp_path: Path) -> None:
    layer = latent_to_rgb(open_bundle(bundle))
    np.testing.assert_allclose(layer.matrix.detach(), LATENT_TO_RGB / SCALE, atol=1e-6)
    np.testing.assert_allclose(layer.bias.detach(), RGB_BIAS, atol=1e-6)
    foreign = write_tiny_bundle(tmp_path / "foreign")
    (foreign / "bundle.json").unlink()
    paper = latent_to_rgb(open_bundle(foreign))
    np.testing.assert_allclose(paper.matrix.detach()[0], [0.149, 0.0935, -0.079, -0.092], atol=1e-6)
    np.testing.assert_allclose(paper.bias.detach(), 0.5)


def test_likeness_is_large_for_the_scene_itself(bundle: Path, trained: Context, finished: Context) -> None:
    described, latent = open_bundle(bundle), load_scene(trained.outputs["scene"])
    cameras = preview_cameras(trained.job.train_nerf)
    with vae_decoder(bundle / "vae_decoder", SCALE) as decode:
        own = likeness(load_scene(finished.outputs["scene"]), latent, cameras, described, decode, 12)
    assert 10 < own < 60
    colours, opacity = render_rgb(load_scene(finished.outputs["scene"]), cameras, 12)
    assert colours.shape == (4, 3, 12, 12)
    assert opacity.shape == (4, 12, 12)
