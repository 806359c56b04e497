"""A NaN or an infinity stops a training at once, with one line for the user and the last good state kept."""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from onnx import numpy_helper

from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.view_gradient import flat_backgrounds, load_embeddings
from pipeline.errors import InputError
from pipeline.mesh.unwrap import unwrap_mesh
from pipeline.nerf import checkpoint as nerf_checkpoint
from pipeline.nerf import train as nerf_train
from pipeline.nerf.step import training_step
from pipeline.options import job as jobs
from pipeline.options.job import Job
from pipeline.options.paint import TrainPaint
from pipeline.paint import checkpoint as paint_checkpoint
from pipeline.paint import train as paint_train
from pipeline.paint.given_mesh import PaintMesh, load_paint_mesh, save_paint_mesh
from pipeline.paint.step import initial_paint, make_pool
from pipeline.run.stage import Context, execute
from pipeline.stages import train_nerf, train_paint
from pipeline.training import checkpoints
from tests import shapes
from tests.stages.test_train_nerf import make_context, write_embeddings
from tests.tiny_bundle import write_tiny_bundle

SHORT: dict[str, Any] = {"steps": 12, "checkpoint_every": 4, "preview_every": 100}
FATAL = 9
"""The step that goes wrong (of 0 to 11): the last good state is the one after step 8."""


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_bundle(tmp_path_factory.mktemp("models") / "tiny", latent_size=12)


@pytest.fixture(scope="module")
def ball_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    ball = unwrap_mesh(shapes.mesh_of(shapes.ball(1.0 - 1e-3), 12), 64, 2)[0]
    path = tmp_path_factory.mktemp("ball") / "mesh.npz"
    part = np.zeros(len(ball.faces), np.int32)
    vertices = ball.vertices.astype(np.float64)
    save_paint_mesh(path, PaintMesh(vertices, vertices, ball.faces, part, ("ball",), ball.uv, ball.uv_faces))
    return path


def nerf(folder: Path, bundle: Path, ball_file: Path) -> Context:
    return make_context(folder, bundle, **SHORT)


def paint(folder: Path, bundle: Path, ball_file: Path) -> Context:
    folder.mkdir()
    (folder / "checkpoints").mkdir()
    inputs = {
        "embeddings": write_embeddings(folder / "embeddings.npz"),
        "unet": bundle / "unet",
        "scheduler": bundle / "scheduler",
        "mesh": ball_file,
    }
    outputs = {"painted": folder / "painted.npz", "history": folder / "training.json"}
    options = TrainPaint(**SHORT, views=8, texture=16, supersampling=2, guidance_scale=3.0)
    return Context(Job(prompt="x", train_paint=options), inputs, outputs, folder / "checkpoints")


Fault = Callable[[np.ndarray], np.ndarray]


def spoil(monkeypatch: pytest.MonkeyPatch, stage: Any, fault: Fault) -> None:
    """Let the denoiser's answer at step FATAL go through `fault`, as if the network had given it."""
    real = stage.distillation_gradient

    def guidance_of(denoise: Any, *arguments: Any) -> Any:
        calls = 0

        def spoiled(*feeds: Any) -> np.ndarray:
            nonlocal calls
            calls += 1
            output = denoise(*feeds)
            return fault(output) if calls == FATAL + 1 else output

        return real(spoiled, *arguments)

    monkeypatch.setattr(stage, "distillation_gradient", guidance_of)


def with_nan(values: np.ndarray) -> np.ndarray:
    values = values.copy()
    values[-1, 2, 3, 4] = np.nan
    return values


def resumable(stage: str, context: Context) -> int:
    """Return the step that the newest checkpoint goes on from, having checked that all of it is finite."""
    values, damaged = checkpoints.read_newest(context.scratch, dict)
    assert values is not None
    assert not damaged
    for name, array in values.items():
        assert array.dtype.kind in "ub" or np.isfinite(array).all(), name
    if stage == "train_nerf":
        return nerf_checkpoint.decode_state(values, context.job.train_nerf)[0].step
    options = context.job.train_paint
    backgrounds = flat_backgrounds(load_embeddings(context.inputs["embeddings"]))
    mesh = load_paint_mesh(context.inputs["mesh"]).scaled(options.mesh_radius)
    size = open_bundle(context.inputs["unet"].parent, verify=False).latent_size
    pool = make_pool(mesh, options, options.texture, size, context.job.seed)
    return paint_checkpoint.decode_state(values, options, initial_paint(options, pool, backgrounds, 0))[
        0
    ].step


STAGES = {"train_nerf": (train_nerf, nerf), "train_paint": (train_paint, paint)}


