"""The stage on tiny bundles: a run of the same latents, of others, a textured mesh."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.errors import InputError
from pipeline.nerf import start as fits
from pipeline.nerf import step
from pipeline.nerf.scene import load_scene
from pipeline.options.job import Job
from pipeline.options.nerf import TrainNerf
from pipeline.options.start import StartFit
from pipeline.run.stage import Context
from pipeline.stages import start, train_nerf
from tests.stages.test_train_nerf import OPTIONS, make_context
from tests.tiny_bundle import write_tiny_bundle


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_bundle(tmp_path_factory.mktemp("models") / "tiny", latent_size=12)


@pytest.fixture(scope="module")
def other(bundle: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another model: its decoder shows the same latents in other colours."""
    folder = write_tiny_bundle(tmp_path_factory.mktemp("models") / "other", latent_size=12)
    (folder / "vae_decoder" / "note").write_text("another decoder")
    return folder


@pytest.fixture(scope="module")
def trained(bundle: Path, tmp_path_factory: pytest.TempPathFactory) -> Context:
    context = make_context(tmp_path_factory.mktemp("runs") / "trained", bundle)
    train_nerf.main(context)
    return context


def embedded(folder: Path, bundle: Path) -> dict[str, Path]:
    """Return the inputs that every start has; the backgrounds are those that the encoder makes."""
    from pipeline import arrays
    from pipeline.diffusion.sessions import vae_encoder
    from pipeline.stages.embed import flat_latents
    from pipeline.training.flat_colours import flat_colours

    folder.mkdir(parents=True, exist_ok=True)
    with vae_encoder(bundle / "vae_encoder") as encode:
        latents = flat_latents(encode, flat_colours()[::7], 48)
    values = {
        "cond": np.zeros((16, 8, 16), np.float32), "uncond": np.zeros((8, 16), np.float32),
        "view_prompts": np.array("eight"), "backgrounds": latents, "background_rgb": flat_colours()[::7],
    }  # fmt: skip
    (folder / "embeddings.npz").write_bytes(arrays.pack(values))
    return {
        "embeddings": folder / "embeddings.npz",
        "vae_encoder": bundle / "vae_encoder",
        "vae_decoder": bundle / "vae_decoder",
    }


def to_start(folder: Path, bundle: Path, source: dict[str, Path], **fit: object) -> Context:
    inputs = {**embedded(folder, bundle), **source}
    (folder / "checkpoints").mkdir(exist_ok=True)
    job = Job(
        prompt="a red ball", seed=3, start="given",
        train_nerf=TrainNerf(**{**OPTIONS, "checkpoint_every": 10}),
        start_fit=StartFit(**{"views": 8, "steps": 30, "cells": 24, **fit}),
    )  # fmt: skip
    return Context(job, inputs, {"scene": folder / "start.npz"}, folder / "checkpoints")


def run_of(trained: Context, decoder: Path) -> dict[str, Path]:
    described = {"start_description": decoder / "bundle.json"}
    return {"start_scene": trained.outputs["scene"], "start_decoder": decoder / "vae_decoder", **described}


def test_a_field_in_the_same_latents_is_taken_as_it_is(
    bundle: Path, trained: Context, tmp_path: Path
) -> None:
    context = to_start(tmp_path / "a", bundle, run_of(trained, bundle))
    start.main(context)
    assert not context.metrics["fitted"]
    assert context.outputs["scene"].read_bytes() == trained.outputs["scene"].read_bytes()


def test_a_field_of_another_model_is_fitted_to_its_decoded_views(
    bundle: Path, other: Path, trained: Context, tmp_path: Path
) -> None:
    context = to_start(tmp_path / "a", bundle, run_of(trained, other))
    start.main(context)
    assert context.metrics["fitted"]
    assert context.metrics["psnr"] > 23
    assert load_scene(context.outputs["scene"]).rgb is None


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    mesh = trimesh.creation.icosphere(3)
    colours = np.append(130 + 80 * mesh.vertices, np.full((len(mesh.vertices), 1), 255), axis=1).astype(
        np.uint8
    )
    path = tmp_path_factory.mktemp("meshes") / "ball.ply"
    trimesh.Trimesh(
        mesh.vertices, mesh.faces, visual=trimesh.visual.ColorVisuals(vertex_colors=colours), process=False
    ).export(path)
    return path


def test_a_mesh_of_another_tool_killed_and_resumed_is_the_same_scene(
    bundle: Path, ball: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = to_start(tmp_path / "whole", bundle, {"start_file": ball})
    start.main(whole)
    assert whole.metrics["psnr"] > 14
    real = step.training_step

    def killed(state, *arguments, **named):
        if state.step == 17:
            raise KeyboardInterrupt
        return real(state, *arguments, **named)

    monkeypatch.setattr(fits, "training_step", killed)
    with pytest.raises(KeyboardInterrupt):
        start.main(to_start(tmp_path / "killed", bundle, {"start_file": ball}))
    monkeypatch.undo()
    again = to_start(tmp_path / "killed", bundle, {"start_file": ball})
    start.main(again)
    assert again.metrics["resumed_at"] == 10
    assert again.outputs["scene"].read_bytes() == whole.outputs["scene"].read_bytes()


def test_a_model_without_encoder_says_so(bundle: Path, ball: Path, tmp_path: Path) -> None:
    context = to_start(tmp_path / "a", bundle, {"start_file": ball})
    del context.inputs["vae_encoder"]
    with pytest.raises(InputError, match="has no vae_encoder, which START needs"):
        start.main(context)
