"""Execution providers by their short names; absent ones are refused in words."""

from pathlib import Path

import onnxruntime
import pytest

from pipeline.diffusion.graphs import open_graph
from pipeline.diffusion.providers import PROVIDERS, provider_chain
from pipeline.errors import InputError
from tests.tiny_bundle import write_unet


def test_a_present_provider_comes_first_and_falls_back_on_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        onnxruntime, "get_available_providers", lambda: ["CUDAExecutionProvider", "CPUExecutionProvider"]
    )
    assert provider_chain("cuda") == ["CUDAExecutionProvider", "CPUExecutionProvider"]
    assert provider_chain("cpu") == ["CPUExecutionProvider"]


@pytest.mark.parametrize("name", ["coreml", "warp drive"])
def test_an_absent_one_is_refused_with_those_that_are_there(name: str, tmp_path: Path) -> None:
    write_unet(tmp_path / "unet")
    with (
        pytest.raises(InputError, match=rf"PROVIDER is '{name}', .* has cpu.*: choose one of these"),
        open_graph(tmp_path / "unet", provider=name),
    ):
        pass


def test_a_provider_that_onnxruntime_drops_in_silence_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_unet(tmp_path / "unet")
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: list(PROVIDERS.values()))
    with (
        pytest.raises(InputError, match="PROVIDER is 'cuda', but it did not start"),
        pytest.warns(UserWarning, match="not in available"),
        open_graph(tmp_path / "unet", provider="cuda"),
    ):
        pass


def test_every_name_is_one_of_onnxruntimes() -> None:
    assert set(PROVIDERS.values()) <= set(onnxruntime.get_all_providers()) | {"ROCMExecutionProvider"}
