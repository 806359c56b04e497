"""A single .safetensors checkpoint in the original layout of Stable Diffusion 1.x or 2.x, without network.

Such a file has weights and no description: the sizes of the networks are read from the shapes of their
tensors. What shapes do not tell are Stable Diffusion's own numbers (8 heads a layer in 1.x, heads of 64
channels in 2.x). Whether a 2.x network predicts noise or velocity stands nowhere but, sometimes, in the
file's metadata: else it has to be said. CLIP's vocabulary comes from `clip_vocabulary`.
"""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from diffusers import AutoencoderKL, UNet2DConditionModel
from transformers import CLIPTextConfig, CLIPTextModel

from export.bundle_files import write_tokenizer
from export.checkpoint import Checkpoint, open_weights, tensor_shapes
from export.clip_vocabulary import clip_merges
from pipeline.diffusion.tokenizer import END
from pipeline.errors import InputError

Shapes = Mapping[str, tuple[int, ...]]

UNET, VAE = "model.diffusion_model.", "first_stage_model."
CLIP_1, CLIP_2 = "cond_stage_model.transformer.text_model.", "cond_stage_model.model."
OTHERS = {
    "conditioner.embedders.": "it is Stable Diffusion XL: its UNet takes two text encoders and picture sizes",
    "model.diffusion_model.joint_blocks.": "it is Stable Diffusion 3: its denoiser is a transformer",
    "double_blocks.": "it is Flux: its denoiser is a transformer",
    "model.diffusion_model.double_blocks.": "it is Flux: its denoiser is a transformer",
    "lora_unet_": "it is a LoRA, a change to a checkpoint and not one itself: merge it into one first",
}
SCHEDULER = {
    "_class_name": "DDIMScheduler",
    "num_train_timesteps": 1000,
    "beta_start": 0.00085,
    "beta_end": 0.012,
    "beta_schedule": "scaled_linear",
    "steps_offset": 1,
    "clip_sample": False,
    "set_alpha_to_one": False,
}


def open_single_file(path: Path, prediction: str = "") -> Checkpoint:
    """Return the checkpoint in one .safetensors file; weights are read when a network is asked for.

    `prediction`: "epsilon" or "v_prediction"; empty: as the file's metadata says, else epsilon for 1.x.
    Raises InputError: another kind of model, a damaged file, a 2.x file that does not say what it predicts.
    """
    shapes = tensor_shapes(path)
    _refuse_others(path, shapes)
    try:
        unet, vae, text = unet_config(shapes), vae_config(shapes), text_config(shapes)
    except KeyError as error:
        raise InputError(
            f"{path}: lacks the tensor {error}, expected a whole checkpoint of Stable Diffusion 1.x or 2.x "
            "with UNet, VAE and text encoder"
        ) from None
    prediction = prediction or _said_prediction(path)
    second = CLIP_2 + "token_embedding.weight" in shapes
    if not prediction and second:
        raise InputError(
            f"{path}: a Stable Diffusion 2.x file that does not say what it predicts: say "
            "PREDICTION=v_prediction (the 768 pixel model) or PREDICTION=epsilon (the 512 pixel base)"
        )
    prediction = prediction or "epsilon"
    unet["sample_size"] = 96 if second and prediction == "v_prediction" else 64
    counts = {"unet": (UNET,), "vae": (VAE,), "text_encoder": (CLIP_1, CLIP_2)}

    def load(model: Any, config: Mapping[str, Any]) -> Any:
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "config.json").write_text(json.dumps({"_class_name": model.__name__, **config}))
            loaded = model.from_single_file(
                str(path), config=folder, local_files_only=True, torch_dtype=torch.float32
            )
        return loaded.eval()

    return Checkpoint(
        path=path,
        text_encoder=lambda: _load_text_encoder(path, text, second),
        unet=lambda: load(UNet2DConditionModel, unet),
        vae=lambda: load(AutoencoderKL, vae),
        scheduler={**SCHEDULER, "prediction_type": prediction},
        write_tokenizer=lambda folder: write_tokenizer(
            folder, clip_merges(), max_length=text["max_position_embeddings"], pad="!" if second else END
        ),
        parameters={
            name: sum(math.prod(shape) for key, shape in shapes.items() if key.startswith(prefixes))
            for name, prefixes in counts.items()
        },
    )


