"""Single .safetensors files in the original layout: sizes from shapes, weights under the right names."""

import re
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import save_file
from torch import Tensor

from export.single_file import open_single_file
from pipeline.errors import InputError
from tests.tiny_diffusers import tiny_text_encoder, tiny_unet, tiny_vae

LAYERS, LEVELS = 1, 2  # of the tiny networks
INNER = {
    "norm1": "in_layers.0", "conv1": "in_layers.2", "time_emb_proj": "emb_layers.1", "norm2": "out_layers.0",
    "conv2": "out_layers.3", "conv_shortcut": "skip_connection",
}  # fmt: skip
OUTER = {
    "time_embedding.linear_1": "time_embed.0", "time_embedding.linear_2": "time_embed.2",
    "conv_in": "input_blocks.0.0", "conv_norm_out": "out.0", "conv_out": "out.2",
}  # fmt: skip


def original_unet_name(name: str) -> str:
    """CompVis' name of a diffusers UNet's tensor: blocks in one row, three parts a block."""
    stride = LAYERS + 1
    for new, old in OUTER.items():
        if name.startswith(new + "."):
            return name.replace(new, old, 1)
    name = re.sub(
        r"(resnets\.\d+)\.(\w+)\.", lambda match: f"{match[1]}.{INNER.get(match[2], match[2])}.", name
    )

    def place(match: re.Match[str]) -> str:
        side, level, kind, index = match[1], int(match[2]), match[3], int(match[4])
        if side == "down":
            at = 1 + level * stride + (index if kind != "downsamplers" else LAYERS)
            return f"input_blocks.{at}." + {"resnets": "0", "attentions": "1", "downsamplers": "0"}[kind]
        at = level * stride + (index if kind != "upsamplers" else LAYERS)
        part = {"resnets": "0", "attentions": "1", "upsamplers": "1"}[
            kind
        ]  # the tiny one's first level: plain
        return f"output_blocks.{at}.{part}"

    name = re.sub(
        r"(down|up)_blocks\.(\d+)\.(resnets|attentions|downsamplers|upsamplers)\.(\d+)", place, name
    )
    name = re.sub(r"(input_blocks\.\d+\.0)\.conv\.", r"\1.op.", name)
    middle = {"resnets.0": "0", "attentions.0": "1", "resnets.1": "2"}
    return re.sub(r"mid_block\.(\w+\.\d)", lambda match: f"middle_block.{middle[match[1]]}", name)


def original_vae_name(name: str) -> str:
    name = re.sub(r"decoder\.up_blocks\.(\d+)", lambda m: f"decoder.up.{LEVELS - 1 - int(m[1])}", name)
    name = re.sub(r"encoder\.down_blocks", "encoder.down", name)
    name = re.sub(r"mid_block\.resnets\.(\d)", lambda m: f"mid.block_{int(m[1]) + 1}", name)
    for new, old in {
        "mid_block.attentions.0": "mid.attn_1", "group_norm": "norm", "to_q": "q", "to_k": "k", "to_v": "v",
        "to_out.0": "proj_out", "downsamplers.0": "downsample", "upsamplers.0": "upsample",
        "resnets": "block",
        "conv_norm_out": "norm_out", "conv_shortcut": "nin_shortcut",
    }.items():  # fmt: skip
        name = name.replace(new, old)
    return name


def original(unet: Any, vae: Any, text: Any) -> dict[str, Tensor]:
    """A checkpoint of Stable Diffusion 1.x in its first layout."""
    state = {f"model.diffusion_model.{original_unet_name(k)}": v for k, v in unet.state_dict().items()}
    for name, value in vae.state_dict().items():
        old = original_vae_name(name)
        is_projection = "attn_1" in old and value.ndim == 2  # linear layers were 1 x 1 convolutions
        state[f"first_stage_model.{old}"] = value[:, :, None, None] if is_projection else value
    for name, value in text.state_dict().items():
        state[f"cond_stage_model.transformer.text_model.{name.removeprefix('text_model.')}"] = value
    return {name: value.contiguous() for name, value in state.items()}


def same(found: Any, expected: Any) -> None:
    wanted = expected.state_dict()
    assert found.state_dict().keys() == wanted.keys()
    for name, value in found.state_dict().items():
        assert torch.equal(value, wanted[name]), name


