"""A diffusers checkpoint becomes a bundle that computes what diffusers computes, or nothing at all."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest

import export.__main__ as door
from export import export_checkpoint
from export.checkpoint import open_folder
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.distillation import sds_gradient
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import denoiser, text_encoder
from pipeline.diffusion.tokenizer import load_tokenizer
from tests.tiny_diffusers import LATENT_SIZE, diffusers_guided_step, write_tiny_diffusers

GUIDANCE = 7.5


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_diffusers(tmp_path_factory.mktemp("source") / "tiny", prediction="v_prediction")


@pytest.fixture(scope="module")
def bundle(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    models = tmp_path_factory.mktemp("models")
    assert door.main({"CHECKPOINT": str(source), "NAME": "tiny"}, models) == 0
    assert [path.name for path in models.iterdir()] == ["tiny"]
    return models / "tiny"


def guided_step(bundle: Path, expected: dict[str, Any]) -> np.ndarray:
    """The clean latents that the pipeline sees in the same noisy ones."""
    tokenizer = load_tokenizer(bundle / "tokenizer")
    with text_encoder(bundle / "text_encoder") as encode:
        texts = encode(np.stack([tokenizer.encode(text) for text in ("a red chair", "")]))
    np.testing.assert_allclose(texts, expected["texts"], atol=1e-4)
    with denoiser(bundle / "unet") as denoise:
        step = sds_gradient(
            expected["latents"], denoise, load_schedule(bundle / "scheduler"), np.array([400]),
            expected["noise"], texts[:1], texts[1], GUIDANCE,
        )  # fmt: skip
    return step.predicted_clean


def test_one_guided_step_is_diffusers_own(source: Path, bundle: Path) -> None:
    expected = diffusers_guided_step(source, "a red chair", GUIDANCE)
    np.testing.assert_allclose(guided_step(bundle, expected), expected["clean"], atol=1e-4)


def test_the_bundle_describes_itself_and_its_comparison(bundle: Path) -> None:
    described = json.loads((bundle / "bundle.json").read_text())
    graphs = {"text_encoder", "unet", "vae_decoder", "vae_encoder", "vae_encoder_vjp"}
    assert described["onnx_max_diff"].keys() == graphs
    assert all(value <= described["onnx_tolerance"] for value in described["onnx_max_diff"].values())
    opened = open_bundle(bundle)
    assert (opened.latent_size, opened.image_size, opened.latent_scale) == (
        LATENT_SIZE,
        2 * LATENT_SIZE,
        0.18215,
    )
    assert opened.has_vae_encoder


RUNTIME_ALONE = """
import sys
for name in ("diffusers", "transformers", "onnx", "onnxscript", "onnx_ir", "safetensors", "export"):
    sys.modules[name] = None  # importing it fails, as where it is not installed
import numpy as np
from pathlib import Path
from pipeline.diffusion.sessions import denoiser, text_encoder
from pipeline.diffusion.tokenizer import load_tokenizer
bundle = Path(sys.argv[1])
ids = load_tokenizer(bundle / "tokenizer").encode("a red chair")
with text_encoder(bundle / "text_encoder") as encode, denoiser(bundle / "unet") as denoise:
    print(denoise(np.zeros((1, 4, 8, 8), np.float32), np.array([3]), encode(ids[None])).shape)
