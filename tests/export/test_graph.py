"""Exported graphs equal their torch modules, in fp32 and in half-precision storage, or are not installed."""

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from export.graph import export_graph
from pipeline.diffusion.graphs import open_graph
from pipeline.diffusion.sessions import denoiser

AXES = {
    "sample": {0: "batch", 2: "height", 3: "width"},
    "timestep": {0: "batch"},
    "encoder_hidden_states": {0: "batch"},
}


class SmallUNet(nn.Module):
    """Every kind of layer a latent UNet has: convolution, group norm, linear, attention, sinusoidal time."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Conv2d(4, 32, 3, padding=1)
        self.norm = nn.GroupNorm(8, 32)
        self.query, self.key = nn.Linear(32, 32), nn.Linear(16, 32)
        self.time = nn.Linear(32, 32)
        self.head = nn.Conv2d(32, 4, 3, padding=1)
        self.frequencies: Tensor
        self.register_buffer("frequencies", torch.exp(torch.linspace(0, -9, 16)))

    def forward(self, sample: Tensor, timestep: Tensor, encoder_hidden_states: Tensor) -> Tensor:
        hidden = self.norm(self.stem(sample))
        phase = timestep.float()[:, None] * self.frequencies
        hidden = hidden + self.time(torch.cat([phase.sin(), phase.cos()], 1))[:, :, None, None]
        tokens = hidden.flatten(2).transpose(1, 2)
        keys, queries = self.heads(self.key(encoder_hidden_states)), self.heads(self.query(tokens))
        seen = F.scaled_dot_product_attention(queries, keys, keys).transpose(1, 2).flatten(2)
        output: Tensor = self.head(F.silu(hidden + seen.transpose(1, 2).reshape(hidden.shape)))
        return output

    def heads(self, tokens: Tensor) -> Tensor:
        return tokens.reshape(*tokens.shape[:2], 4, 8).transpose(1, 2)


def feeds(batch: int, size: int) -> dict[str, Tensor]:
    random = torch.Generator().manual_seed(batch)
    return {
        "sample": torch.randn(batch, 4, size, size, generator=random),
        "timestep": torch.randint(0, 1000, (batch,), generator=random),
        "encoder_hidden_states": torch.randn(batch, 7, 16, generator=random),
    }


@pytest.fixture(scope="module")
def unet() -> SmallUNet:
    torch.manual_seed(0)
    return SmallUNet().eval()


@pytest.fixture(scope="module")
def exported(unet: SmallUNet, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """The UNet with half-precision weights and free batch and size, and its largest difference."""
    folder = tmp_path_factory.mktemp("half") / "unet"
    difference = export_graph(
        unet,
        feeds(2, 16),
        ["out_sample"],
        folder,
        dynamic_axes=AXES,
        check_inputs=[feeds(3, 24)],
        half_weights=True,
    )
    return folder, difference


def test_it_runs_at_other_sizes_and_equals_torch_with_the_rounded_weights(
    unet: SmallUNet, exported: tuple[Path, float]
) -> None:
    folder, difference = exported
    assert difference < 1e-5
    rounded = SmallUNet().eval()
    rounded.load_state_dict(
        {name: v if name == "frequencies" else v.half().float() for name, v in unet.state_dict().items()}
    )
    inputs = feeds(1, 8)
    with denoiser(folder) as denoise, torch.no_grad():
        found = denoise(*(value.numpy() for value in inputs.values()))
        np.testing.assert_allclose(found, rounded(**inputs).numpy(), atol=1e-5)
        # ... and it is the rounding, nothing else, that separates it from the unrounded module.
        assert 1e-5 < np.abs(found - unet(**inputs).numpy()).max() < 1e-2


def test_weights_are_stored_in_half_and_tables_are_not(exported: tuple[Path, float]) -> None:
    graph = onnx.load(exported[0] / "model.onnx").graph
    kinds = {tensor.name: tensor.data_type for tensor in graph.initializer}
    large = [tensor for tensor in graph.initializer if np.prod(tensor.dims) >= 256 and tensor.data_type != 7]
    assert large
    assert all(tensor.data_type == onnx.TensorProto.FLOAT16 for tensor in large)
    assert kinds["frequencies"] == onnx.TensorProto.FLOAT


def test_the_module_itself_is_left_alone(unet: SmallUNet, exported: tuple[Path, float]) -> None:
    torch.manual_seed(0)
    untouched = SmallUNet()
    for name, value in unet.state_dict().items():
        assert torch.equal(value, untouched.state_dict()[name])


def test_no_path_of_this_machine_is_in_the_file(exported: tuple[Path, float]) -> None:
    data = (exported[0] / "model.onnx").read_bytes()
    here = Path(__file__).resolve()
    assert str(here.parents[2]).encode() not in data
    assert b"site-packages" not in data
    assert here.name.encode() not in data


class WrongWhenLarge(nn.Module):
    """Its export keeps the branch of the example input: torch and the graph part ways elsewhere."""

    def forward(self, sample: Tensor) -> Tensor:
        return sample * 2 if torch.onnx.is_in_onnx_export() else sample * 3


def test_a_graph_that_differs_from_torch_is_not_installed(tmp_path: Path) -> None:
    folder = tmp_path / "unet"
    folder.mkdir()
    (folder / "model.onnx").write_bytes(b"the one before")
    with pytest.raises(ValueError, match=r"unet: the exported graph differs from torch by .*not installed"):
        export_graph(WrongWhenLarge(), {"sample": torch.ones(2, 3)}, ["out"], folder)
    assert (folder / "model.onnx").read_bytes() == b"the one before"
    assert [path.name for path in tmp_path.iterdir()] == ["unet"]


def test_weights_that_do_not_fit_half_precision_are_named(tmp_path: Path) -> None:
    layer = nn.Linear(2, 2)
    layer.weight.data.fill_(1e5)
    with pytest.raises(ValueError, match=r"weight: values up to 1e\+05 do not fit"):
        export_graph(layer, {"input": torch.ones(1, 2)}, ["out"], tmp_path / "graph", half_weights=True)


class TwoOutputs(nn.Module):
    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        return x + 1, x.sum(1)


def test_several_outputs_keep_their_names_and_external_weights_their_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    export_graph(
        TwoOutputs(), {"x": torch.ones(2, 3)}, ["last_hidden_state", "pooler_output"], tmp_path / "two"
    )
    with open_graph(tmp_path / "two") as graph:
        found = graph.run({"x": np.ones((2, 3))})
    assert found["last_hidden_state"].tolist() == [[2.0] * 3] * 2
    assert found["pooler_output"].tolist() == [3.0, 3.0]

    monkeypatch.setattr("export.graph.EXTERNAL_BYTES", 0)
    layer = nn.Linear(64, 64)
    export_graph(layer, {"input": torch.ones(1, 64)}, ["out"], tmp_path / "big")
    assert (tmp_path / "big" / "model.onnx_data").stat().st_size >= 64 * 64 * 4
    assert (tmp_path / "big" / "model.onnx").stat().st_size < 4096
    monkeypatch.undo()
    export_graph(TwoOutputs(), {"x": torch.ones(2, 3)}, ["a", "b"], tmp_path / "big")
    assert [path.name for path in (tmp_path / "big").iterdir()] == ["model.onnx"]