def test_every_weight_arrives_and_the_network_computes_the_same(tmp_path: Path) -> None:
    unet, vae, text = tiny_unet(), tiny_vae(), tiny_text_encoder()
    save_file(original(unet, vae, text), tmp_path / "sd.safetensors")
    checkpoint = open_single_file(tmp_path / "sd.safetensors")
    found = checkpoint.unet()
    same(found, unet)
    same(checkpoint.vae(), vae)
    same(checkpoint.text_encoder(), text)
    assert checkpoint.scheduler["prediction_type"] == "epsilon"
    assert checkpoint.parameters["unet"] == sum(p.numel() for p in unet.parameters())
    sample, told = torch.randn(1, 4, 8, 8), torch.randn(1, 5, 32)
    with torch.no_grad():  # the number of heads stands in no weight
        assert torch.equal(found(sample, 3, told).sample, unet(sample, 3, told).sample)


def second_version(text: Any, layers: int) -> dict[str, Tensor]:
    """OpenCLIP's layout of a text encoder, with one more layer than Stable Diffusion 2 reads."""
    old = {name.removeprefix("text_model."): value for name, value in text.state_dict().items()}
    state = {
        "token_embedding.weight": old["embeddings.token_embedding.weight"],
        "positional_embedding": old["embeddings.position_embedding.weight"],
        "ln_final.weight": old["final_layer_norm.weight"],
        "ln_final.bias": old["final_layer_norm.bias"],
    }
    for layer in range(layers + 1):
        here, there = f"encoder.layers.{min(layer, layers - 1)}", f"transformer.resblocks.{layer}"
        for kind in ("weight", "bias"):
            parts = [old[f"{here}.self_attn.{part}_proj.{kind}"] for part in "qkv"]
            state[f"{there}.attn.in_proj_{kind}"] = torch.cat(parts)
            for new, name in {
                "self_attn.out_proj": "attn.out_proj", "layer_norm1": "ln_1", "layer_norm2": "ln_2",
                "mlp.fc1": "mlp.c_fc", "mlp.fc2": "mlp.c_proj",
            }.items():  # fmt: skip
                state[f"{there}.{name}.{kind}"] = old[f"{here}.{new}.{kind}"]
    return {f"cond_stage_model.model.{name}": value.clone() for name, value in state.items()}


def test_version_2_drops_a_layer_and_must_say_what_it_predicts(tmp_path: Path) -> None:
    unet = tiny_unet(use_linear_projection=True, attention_head_dim=[1, 1])
    text = tiny_text_encoder(hidden_act="gelu", pad_token_id=0)
    state = {k: v for k, v in original(unet, tiny_vae(), text).items() if not k.startswith("cond_stage")}
    state |= second_version(text, layers=2)
    path = tmp_path / "sd2.safetensors"
    save_file(state, path)
    with pytest.raises(InputError, match="does not say what it predicts: say PREDICTION=v_prediction"):
        open_single_file(path)
    checkpoint = open_single_file(path, "v_prediction")
    assert checkpoint.scheduler["prediction_type"] == "v_prediction"
    same(checkpoint.text_encoder(), text)
    assert checkpoint.text_encoder().config.hidden_act == "gelu"
    found = checkpoint.unet()
    assert (found.config.sample_size, found.config.use_linear_projection) == (96, True)
    same(found, unet)

    save_file(state, path, metadata={"modelspec.prediction_type": "epsilon"})
    assert open_single_file(path).scheduler["prediction_type"] == "epsilon"


@pytest.mark.parametrize(
    ("name", "shape", "reason"),
    [
        ("conditioner.embedders.1.model.ln_final.weight", (2,), "Stable Diffusion XL"),
        ("model.diffusion_model.joint_blocks.0.x", (2,), "Stable Diffusion 3"),
        ("double_blocks.0.img_attn.proj.weight", (2,), "Flux"),
        ("lora_unet_down_blocks_0.lora_up.weight", (2,), "a LoRA"),
        ("model.diffusion_model.input_blocks.0.0.weight", (2, 9, 3, 3), "takes 9 channels"),
        ("something.else", (2,), "lacks the tensor"),
    ],
)
def test_other_files_are_refused_with_the_reason(
    name: str, shape: tuple[int, ...], reason: str, tmp_path: Path
) -> None:
    save_file({name: torch.zeros(shape)}, tmp_path / "x.safetensors")
    with pytest.raises(InputError, match=reason):
        open_single_file(tmp_path / "x.safetensors")


def test_damaged_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x.safetensors").write_bytes(b"\x08\0\0\0\0\0\0\0{")
    with pytest.raises(InputError, match=r"9 bytes that are no \.safetensors file"):
        open_single_file(tmp_path / "x.safetensors")
