"""Go on training from the bundle alone: `python -m export.everyday_objects.train.restore WORK`.

What is committed are the averaged weights, inside the ONNX graphs, where the exporter has renamed, reshaped
and transposed them. To find them, the same networks are exported once more with random weights: each
parameter is recognised among the constants of that export by its values, and read from the same place of the
bundle's graph. The state of the optimiser is not kept anywhere; it starts anew.
"""

import argparse
import json
import shutil
import tempfile
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import nn

from export.everyday_objects.networks.autoencoder import Decoder, Encoder
from export.everyday_objects.networks.denoiser import Denoiser
from export.everyday_objects.networks.text_encoder import TextEncoder
from export.everyday_objects.train.export_bundle import NAME, export_graphs
from pipeline.diffusion.tokenizer import load_tokenizer

Networks = tuple[Encoder, Decoder, Denoiser, TextEncoder]


def constants(graph: Path) -> dict[str, np.ndarray]:
    """The constants of an ONNX file by name, float32."""
    tensors = onnx.load(graph / "model.onnx").graph.initializer
    return {t.name.removesuffix("_half"): numpy_helper.to_array(t).astype(np.float32) for t in tensors}


def transfer(network: nn.Module, probe: dict[str, np.ndarray], trained: dict[str, np.ndarray]) -> None:
    """Fill `network`, whose weights were exported as `probe`, with the weights that stand in `trained`.

    Raises ValueError naming a parameter that is not found, or found with another shape.
    """
    for name, parameter in network.named_parameters():
        values = parameter.detach().half().float().numpy()
        for place, constant in probe.items():
            if constant.size != values.size:
                continue
            if np.allclose(constant.reshape(values.shape), values, rtol=1e-5, atol=0):
                found = trained[place].reshape(values.shape)
            elif (
                constant.ndim == 2 and constant.T.shape == values.shape and np.array_equal(constant.T, values)
            ):
                found = trained[place].T
            else:
                continue
            parameter.data.copy_(torch.from_numpy(np.ascontiguousarray(found)))
            break
        else:
            raise ValueError(f"{name}: not among the constants of its graph; the architecture has changed")


def randomise(network: nn.Module) -> None:
    """Give every parameter values that no other has."""
    for parameter in network.parameters():
        nn.init.normal_(parameter, std=0.05)


def restore_networks(folder: Path) -> Networks:
    """Return the networks of a bundle with its weights (fp16 values)."""
    torch.manual_seed(0)
    text_encoder = TextEncoder(load_tokenizer(folder / "tokenizer").engine.get_vocab_size())
    networks = (Encoder().eval(), Decoder().eval(), Denoiser().eval(), text_encoder.eval())
    for fresh in networks:
        randomise(fresh)
    fold_whitening(networks[0])
    with tempfile.TemporaryDirectory() as scratch:
        export_graphs(Path(scratch), networks)
        graphs = ("vae_encoder", "vae_decoder", "unet", "text_encoder")
        for name, restored in zip(graphs, networks, strict=True):
            transfer(restored, constants(Path(scratch) / name), constants(folder / name))
    return networks


def fold_whitening(encoder: Encoder) -> None:
    """Make the encoder's last step the identity: the exporter multiplies it into the convolution before."""
    mean, variance = encoder.whiten.running_mean, encoder.whiten.running_var
    assert mean is not None
    assert variance is not None
    mean.zero_()
    variance.fill_(1 - encoder.whiten.eps)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--folder", type=Path, default=Path("onnx_models") / NAME)
    options = parser.parse_args()
    encoder, decoder, denoiser, text_encoder = restore_networks(options.folder)
    options.work.mkdir(parents=True, exist_ok=True)
    shutil.copytree(options.folder / "tokenizer", options.work / "tokenizer", dirs_exist_ok=True)
    torch.save(
        {"encoder": encoder.state_dict(), "decoder": decoder.state_dict()}, options.work / "autoencoder.pt"
    )
    states = {"text_encoder": text_encoder.state_dict(), "denoiser": denoiser.state_dict()}
    average = {f"{n}.{k}": v for n, state in states.items() for k, v in state.items()}
    step = json.loads((options.folder / "bundle.json").read_text())["training_steps"]
    torch.save(
        {"model": average, "average": average, "step": step, "shards": 0}, options.work / "denoiser.state.pt"
    )
    torch.save(average, options.work / "denoiser.pt")


if __name__ == "__main__":
    main()
