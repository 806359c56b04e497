"""A diffusers checkpoint of toy size with random weights, saved as diffusers saves it."""

from pathlib import Path
from typing import Any

import torch
from diffusers import AutoencoderKL, AutoencoderTiny, UNet2DConditionModel
from transformers import CLIPTextConfig, CLIPTextModel

from export.bundle_files import train_tokenizer, write_json

VOCABULARY, WIDTH, LATENT_SIZE, LENGTH = 600, 32, 8, 16
SCHEDULER = {
    "_class_name": "PNDMScheduler",
    "num_train_timesteps": 1000,
    "beta_schedule": "scaled_linear",
    "beta_start": 0.00085,
    "beta_end": 0.012,
    "steps_offset": 1,
}


def tiny_unet(**changes: Any) -> Any:
    """A UNet of two levels, one with cross-attention."""
    torch.manual_seed(0)
    sizes = {
        "sample_size": LATENT_SIZE,
        "block_out_channels": (32, 64),
        "layers_per_block": 1,
        "down_block_types": ("CrossAttnDownBlock2D", "DownBlock2D"),
        "up_block_types": ("UpBlock2D", "CrossAttnUpBlock2D"),
        "cross_attention_dim": WIDTH,
        "attention_head_dim": 8,
    }
    unet: Any = UNet2DConditionModel(**{**sizes, **changes})
    return unet.eval()


def tiny_vae(kind: str = "AutoencoderKL") -> Any:
    """A VAE that halves once, or TAESD's kind, which halves twice."""
    torch.manual_seed(1)
    if kind == "AutoencoderTiny":
        channels: Any = {"encoder_block_out_channels": [8] * 3, "decoder_block_out_channels": [8] * 3}
        blocks: Any = {"num_encoder_blocks": [1] * 3, "num_decoder_blocks": [1] * 3}
        tiny: Any = AutoencoderTiny(**channels, **blocks)
        return tiny.eval()
    vae: Any = AutoencoderKL(
        block_out_channels=[32, 32], down_block_types=["DownEncoderBlock2D"] * 2, latent_channels=4,
        up_block_types=["UpDecoderBlock2D"] * 2, layers_per_block=1, sample_size=2 * LATENT_SIZE,
    )  # fmt: skip
    return vae.eval()


def tiny_text_encoder(**changes: Any) -> Any:
    """CLIP's text model, two layers."""
    torch.manual_seed(2)
    sizes = {
        "vocab_size": VOCABULARY, "hidden_size": WIDTH, "intermediate_size": 64, "num_hidden_layers": 2,
        "num_attention_heads": 1, "max_position_embeddings": LENGTH, "bos_token_id": VOCABULARY - 2,
        "eos_token_id": VOCABULARY - 1, "pad_token_id": VOCABULARY - 1,
    }  # fmt: skip
    return CLIPTextModel(CLIPTextConfig(**{**sizes, **changes})).eval()


def write_tiny_diffusers(
    folder: Path,
    *,
    kind: str = "StableDiffusionPipeline",
    vae: str = "AutoencoderKL",
    prediction: str = "epsilon",
) -> Path:
    """Save the whole checkpoint and return its folder."""
    for name, network in (
        ("unet", tiny_unet()),
        ("vae", tiny_vae(vae)),
        ("text_encoder", tiny_text_encoder()),
    ):
        network.save_pretrained(folder / name)
    train_tokenizer(folder / "tokenizer", ["a red chair"], vocabulary_size=VOCABULARY, max_length=LENGTH)
    write_json(folder / "scheduler" / "scheduler_config.json", {**SCHEDULER, "prediction_type": prediction})
    write_json(
        folder / "model_index.json",
        {
            "_class_name": kind,
            "unet": ["diffusers", "UNet2DConditionModel"],
            "vae": ["diffusers", vae],
            "text_encoder": ["transformers", "CLIPTextModel"],
            "tokenizer": ["transformers", "CLIPTokenizer"],
            "scheduler": ["diffusers", "PNDMScheduler"],
        },
    )
    return folder


def diffusers_guided_step(folder: Path, prompt: str, guidance: float) -> dict[str, Any]:
    """One guided prediction, noise and clean latents of it, by transformers and diffusers alone."""
    from diffusers import DDIMScheduler
    from transformers import CLIPTokenizer

    tokenizer = CLIPTokenizer.from_pretrained(folder / "tokenizer")
    ids = tokenizer([prompt, ""], padding="max_length", max_length=LENGTH, truncation=True).input_ids
    encoder = CLIPTextModel.from_pretrained(folder / "text_encoder").eval()
    unet: Any = UNet2DConditionModel.from_pretrained(folder / "unet")
    scheduler: Any = DDIMScheduler.from_pretrained(folder / "scheduler", clip_sample=False)
    generator = torch.Generator().manual_seed(5)
    latents, noise = (torch.randn(1, 4, LATENT_SIZE, LATENT_SIZE, generator=generator) for _ in "ab")
    timestep = torch.tensor([400])
    noisy = scheduler.add_noise(latents, noise, timestep)
    with torch.no_grad():
        texts = encoder(torch.tensor(ids)).last_hidden_state
        told, without = unet.eval()(noisy.repeat(2, 1, 1, 1), timestep.repeat(2), texts).sample.chunk(2)
    scheduler.set_timesteps(1000)
    output = without + guidance * (told - without)
    clean = scheduler.step(output, int(timestep), noisy).pred_original_sample
    return {
        "latents": latents.numpy(),
        "noise": noise.numpy(),
        "clean": clean.numpy(),
        "texts": texts.numpy(),
    }