def unet_config(shapes: Shapes) -> dict[str, Any]:
    """Return diffusers' config of a UNet, `sample_size` aside. Raises KeyError for a missing tensor."""
    inputs, outputs = (shapes[UNET + key] for key in ("input_blocks.0.0.weight", "out.2.weight"))
    channels: list[int] = []
    layers, attends = [0], [False]
    index = 1
    while any(key.startswith(f"{UNET}input_blocks.{index}.") for key in shapes):
        block = f"{UNET}input_blocks.{index}."
        if f"{block}0.op.weight" in shapes:  # the end of a level: a stride-2 convolution
            layers.append(0)
            attends.append(False)
        else:
            width = shapes[f"{block}0.out_layers.3.weight"][0]
            channels += [width] * (len(layers) - len(channels))
            layers[-1] += 1
            attends[-1] |= f"{block}1.proj_in.weight" in shapes
        index += 1
    middle = f"{UNET}middle_block.1.transformer_blocks.0.attn2.to_k.weight"
    linear = len(shapes[f"{UNET}middle_block.1.proj_in.weight"]) == 2
    return {
        "in_channels": inputs[1],
        "out_channels": outputs[0],
        "block_out_channels": channels,
        "layers_per_block": layers[0],
        "down_block_types": ["CrossAttnDownBlock2D" if seen else "DownBlock2D" for seen in attends],
        "up_block_types": ["CrossAttnUpBlock2D" if seen else "UpBlock2D" for seen in reversed(attends)],
        "cross_attention_dim": shapes[middle][1],
        "use_linear_projection": linear,
        # diffusers' name is misleading: it is the number of heads.
        "attention_head_dim": [max(1, width // 64) for width in channels] if linear else 8,
    }


def vae_config(shapes: Shapes) -> dict[str, Any]:
    """Return diffusers' config of a VAE. Raises KeyError for a tensor that is missing."""
    found = [re.match(rf"{VAE}encoder\.down\.(\d+)\.block\.(\d+)\.conv1\.weight", key) for key in shapes]
    places = [(int(match[1]), int(match[2])) for match in found if match]
    levels = 1 + max((level for level, _ in places), default=0)
    widths = [shapes[f"{VAE}encoder.down.{level}.block.0.conv1.weight"][0] for level in range(levels)]
    return {
        "block_out_channels": widths,
        "layers_per_block": 1 + max(layer for _, layer in places),
        "down_block_types": ["DownEncoderBlock2D"] * levels,
        "up_block_types": ["UpDecoderBlock2D"] * levels,
        "latent_channels": shapes[VAE + "post_quant_conv.weight"][0],
        "scaling_factor": 0.18215,
    }


def text_config(shapes: Shapes) -> dict[str, Any]:
    """Return transformers' config of the text encoder. Raises KeyError for a tensor that is missing."""
    second = CLIP_2 + "token_embedding.weight" in shapes
    prefix = CLIP_2 if second else CLIP_1
    table = prefix + ("token_embedding.weight" if second else "embeddings.token_embedding.weight")
    inner = "transformer.resblocks.0.mlp.c_fc.weight" if second else "encoder.layers.0.mlp.fc1.weight"
    pattern = rf"{re.escape(prefix)}(?:transformer\.resblocks|encoder\.layers)\.(\d+)\."
    layers = {int(match[1]) for key in shapes if (match := re.match(pattern, key))}
    vocabulary, width = shapes[table]
    positions = prefix + ("positional_embedding" if second else "embeddings.position_embedding.weight")
    return {
        "vocab_size": vocabulary,
        "hidden_size": width,
        "max_position_embeddings": shapes[positions][0],
        "intermediate_size": shapes[prefix + inner][0],
        # Stable Diffusion 2 reads the last layer but one.
        "num_hidden_layers": len(layers) - second,
        "num_attention_heads": max(1, width // 64),
        "hidden_act": "gelu" if second else "quick_gelu",
        "bos_token_id": vocabulary - 2,
        "eos_token_id": vocabulary - 1,
        "pad_token_id": 0 if second else vocabulary - 1,
    }


def _load_text_encoder(path: Path, config: Mapping[str, Any], second: bool) -> Any:
    model = CLIPTextModel(CLIPTextConfig(**config))
    prefix = CLIP_2 if second else CLIP_1
    with open_weights(path) as tensors:
        names = [name for name in tensors.keys() if name.startswith(prefix)]  # noqa: SIM118 (no mapping)
        found = {name.removeprefix(prefix): tensors.get_tensor(name).float() for name in names}
    if second:
        found = open_clip_names(found, config["num_hidden_layers"])
    wanted = model.state_dict()
    level = "text_model." if any(name.startswith("text_model.") for name in wanted) else ""
    # The positions 0, 1, 2, ... are a buffer that older versions saved.
    state = {level + name: value for name, value in found.items() if not name.endswith("position_ids")}
    missing, unexpected = model.load_state_dict(state, strict=False)
    missing = [name for name in missing if not name.endswith("position_ids")]
    if missing or unexpected:
        raise InputError(
            f"{path}: the text encoder has {(missing + unexpected)[:3]} against expectation; "
            "expected CLIP's layout"
        )
    return model.eval()


def open_clip_names(found: Mapping[str, torch.Tensor], layers: int) -> dict[str, torch.Tensor]:
    """Return an OpenCLIP text encoder's first `layers` layers under transformers' names."""
    state = {
        "embeddings.token_embedding.weight": found["token_embedding.weight"],
        "embeddings.position_embedding.weight": found["positional_embedding"],
        **{f"final_layer_norm.{kind}": found[f"ln_final.{kind}"] for kind in ("weight", "bias")},
    }
    renamed = {"ln_1": "layer_norm1", "ln_2": "layer_norm2", "attn.out_proj": "self_attn.out_proj",
               "mlp.c_fc": "mlp.fc1", "mlp.c_proj": "mlp.fc2"}  # fmt: skip
    for layer in range(layers):
        old, new = f"transformer.resblocks.{layer}", f"encoder.layers.{layer}"
        for kind in ("weight", "bias"):
            state |= {f"{new}.{b}.{kind}": found[f"{old}.{a}.{kind}"] for a, b in renamed.items()}
            parts = found[f"{old}.attn.in_proj_{kind}"].chunk(3)
            state |= {f"{new}.self_attn.{p}_proj.{kind}": x for p, x in zip("qkv", parts, strict=True)}
    return state


def _refuse_others(path: Path, shapes: Shapes) -> None:
    for prefix, reason in OTHERS.items():
        if any(name.startswith(prefix) for name in shapes):
            raise InputError(f"{path}: not supported, because {reason}")
    first = shapes.get(UNET + "input_blocks.0.0.weight")
    if first and first[1] != 4:
        raise InputError(
            f"{path}: not supported, because its UNet takes {first[1]} channels (inpainting, depth, "
            "upscaling or editing), expected 4"
        )


def _said_prediction(path: Path) -> str:
    """Return what the metadata (Stability's ModelSpec) says the network predicts, "" where it is silent."""
    with open_weights(path) as tensors:
        said = (tensors.metadata() or {}).get("modelspec.prediction_type", "")
    return {"epsilon": "epsilon", "v": "v_prediction", "v_prediction": "v_prediction"}.get(said, "")
