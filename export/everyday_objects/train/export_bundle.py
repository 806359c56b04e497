"""Export the trained networks as a bundle in Optimum's layout.

`python -m export.everyday_objects.train.export_bundle WORK [--folder onnx_models/everyday-objects]`

Weights are stored in fp16 and computed in fp32; every graph is run and compared with torch before it is
installed.
"""

import argparse
import json
import shutil
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from export.bundle_files import write_bundle_json, write_configs
from export.encoder_vjp import export_encoder_vjp
from export.everyday_objects.data.captions import known_words
from export.everyday_objects.data.kinds import KINDS
from export.everyday_objects.data.pictures import DISTANCES, FOVS, IMAGE_SIZE, POLARS, draw_object
from export.everyday_objects.data.render import TOWARDS
from export.everyday_objects.data.shapes import RADIUS
from export.everyday_objects.networks.autoencoder import FACTOR, LATENT_CHANNELS, Decoder, Encoder
from export.everyday_objects.networks.denoiser import CAMERA, Denoiser
from export.everyday_objects.networks.text_encoder import MAX_TOKENS, WIDTH, TextEncoder
from export.everyday_objects.train.batches import TIMESTEPS
from export.everyday_objects.train.loss import BETAS
from export.graph import export_graph
from pipeline.diffusion.tokenizer import load_tokenizer

NAME = "everyday-objects"
# How score distillation is best run with this model, by eye on a first set of prompts; keys of
# pipeline.options.job.TrainNerf. `steps` stays out: QUALITY decides it.
DISTILLATION = {
    # By eye, on a bus, a house, an owl and a teddy bear: told the camera, words are all that guidance
    # amplifies. At 2 to 1.5 eyes and windows are missing, at 4 to 3 they come, at 10 to 7.5 corners fray.
    "guidance_scale": 6.0,
    "guidance_scale_end": 5.0,
    # Down to little noise at the end: edges are sharper, wheels rounder, at the same price.
    "timestep_min": 0.1,
    "timestep_max": 0.98,
    "timestep_max_end": 0.25,
    "predicted_clean_clamp": 4.0,
    "signal_power": 0.0,
    "sparsity_weight": 40.0,
    "sparsity_ramp": 0.8,
    "opacity_weight": 3.0,  # 10 eats thin parts: the poles of lamps
    # Rays that are opaque deep inside leave pits and holes: on 16 kinds most close with it, thin parts stay.
    "density_sharpening": 20.0,
    "blob_radius": 0.3,
    "grid_levels": 12,
    "grid_finest": 256,
    "radius": list(DISTANCES),
    "fov_degrees": list(FOVS),
    "polar_degrees": list(POLARS),
}
PAINTING = {"mesh_radius": RADIUS}


class EncoderGraph(nn.Module):
    """Optimum's vae_encoder: pictures in [-1, 1] to mean and log-variance (b, 8, h, w)."""

    def __init__(self, encoder: Encoder) -> None:
        super().__init__()
        self.encoder = encoder

    def forward(self, sample: Tensor) -> Tensor:
        """Encode; the log-variance is that of an encoder without noise."""
        mean = self.encoder(sample * 0.5 + 0.5)
        return torch.cat([mean, torch.full_like(mean, -30.0)], dim=1)


class DenoiserGraph(nn.Module):
    """The denoiser with as many views together as it was made for."""

    def __init__(self, denoiser: Denoiser) -> None:
        super().__init__()
        self.denoiser = denoiser

    def forward(
        self, sample: Tensor, timestep: Tensor, encoder_hidden_states: Tensor, camera: Tensor
    ) -> Tensor:
        """Predict v."""
        return self.denoiser(sample, timestep, encoder_hidden_states, camera)


class Mean(nn.Module):
    """Pictures in [-1, 1] to latents: what refinement pulls gradients back through."""

    def __init__(self, encoder: Encoder) -> None:
        super().__init__()
        self.encoder = encoder

    def forward(self, sample: Tensor) -> Tensor:
        """Encode."""
        return self.encoder(sample * 0.5 + 0.5)


class DecoderGraph(nn.Module):
    """Optimum's vae_decoder: latents to pictures in [-1, 1]."""

    def __init__(self, decoder: Decoder) -> None:
        super().__init__()
        self.decoder = decoder

    def forward(self, latent_sample: Tensor) -> Tensor:
        """Decode."""
        return self.decoder(latent_sample) * 2 - 1