"""


def test_runtime_dependencies_alone_run_it(bundle: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", RUNTIME_ALONE, str(bundle)], capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() == "(1, 4, 8, 8)", done.stderr


def test_attention_is_one_node(bundle: Path) -> None:
    nodes = [node.op_type for node in onnx.load(bundle / "unet" / "model.onnx").graph.node]
    assert nodes.count("MultiHeadAttention") == 8  # four transformer blocks, each to itself and to the text
    assert "Softmax" not in nodes


def without_effort(environment: dict[str, str], models: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """The one line of an export that must end before anything is made."""
    assert door.main(environment, models) == 2
    assert not models.exists() or not list(models.iterdir())
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    return lines[0]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (
            {"_class_name": "StableDiffusionXLPipeline"},
            "StableDiffusionXLPipeline is not supported, because its",
        ),
        ({"_class_name": "FluxPipeline"}, "a transformer, not a UNet"),
        ({"_class_name": "DDPMPipeline"}, "none of Stable Diffusion 1 or 2's"),
    ],
)
def test_other_models_are_refused_with_the_reason(
    change: dict[str, str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "model_index.json").write_text(json.dumps(change))
    environment = {"CHECKPOINT": str(tmp_path / "other"), "NAME": "x"}
    assert reason in without_effort(environment, tmp_path / "models", capsys)


def test_pickles_and_wrong_unets_are_refused(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "copy"
    for path in source.rglob("*"):
        if path.is_file():
            target = copy / path.relative_to(source)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(path.read_bytes())
    environment = {"CHECKPOINT": str(copy), "NAME": "x"}
    weights = copy / "vae" / "diffusion_pytorch_model.safetensors"
    weights.rename(weights.with_suffix(".bin"))
    assert "pickles (.bin) alone" in without_effort(environment, tmp_path / "models", capsys)
    config = json.loads((copy / "unet" / "config.json").read_text())
    (copy / "unet" / "config.json").write_text(json.dumps({**config, "in_channels": 9}))
    assert "takes 9 channels" in without_effort(environment, tmp_path / "models", capsys)


@pytest.mark.parametrize(
    ("environment", "reason"),
    [
        ({}, "CHECKPOINT is empty"),
        ({"CHECKPOINT": "/nowhere"}, "NAME is empty"),
        ({"CHECKPOINT": "/nowhere", "NAME": "x"}, "does not exist"),
        ({"CHECKPOINT": "/nowhere", "NAME": "a/b"}, "without slashes"),
        (
            {"CHECKPOINT": "/nowhere", "NAME": "x", "STORAGE": "int4"},
            "STORAGE is 'int4', expected fp32 or fp16",
        ),
    ],
)
def test_what_was_asked_for_wrongly_is_one_line(
    environment: dict[str, str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert reason in without_effort(environment, tmp_path / "models", capsys)


def test_a_pickle_is_refused_before_anything_is_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.ckpt").write_bytes(b"pickled")
    monkeypatch.setitem(sys.modules, "diffusers", None)
    environment = {"CHECKPOINT": str(tmp_path / "a.ckpt"), "NAME": "x"}
    assert "pickles" in without_effort(environment, tmp_path / "models", capsys)


def test_an_export_that_is_stopped_leaves_nothing(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(*arguments: object, **options: object) -> float:
        raise KeyboardInterrupt

    monkeypatch.setattr(export_checkpoint, "export_text_encoder", stop)
    models = tmp_path / "models"
    (models / ".x.export-1").mkdir(parents=True)  # of an export that was killed
    assert door.main({"CHECKPOINT": str(source), "NAME": "x"}, models) == 130
    assert list(models.iterdir()) == []
    assert "nothing was installed" in capsys.readouterr().err


def test_a_graph_that_differs_installs_nothing(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def differ(*arguments: object, **options: object) -> float:
        raise ValueError("text_encoder: the exported graph differs from torch by 1.00e+00")

    monkeypatch.setattr(export_checkpoint, "export_text_encoder", differ)
    assert door.main({"CHECKPOINT": str(source), "NAME": "x"}, tmp_path / "models") == 1
    assert list((tmp_path / "models").iterdir()) == []
    assert "differs from torch" in capsys.readouterr().err


def test_a_name_that_is_taken_is_left_alone(
    source: Path, bundle: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert door.main({"CHECKPOINT": str(source), "NAME": "tiny"}, bundle.parent) == 2
    assert "exists: choose another NAME" in capsys.readouterr().err
    open_bundle(bundle)


def test_its_cost_is_said_beforehand(source: Path) -> None:
    checkpoint = open_folder(source)
    whole = {"text_encoder": 123_000_000, "unet": 860_000_000, "vae": 84_000_000}
    large = export_checkpoint.export_cost(
        type(checkpoint)(**{**vars(checkpoint), "parameters": whole}), export_checkpoint.ExportOptions()
    )
    assert 6 < large.memory_gb < 10
    assert 4 < large.disk_gb < 5
    small = export_checkpoint.export_cost(checkpoint, export_checkpoint.ExportOptions())
    assert small.memory_gb < 1.5
