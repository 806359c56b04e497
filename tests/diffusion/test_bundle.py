"""Every fault of a bundle's files is one line that names the file, before a network is opened."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest

from export.bundle_files import write_bundle_json
from pipeline.diffusion.bundle import graph_scale, latent_size, open_bundle
from pipeline.diffusion.onnx_file import read_onnx
from pipeline.diffusion.sessions import vae_decoder
from pipeline.errors import InputError
from tests.tiny_bundle import FACTOR, SCALE, save_graph, write_tiny_bundle


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    return write_tiny_bundle(tmp_path / "tiny")


@pytest.fixture
def foreign(bundle: Path) -> Path:
    """The same folder as another exporter leaves it: no bundle.json, so no checksums."""
    (bundle / "bundle.json").unlink()
    return bundle


def refusal(folder: Path) -> str:
    with pytest.raises(InputError) as error:
        open_bundle(folder)
    text = str(error.value)
    assert "\n" not in text
    return text


def test_a_bundle_is_described(bundle: Path) -> None:
    found = open_bundle(bundle)
    assert (found.name, found.image_size, found.latent_size) == ("tiny", 16 * FACTOR, 16)
    assert (found.latent_scale, found.view_prompts, found.has_vae_encoder) == (SCALE, "eight", True)
    assert found.known_words is not None
    assert "armchair" in found.known_words
    assert (found.camera, found.views) == ((), 1)


def test_a_bundle_says_what_its_denoiser_is_told(bundle: Path) -> None:
    description = json.loads((bundle / "bundle.json").read_text())
    told = {"camera": ["azimuth", "backdrop_told", "backdrop", "backdrop"], "views": 4}
    (bundle / "bundle.json").write_text(json.dumps(description | told))
    found = open_bundle(bundle)
    assert (found.camera, found.views) == (tuple(told["camera"]), 4)


def test_the_linear_map_sees_what_the_decoder_sees(bundle: Path) -> None:
    latents = np.random.default_rng(0).uniform(-0.3, 0.3, (2, 4, 5, 6)).astype(np.float32)
    found = open_bundle(bundle).linear_rgb(latents)
    with vae_decoder(bundle / "vae_decoder") as decode:
        np.testing.assert_allclose(found, decode(latents)[:, ::FACTOR, ::FACTOR], atol=1e-5)
    (bundle / "bundle.json").unlink()
    assert open_bundle(bundle).linear_rgb(latents) is None


def test_a_foreign_folder_takes_sizes_from_its_configs_or_from_stable_diffusion(foreign: Path) -> None:
    found = open_bundle(foreign)
    assert (found.latent_size, found.image_size, found.latent_scale) == (16, 16 * FACTOR, SCALE)
    assert (found.view_prompts, found.known_words, found.distillation) == ("paper", None, {})
    for config in foreign.glob("*/config.json"):
        config.unlink()
    found = open_bundle(foreign)
    assert (found.latent_size, found.image_size, found.latent_scale) == (64, 512, 0.18215)


def test_a_bundle_without_vae_encoder_is_whole(foreign: Path) -> None:
    for file in (foreign / "vae_encoder").iterdir():
        file.unlink()
    (foreign / "vae_encoder").rmdir()
    assert not open_bundle(foreign).has_vae_encoder


def test_importing_the_description_is_light() -> None:
    code = "import sys, pipeline.diffusion.bundle; print({'onnxruntime', 'torch'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


@pytest.mark.parametrize(
    "name",
    [
        "unet/model.onnx",
        "text_encoder/model.onnx",
        "vae_decoder/model.onnx",
        "tokenizer/vocab.json",
        "tokenizer/merges.txt",
        "scheduler/scheduler_config.json",
    ],
)
@pytest.mark.parametrize("checksums", [True, False])
def test_a_missing_or_empty_file_is_named(bundle: Path, name: str, checksums: bool) -> None:
    if not checksums:
        (bundle / "bundle.json").unlink()
    (bundle / name).write_bytes(b"")
    assert str(bundle / name) in refusal(bundle)
    assert "0 bytes" in refusal(bundle)
    (bundle / name).unlink()
    assert str(bundle / name) in refusal(bundle)
    assert "missing" in refusal(bundle)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_a_truncated_model_is_named_even_without_checksums(foreign: Path, share: float) -> None:
    model = foreign / "unet" / "model.onnx"
    data = model.read_bytes()
    model.write_bytes(data[: int(len(data) * share)])
    assert str(model) in refusal(foreign)


def test_a_changed_file_fails_its_checksum(bundle: Path) -> None:
    model = bundle / "vae_encoder" / "model.onnx"
    data = bytearray(model.read_bytes())
    data[len(data) // 2] ^= 1
    model.write_bytes(bytes(data))
    assert str(model) in refusal(bundle)
    assert "checksum" in refusal(bundle)
    open_bundle(bundle, verify=False)  # whole as far as its structure goes


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 3\n", "git lfs pull"),
        (b"\n<!DOCTYPE html><html><body>404</body></html>", "web page"),
        (b"garbage " * 100, "no ONNX model"),
        (bytes(1000), "no ONNX model"),
        (bytes([8, 9]), "no ONNX graph"),
    ],
)
def test_what_is_no_model_is_said(foreign: Path, content: bytes, said: str) -> None:
    model = foreign / "unet" / "model.onnx"
    model.write_bytes(content)
    assert str(model) in refusal(foreign)
    assert said in refusal(foreign)


def with_external_weights(folder: Path, location: str) -> Path:
    """Move the weights of folder's model into another file, and say that they are at `location`."""
    model = onnx.load(folder / "model.onnx")
    onnx.save_model(
        model,
        folder / "model.onnx",
        save_as_external_data=True,
        location="model.onnx_data",
        size_threshold=16,
    )
    model = onnx.load(folder / "model.onnx", load_external_data=False)
    for tensor in model.graph.initializer:
        for entry in tensor.external_data:
            if entry.key == "location":
                entry.value = location
    (folder / "model.onnx").write_bytes(model.SerializeToString())
    return folder / "model.onnx_data"


