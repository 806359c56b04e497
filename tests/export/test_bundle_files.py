"""The files around the graphs: what other programs look for, and checksums."""

import hashlib
import json
from pathlib import Path

import pytest

from export.bundle_files import write_configs
from tests.tiny_bundle import SCALE, write_tiny_bundle


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_bundle(tmp_path_factory.mktemp("models") / "tiny", latent_size=8)


def read(path: Path) -> dict[str, object]:
    value = json.loads(path.read_text("utf-8"))
    assert isinstance(value, dict)
    return value


def test_every_file_is_listed_with_its_checksum(bundle: Path) -> None:
    files = read(bundle / "bundle.json")["files"]
    there = {path.relative_to(bundle).as_posix(): path for path in bundle.rglob("*") if path.is_file()}
    del there["bundle.json"]
    assert files == {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in there.items()}


def test_the_configs_say_what_optimum_and_diffusers_say(bundle: Path) -> None:
    index = read(bundle / "model_index.json")
    assert index["_class_name"] == "OnnxStableDiffusionPipeline"
    assert {"text_encoder", "unet", "vae_decoder", "vae_encoder", "tokenizer", "scheduler"} <= index.keys()
    decoder = read(bundle / "vae_decoder" / "config.json")
    assert (decoder["scaling_factor"], decoder["sample_size"]) == (SCALE, 32)
    assert decoder["block_out_channels"] == [64, 64, 64]  # two halvings: a factor of 4
    assert read(bundle / "unet" / "config.json")["sample_size"] == 8
    assert read(bundle / "scheduler" / "scheduler_config.json")["prediction_type"] == "v_prediction"


def test_equal_inputs_make_equal_files(bundle: Path, tmp_path: Path) -> None:
    again = write_tiny_bundle(tmp_path / "tiny", latent_size=8)
    assert (again / "bundle.json").read_bytes() == (bundle / "bundle.json").read_bytes()


def test_a_factor_that_is_no_power_of_two_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="downsampling is 6"):
        write_configs(
            tmp_path, latent_size=8, latent_channels=4, latent_scale=1.0, downsampling=6, scheduler={}
        )
