"""What a checkpoint of Stable Diffusion's class holds, and its networks, loaded one at a time.

A checkpoint is a folder as diffusers saves it, or a single .safetensors file in the original layout
(single_file.py). Nothing is fetched and nothing pickled is read. Other kinds of models are refused, with the
reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from diffusers import AutoencoderKL, AutoencoderTiny, UNet2DConditionModel
from safetensors import safe_open
from transformers import CLIPTextModel

from pipeline.diffusion.bundle import read_json
from pipeline.errors import InputError

# Pipelines whose UNet, VAE and single text encoder work as Stable Diffusion's.
PIPELINES = {
    "StableDiffusionPipeline",
    "StableDiffusionImg2ImgPipeline",
    "LatentConsistencyModelPipeline",
    "LatentConsistencyModelImg2ImgPipeline",
}
VAES = {"AutoencoderKL": AutoencoderKL, "AutoencoderTiny": AutoencoderTiny}
OTHERS = {
    "XL": "its UNet takes a second text encoder's pooled output and picture sizes",
    "3": "its denoiser is a transformer, not a UNet",
    "Flux": "its denoiser is a transformer, not a UNet",
    "Inpaint": "its UNet takes a mask and a masked picture besides the latents",
    "Upscale": "its UNet takes a small picture besides the latents",
    "Depth2Img": "its UNet takes a depth map besides the latents",
    "InstructPix2Pix": "its UNet takes a second picture besides the latents",
}


@dataclass(frozen=True)
class Checkpoint:
    """The parts of a checkpoint; the three loaders return torch modules in fp32, made for evaluation."""

    path: Path
    text_encoder: Callable[[], Any]
    unet: Callable[[], Any]
    vae: Callable[[], Any]
    scheduler: Mapping[str, Any]
    """Keys of diffusers' scheduler_config.json."""
    write_tokenizer: Callable[[Path], None]
    """Write the tokenizer's files to a folder."""
    parameters: Mapping[str, int]
    """Numbers in "text_encoder", "unet" and "vae"."""


def open_folder(folder: Path) -> Checkpoint:
    """Return the checkpoint in a folder that diffusers saved. No weight is read.

    Raises InputError: no such checkpoint, weights only as pickles, or a kind that is not supported.
    """
    index = read_json(folder / "model_index.json")
    refuse_other_pipelines(folder, str(index.get("_class_name")))
    unet = read_json(folder / "unet" / "config.json")
    refuse_other_unets(folder / "unet", unet)
    kind = read_json(folder / "vae" / "config.json").get("_class_name", "AutoencoderKL")
    if kind not in VAES:
        raise InputError(f"{folder / 'vae'}: {kind} is not supported, expected {' or '.join(VAES)}")
    files = {name: _weights(folder / name) for name in ("text_encoder", "unet", "vae")}

    def load(model: Any, name: str, **options: Any) -> Any:
        variant = "fp16" if all(".fp16." in file.name for file in files[name]) else None
        loaded = model.from_pretrained(
            folder / name, use_safetensors=True, local_files_only=True, variant=variant,
            torch_dtype=torch.float32, **options,
        )  # fmt: skip
        return loaded.eval()

    return Checkpoint(
        path=folder,
        text_encoder=lambda: load(CLIPTextModel, "text_encoder", attn_implementation="eager"),
        unet=lambda: load(UNet2DConditionModel, "unet"),
        vae=lambda: load(VAES[kind], "vae"),
        scheduler=read_json(folder / "scheduler" / "scheduler_config.json"),
        write_tokenizer=lambda target: _copy_tokenizer(folder / "tokenizer", target),
        parameters={name: sum(map(count_parameters, found)) for name, found in files.items()},
    )


def refuse_other_pipelines(path: Path, kind: str) -> None:
    """Raise InputError when a pipeline's class is none of Stable Diffusion's."""
    if kind in PIPELINES:
        return
    reason = next(
        (why for part, why in OTHERS.items() if part in kind), "it is none of Stable Diffusion 1 or 2's"
    )
    raise InputError(
        f"{path}: {kind} is not supported, because {reason}; give a checkpoint of Stable Diffusion 1.x or 2.x"
    )


def refuse_other_unets(path: Path, config: Mapping[str, Any]) -> None:
    """Raise InputError when a UNet takes more than latents, timestep and text."""
    channels = (config.get("in_channels", 4), config.get("out_channels", 4))
    extra = [
        key
        for key in ("addition_embed_type", "class_embed_type", "num_class_embeds", "encoder_hid_dim_type")
        if config.get(key) is not None
    ]
    if channels != (4, 4):
        reason = f"its UNet takes {channels[0]} channels and gives {channels[1]}, expected 4 and 4"
    elif extra:
        reason = f"its UNet has {', '.join(extra)}: it takes more than latents, timestep and text"
    else:
        return
    raise InputError(
        f"{path}: not supported, because {reason}; give a text-to-image checkpoint of SD 1.x or 2.x"
    )


def count_parameters(file: Path) -> int:
    """Return how many numbers a .safetensors file holds; raises InputError when it is damaged."""
    return sum(math.prod(shape) for shape in tensor_shapes(file).values())


def tensor_shapes(file: Path) -> dict[str, tuple[int, ...]]:
    """Return the shape of every tensor in a .safetensors file, by its name, reading the header alone."""
    with open_weights(file) as tensors:
        names = tensors.keys()
        return {name: tuple(tensors.get_slice(name).get_shape()) for name in names}


def open_weights(file: Path) -> Any:
    """Open a .safetensors file; raises InputError when it is missing, cut short or something else."""
    if not file.is_file():
        raise InputError(f"{file}: no such file, expected a .safetensors checkpoint")
    try:
        return safe_open(file, framework="pt")
    except Exception as error:  # the package has one exception of its own, which is not always what it raises
        raise InputError(
            f"{file}: {file.stat().st_size} bytes that are no .safetensors file ({str(error)[:120]}); "
            "copy it again"
        ) from None


def _weights(folder: Path) -> list[Path]:
    """Return the .safetensors files of a network: the plain ones, else those stored as fp16."""
    found = sorted(folder.glob("*.safetensors"))
    plain = [file for file in found if ".fp16." not in file.name and ".non_ema." not in file.name]
    if found:
        return plain or found
    if any(folder.glob("*.bin")):
        raise InputError(
            f"{folder}: holds its weights as pickles (.bin) alone, which can run code when read; "
            "save it as .safetensors"
        )
    raise InputError(f"{folder}: no .safetensors file, expected the weights of {folder.name}; copy it again")


def _copy_tokenizer(source: Path, target: Path) -> None:
    names = ("vocab.json", "merges.txt", "special_tokens_map.json", "tokenizer_config.json", "tokenizer.json")
    target.mkdir(parents=True, exist_ok=True)
    for name in names:
        if (source / name).is_file():
            (target / name).write_bytes((source / name).read_bytes())