def test_external_weights_are_found_missed_and_measured(foreign: Path) -> None:
    data = with_external_weights(foreign / "unet", "model.onnx_data")
    open_bundle(foreign)
    whole = data.read_bytes()
    data.write_bytes(whole[:-1])
    assert str(data) in refusal(foreign)
    assert f"{len(whole)}" in refusal(foreign)
    data.unlink()
    assert str(data) in refusal(foreign)
    assert "missing" in refusal(foreign)


@pytest.mark.parametrize("location", ["../model.onnx_data", "/etc/hostname", "a/../../x", ""])
def test_external_weights_outside_the_folder_are_refused(foreign: Path, location: str) -> None:
    with_external_weights(foreign / "unet", location)
    assert str(foreign / "unet" / "model.onnx") in refusal(foreign)
    assert "inside its own folder" in refusal(foreign)


def test_external_weights_behind_a_link_out_of_the_folder_are_refused(foreign: Path) -> None:
    data = with_external_weights(foreign / "unet", "model.onnx_data")
    data.rename(foreign.parent / "elsewhere")
    data.symlink_to(foreign.parent / "elsewhere")
    assert "link" in refusal(foreign)


@pytest.mark.parametrize(
    ("operator", "said"),
    [
        ("com.microsoft.GroupNorm<groups = 2, epsilon = 1e-5, activation = 0>(x, s, s)", "GPU"),
        ("com.microsoft.NhwcConv(x, s)", "GPU"),
        ("evil.Operator(x, s)", "evil::Operator"),
    ],
)
def test_graphs_for_a_gpu_and_custom_operators_are_explained(foreign: Path, operator: str, said: str) -> None:
    domains = ', "com.microsoft": 1, "evil": 1]>'
    graph = f"g (float[b, 4, h, w] x, float[4] s) => (float[b, 4, h, w] y) {{ y = {operator} }}"
    model = onnx.parser.parse_model(f'<ir_version: 9, opset_import: ["": 20{domains}\n{graph}')
    (foreign / "unet" / "model.onnx").write_bytes(model.SerializeToString())
    assert said in refusal(foreign)


def test_a_local_function_is_no_custom_operator(foreign: Path) -> None:
    text = """<ir_version: 9, opset_import: ["": 20, "local": 1]>
    g (float[2] x) => (float[2] y) { y = local.twice(x) }
    <domain: "local", opset_import: ["": 20]> twice (x) => (y) { y = Add(x, x) }"""
    (foreign / "unet" / "model.onnx").write_bytes(onnx.parser.parse_model(text).SerializeToString())
    open_bundle(foreign)


@pytest.mark.parametrize("content", ["{", "[1]", "null", "\udcff", "[" * 100_000])
@pytest.mark.parametrize("name", ["scheduler/scheduler_config.json", "unet/config.json", "bundle.json"])
def test_garbage_json_is_named(foreign: Path, name: str, content: str) -> None:
    (foreign / name).write_bytes(content.encode("utf-8", "surrogateescape"))
    assert str(foreign / name) in refusal(foreign)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("latent_size", "32"),
        ("latent_size", -1),
        ("latent_size", True),
        ("latent_scale", 0.7),
        ("view_prompts", "seven"),
        ("camera", ["azimuth", "altitude"]),
        ("camera", [["azimuth"]]),
        ("camera", "azimuth"),
        ("views", 0),
        ("views", 65),
        ("views", "4"),
        ("distillation", [1]),
        ("known_words", "red"),
        ("latent_to_rgb", [[1, 2, 3]]),
        ("latent_to_rgb", "x"),
        ("latent_to_rgb_bias", [1, 2, "nan"]),
        ("latent_to_rgb_bias", [1, 2, 10**400]),
        ("files", {"../secret": "00"}),
        ("files", {"unet/other.onnx": "00"}),
    ],
)
def test_a_wrong_value_in_bundle_json_is_named(bundle: Path, key: str, value: object) -> None:
    description = json.loads((bundle / "bundle.json").read_text())
    (bundle / "bundle.json").write_text(json.dumps({**description, key: value}))
    text = refusal(bundle)
    assert any(word in text for word in (key, "secret", "other.onnx", "NaN", "finite numbers"))


def test_settings_of_single_graph_folders(bundle: Path) -> None:
    assert graph_scale(bundle / "vae_decoder") == SCALE
    assert latent_size(bundle / "unet") == 16
    (bundle / "vae_decoder" / "config.json").write_text('{"scaling_factor": "big"}')
    with pytest.raises(InputError, match="scaling_factor"):
        graph_scale(bundle / "vae_decoder")


def test_writing_checksums_opens_the_bundle(bundle: Path) -> None:
    (bundle / "unet" / "model.onnx").write_bytes(b"")
    with pytest.raises(InputError, match="unet"):
        write_bundle_json(bundle, {"name": "tiny"})


def test_old_exporters_list_weights_as_inputs(tmp_path: Path) -> None:
    path = save_graph(
        tmp_path,
        "g (float[b, 2] x, float[2] w) => (float[b, 2] y) { y = Mul(x, w) }",
        {"w": np.ones(2, np.float32)},
    )
    outline = read_onnx(path)
    assert list(outline.inputs) == ["x"]
    assert outline.inputs["x"].shape == (None, 2)
    assert outline.inputs["x"].element_type == 1
    assert list(outline.outputs) == ["y"]
    assert outline.operators == {("", "Mul")}