def fit_latent_to_rgb(latents: np.ndarray, images: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Least squares from latents (n, 4, h, w) to area-averaged colours: (3, 4) matrix, (3,) bias, and R^2.

    images: (n, FACTOR h, FACTOR w, 3) uint8. The map goes to RGB in [-1, 1], as in the paper's equation.
    """
    n, _, h, w = latents.shape
    pixels = images.reshape(n, h, FACTOR, w, FACTOR, 3).mean((2, 4)).reshape(-1, 3) / 127.5 - 1
    points = latents.transpose(0, 2, 3, 1).reshape(-1, LATENT_CHANNELS).astype(np.float64)
    design = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    solution, *_ = np.linalg.lstsq(design, pixels, rcond=None)
    residual = pixels - design @ solution
    r2 = 1 - residual.var(0).sum() / pixels.var(0).sum()
    return solution[:4].T, solution[4], float(r2)


def load_networks(work: Path) -> tuple[Encoder, Decoder, Denoiser, TextEncoder]:
    """The trained networks, the averaged weights where there is an average."""
    encoder, decoder = Encoder(), Decoder()
    saved = torch.load(work / "autoencoder.pt", weights_only=True)
    encoder.load_state_dict(saved["encoder"])
    decoder.load_state_dict(saved["decoder"])
    average = torch.load(work / "denoiser.pt", weights_only=True)
    text_encoder = TextEncoder(load_tokenizer(work / "tokenizer").engine.get_vocab_size())
    denoiser = Denoiser()
    for name, network in (("text_encoder", text_encoder), ("denoiser", denoiser)):
        network.load_state_dict(
            {k[len(name) + 1 :]: v for k, v in average.items() if k.startswith(name + ".")}
        )
    return encoder.eval(), decoder.eval(), denoiser.eval(), text_encoder.eval()


def export_graphs(folder: Path, networks: tuple[Encoder, Decoder, Denoiser, TextEncoder]) -> dict[str, float]:
    """Write the four graphs; return the largest difference from torch of each."""
    encoder, decoder, denoiser, text_encoder = networks
    generator = torch.Generator().manual_seed(0)
    size = IMAGE_SIZE // FACTOR

    def latents(count: int, side: int) -> Tensor:
        return torch.randn(count, LATENT_CHANNELS, side, side, generator=generator)

    def unet_inputs(count: int) -> dict[str, Tensor]:
        steps = torch.randint(0, TIMESTEPS, (count,), generator=generator)
        some = torch.randint(0, text_encoder.tokens.num_embeddings, (count, MAX_TOKENS), generator=generator)
        with torch.no_grad():  # noise in place of text drives attention where rounding decides
            text = text_encoder(some)
        low = torch.tensor(
            [1, 0, np.radians(POLARS[0]), DISTANCES[0], np.radians(FOVS[0]), 1, -1, -1, -1, -1]
        )
        high = torch.tensor(
            [1, 6.28, np.radians(POLARS[1]), DISTANCES[1], np.radians(FOVS[1]), 1, 1, 1, 1, 1]
        )
        cameras = low + (high - low) * torch.rand(count, len(CAMERA), generator=generator)
        told = {"sample": latents(count, size), "timestep": steps, "encoder_hidden_states": text}
        return {**told, "camera": cameras.float()}

    def pictures(side: int) -> dict[str, Tensor]:
        return {"sample": torch.rand(2, 3, side, side, generator=generator) * 2 - 1}

    ids = torch.randint(0, text_encoder.tokens.num_embeddings, (2, MAX_TOKENS), generator=generator)
    plane = {0: "batch", 2: "height", 3: "width"}
    vocabulary = text_encoder.tokens.num_embeddings
    learned = torch.randn(3, WIDTH, generator=generator)
    return {
        "text_encoder": export_graph(
            text_encoder, {"input_ids": ids, "token_embeddings": learned}, ["last_hidden_state"],
            folder / "text_encoder", half_weights=True,
            dynamic_axes={"input_ids": {0: "batch"}, "token_embeddings": {0: "learned"}},
            check_inputs=[{"input_ids": ids % 2 + vocabulary, "token_embeddings": learned[:2]}],
        ),
        "unet": export_graph(
            DenoiserGraph(denoiser), unet_inputs(2 * denoiser.views), ["out_sample"], folder / "unet",
            dynamic_axes={name: {0: "batch"} for name in unet_inputs(1)},
            check_inputs=[unet_inputs(denoiser.views), unet_inputs(3 * denoiser.views)], half_weights=True,
        ),
        "vae_decoder": export_graph(
            DecoderGraph(decoder), {"latent_sample": latents(2, size)}, ["sample"], folder / "vae_decoder",
            dynamic_axes={"latent_sample": plane}, check_inputs=[{"latent_sample": latents(2, 2 * size)}],
            half_weights=True,
        ),
        "vae_encoder": export_graph(
            EncoderGraph(encoder), pictures(IMAGE_SIZE), ["latent_parameters"], folder / "vae_encoder",
            dynamic_axes={"sample": {0: "batch"}}, half_weights=True,
        ),
    }  # fmt: skip


def export_gradient(folder: Path, encoder: Encoder) -> float:
    """Write the encoder's input gradient, which RGB refinement uses; return its difference from autograd."""

    sample = torch.rand(1, 3, IMAGE_SIZE, IMAGE_SIZE, generator=torch.Generator().manual_seed(1)) * 2 - 1
    return export_encoder_vjp(Mean(encoder), sample, folder / "vae_encoder_vjp", half_weights=True)


def example_pictures(count: int) -> np.ndarray:
    """Return (count, IMAGE_SIZE, IMAGE_SIZE, 3) pictures in [0, 1] of held-out shapes, the same ones every
    time.
    """
    pictures = [draw_object(np.random.default_rng([4, i]), held_out=True)[2][i % 8] for i in range(count)]
    return np.stack(pictures).astype(np.float32)


def export_bundle(work: Path, folder: Path) -> None:
    """Export everything to `folder`, bundle.json last."""
    folder.mkdir(parents=True, exist_ok=True)
    networks = load_networks(work)
    differences = export_graphs(folder, networks)
    differences["vae_encoder_vjp"] = export_gradient(folder, networks[0])
    for name, difference in differences.items():
        print(f"{name}: largest difference from torch {difference:.1e}")
    shutil.rmtree(folder / "tokenizer", ignore_errors=True)
    shutil.copytree(work / "tokenizer", folder / "tokenizer")
    size = IMAGE_SIZE // FACTOR
    write_configs(
        folder, latent_size=size, latent_channels=LATENT_CHANNELS, latent_scale=1.0, downsampling=FACTOR,
        scheduler={"num_train_timesteps": TIMESTEPS, "beta_start": BETAS[0], "beta_end": BETAS[1],
                   "beta_schedule": "scaled_linear", "prediction_type": "v_prediction", "steps_offset": 0,
                   "clip_sample": False, "set_alpha_to_one": False},
    )  # fmt: skip
    images = example_pictures(200)
    batch = torch.from_numpy(images).permute(0, 3, 1, 2)
    with torch.no_grad():
        latents = networks[0](batch)
        decoded = networks[1](latents).clamp(0, 1)
    psnr = -10 * torch.log10((decoded - batch).square().mean((1, 2, 3)))
    matrix, bias, r2 = fit_latent_to_rgb(latents.numpy(), np.round(images * 255).astype(np.uint8))
    write_bundle_json(
        folder,
        {
            "name": NAME,
            "image_size": IMAGE_SIZE,
            "latent_size": size,
            "latent_channels": LATENT_CHANNELS,
            "latent_scale": 1.0,
            "view_prompts": "eight",
            "camera": list(CAMERA),
            "views": networks[2].views,
            "distillation": DISTILLATION,
            "painting": PAINTING,
            "light": [round(float(x), 4) for x in TOWARDS],
            "known_words": known_words(),
            "nouns": [k.words[0] for k in KINDS],
            "latent_to_rgb": [[round(float(v), 6) for v in row] for row in matrix],
            "latent_to_rgb_bias": [round(float(v), 6) for v in bias],
            "latent_to_rgb_r2": round(r2, 4),
            "reconstruction_psnr_held_out": round(float(psnr.mean()), 2),
            "onnx_max_diff": {k: float(f"{v:.2e}") for k, v in differences.items()},
            "training_steps": int(torch.load(work / "denoiser.state.pt", weights_only=True)["step"]),
            "trained_on": {
                "objects": "export/everyday_objects/data, all of our own making",
                "kinds": len(KINDS),
                "shapes": sum(k.variants for k in KINDS),
            },
            "licences": {"weights": "Apache-2.0"},
        },
    )
    total = sum(p.stat().st_size for p in folder.rglob("*") if p.is_file())
    print(
        json.dumps(
            {"folder": str(folder), "megabytes": round(total / 1e6, 1), "latent_to_rgb_r2": round(r2, 4)}
        )
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--folder", type=Path, default=Path("onnx_models") / NAME)
    options = parser.parse_args()
    export_bundle(options.work, options.folder)


if __name__ == "__main__":
    main()