@pytest.mark.parametrize("stage", STAGES)
def test_a_nan_of_the_denoiser(
    stage: str, bundle: Path, ball_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, make = STAGES[stage]
    context = make(tmp_path / "run", bundle, ball_file)
    spoil(monkeypatch, module, with_nan)
    with pytest.raises(InputError) as caught:
        module.main(context)
    said = str(caught.value)
    assert said.startswith(
        f"{stage} stopped at step {FATAL}: denoiser output holds 1 NaN or infinite values of "
    )
    assert f"; the last good state, after step 8, is kept in {context.scratch}" in said
    for word in (f"{stage}.learning_rate", f"{stage}.gradient_clip", "SEED"):
        assert word in said
    assert "\n" not in said
    assert not any(path.exists() for path in context.outputs.values())
    assert resumable(stage, context) == 8

    # Whatever gave the NaN is gone: the same command goes on from there.
    monkeypatch.undo()
    module.main(context)
    assert context.metrics["resumed_at"] == 8


@pytest.mark.parametrize("stage", STAGES)
def test_an_infinite_gradient(
    stage: str, bundle: Path, ball_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The guidance is finite, its product with the weights of the picture is not representable."""
    module, make = STAGES[stage]
    context = make(tmp_path / "run", bundle, ball_file)
    spoil(monkeypatch, module, lambda output: np.full_like(output, 3e38))
    with pytest.raises(InputError, match=rf"{stage} stopped at step {FATAL}: .*after step 8, is kept"):
        module.main(context)
    assert resumable(stage, context) == 8


@pytest.mark.parametrize("stage", STAGES)
def test_a_gradient_that_adam_cannot_square(
    stage: str, bundle: Path, ball_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Finite, but its second moment is not: without the check the parameter would stand still for ever."""
    module, make = STAGES[stage]
    context = make(tmp_path / "run", bundle, ball_file)
    spoil(monkeypatch, module, lambda output: output * np.float32(1e25))
    with pytest.raises(InputError, match=rf"gradient of \S+ reaches .* at step {FATAL}.*after step 8"):
        module.main(context)
    assert resumable(stage, context) == 8


@pytest.mark.parametrize("stage", STAGES)
def test_a_nan_latent(
    stage: str, bundle: Path, ball_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A parameter is spoilt behind the training's back (a bad memory chip): the next picture shows it."""
    module, make = STAGES[stage]
    context = make(tmp_path / "run", bundle, ball_file)
    home, name = (nerf_train, "training_step") if stage == "train_nerf" else (paint_train, "paint_step")
    real = getattr(home, name)

    def spoiled(state: Any, *arguments: Any, **named: Any) -> Any:
        if state.step == FATAL:
            with torch.no_grad():
                if stage == "train_nerf":
                    state.scene.field.bias3[2] = torch.nan
                else:
                    state.colours[:, 2] = torch.nan
        return real(state, *arguments, **named)

    monkeypatch.setattr(home, name, spoiled)
    with pytest.raises(InputError, match=rf"rendered latents holds \d+ NaN .* at step {FATAL}; .*step 8"):
        module.main(context)
    assert resumable(stage, context) == 8


def test_a_nan_density_is_found_though_it_is_not_rendered(
    bundle: Path, ball_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing exceeds a NaN threshold: the grid would be empty, and all later pictures finite backgrounds."""
    context = make_context(tmp_path / "run", bundle, **{**SHORT, "steps": 20, "checkpoint_every": 8})
    real = training_step

    def spoiled(state: Any, *arguments: Any, **named: Any) -> Any:
        if state.step == 16:  # when the grid is refreshed
            with torch.no_grad():
                state.scene.field.bias3[0] = torch.nan
        return real(state, *arguments, **named)

    monkeypatch.setattr(nerf_train, "training_step", spoiled)
    with pytest.raises(InputError, match=r"density holds \d+ NaN .* at step 16; .*after step 16"):
        train_nerf.main(context)


def test_before_the_first_checkpoint_there_is_nothing_to_keep(
    bundle: Path, ball_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = make_context(tmp_path / "run", bundle, **{**SHORT, "checkpoint_every": 50})
    spoil(monkeypatch, train_nerf, with_nan)
    with pytest.raises(InputError, match=rf"at step {FATAL}: .*; there was no checkpoint yet; lower"):
        train_nerf.main(context)


def test_the_user_gets_one_line_and_status_2(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """As the stage is started by Snakemake; the front door passes line and status on (see test_engine)."""
    shutil.copytree(bundle, tmp_path / "model")
    path = tmp_path / "model" / "unet" / "model.onnx"
    model = onnx.load(path)
    colour = next(tensor for tensor in model.graph.initializer if tensor.name == "colour")
    colour.CopyFrom(numpy_helper.from_array(np.full(4, np.nan, np.float32), "colour"))
    onnx.save(model, path)
    run = tmp_path / "run"
    context = make_context(run, tmp_path / "model", **SHORT)
    (run / "job.yaml").write_text(jobs.to_yaml(context.job))
    given = [f"--input={name}={path}" for name, path in context.inputs.items()]
    monkeypatch.chdir(run)
    monkeypatch.setattr(
        sys, "argv", ["", "--job=job.yaml", *given, "--output=scene=a.npz", "--output=history=b.json"]
    )
    with pytest.raises(SystemExit) as ended:
        execute("train_nerf", train_nerf.main)
    assert ended.value.code == 2
    (line,) = (run / "stages" / "train_nerf.error").read_text().splitlines()
    status, _, said = line.partition(" ")
    assert status == "2"
    assert said.startswith(f"train_nerf stopped at step 0: {path}: the output out_sample holds NaN or inf")
    assert said.endswith("copy or export them again; there was no checkpoint yet")
    assert "Traceback" not in "".join(capfd.readouterr())
    assert not (run / "a.npz").exists()
