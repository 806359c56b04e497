"""Folders of other exporters: real Optimum's, and the conventions of diffusers' script and of Olive."""

import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.distillation import sds_gradient
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.sessions import denoiser, text_encoder, vae_decoder, vae_encoder
from pipeline.diffusion.tokenizer import load_tokenizer
from tests.tiny_diffusers import diffusers_guided_step, write_tiny_diffusers

GUIDANCE = 7.5
# In a process of its own: the exporter of torch that Optimum calls changes global state.
OPTIMUM = """
import sys
from optimum.exporters.onnx import main_export
main_export(sys.argv[1], output=sys.argv[2], task="text-to-image", device="cpu")
"""


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_diffusers(tmp_path_factory.mktemp("source") / "tiny")


@pytest.fixture(scope="module")
def optimum(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    if find_spec("optimum") is None:
        pytest.skip("optimum-onnx is not installed: pip install -e '.[optimum]'")
    folder = tmp_path_factory.mktemp("models") / "optimum"
    subprocess.run([sys.executable, "-c", OPTIMUM, str(source), str(folder)], check=True, capture_output=True)
    return folder


def check_guided_step(folder: Path, expected: dict[str, Any]) -> None:
    """The folder opens, and one guided step and the VAE give what diffusers gives."""
    bundle = open_bundle(folder)
    tokenizer = load_tokenizer(folder / "tokenizer")
    with text_encoder(folder / "text_encoder") as encode:
        texts = encode(np.stack([tokenizer.encode(text) for text in ("a red chair", "")]))
    np.testing.assert_allclose(texts, expected["texts"], atol=1e-4)
    with denoiser(folder / "unet") as denoise:
        step = sds_gradient(
            expected["latents"], denoise, load_schedule(folder / "scheduler"), np.array([400]),
            expected["noise"], texts[:1], texts[1], GUIDANCE,
        )  # fmt: skip
    np.testing.assert_allclose(step.predicted_clean, expected["clean"], atol=1e-3)
    with vae_decoder(folder / "vae_decoder") as decode, vae_encoder(folder / "vae_encoder") as encode_image:
        images = decode(expected["latents"])
        latents = encode_image(images)
    assert images.shape[1] == bundle.image_size
    assert latents.shape == expected["latents"].shape


def test_a_folder_of_optimums_own(source: Path, optimum: Path) -> None:
    check_guided_step(optimum, diffusers_guided_step(source, "a red chair", GUIDANCE))


def cast_input(model: onnx.ModelProto, name: str, kind: int, shape: list[str | int]) -> None:
    """Let an input have another type and shape, with a Cast in front of its use (and one row picked)."""
    graph = model.graph
    port = next(port for port in graph.input if port.name == name)
    before = port.type.tensor_type.elem_type
    for node in graph.node:
        node.input[:] = [f"{name}_inside" if value == name else value for value in node.input]
    steps = [helper.make_node("Cast", [name], [f"{name}_cast"], to=before)]
    if len(shape) > len(port.type.tensor_type.shape.dim):
        graph.initializer.append(helper.make_tensor("first_row", TensorProto.INT64, [], [0]))
        steps.append(helper.make_node("Gather", [f"{name}_cast", "first_row"], [f"{name}_inside"], axis=0))
    else:
        steps[0].output[0] = f"{name}_inside"
    for step in reversed(steps):
        graph.node.insert(0, step)
    port.CopyFrom(helper.make_tensor_value_info(name, kind, shape))


def rewrite(
    source: Path, folder: Path, weights: str, ids: int, timestep: tuple[int, list[str | int]]
) -> Path:
    """A copy of an exported folder by another exporter's conventions."""
    shutil.copytree(source, folder, ignore=shutil.ignore_patterns("config.json", "bundle.json"))
    for name in ("text_encoder", "unet"):
        path = folder / name / "model.onnx"
        model = onnx.load(path)
        if name == "unet":
            cast_input(model, "timestep", *timestep)
        elif ids != TensorProto.INT64:
            cast_input(model, "input_ids", ids, ["batch", "sequence"])
        path.unlink()
        onnx.save(model, path, save_as_external_data=True, location=weights, size_threshold=0)
    return folder


@pytest.mark.parametrize(
    ("weights", "ids", "timestep"),
    [
        ("weights.pb", TensorProto.INT32, (TensorProto.INT64, ["batch"])),  # diffusers' script
        ("model.onnx.data", TensorProto.INT64, (TensorProto.FLOAT, [1])),  # Olive
    ],
)
def test_the_conventions_of_other_exporters(
    source: Path, optimum: Path, tmp_path: Path, weights: str, ids: int, timestep: tuple[int, list[str | int]]
) -> None:
    folder = rewrite(optimum, tmp_path / "other", weights, ids, timestep)
    for name in ("unet", "vae_decoder"):  # sizes other than Stable Diffusion's stand there alone
        shutil.copy(optimum / name / "config.json", folder / name)
    assert (folder / "unet" / weights).is_file()
    check_guided_step(folder, diffusers_guided_step(source, "a red chair", GUIDANCE))
