"""Write the files of a bundle that are not graphs, and its checksums last.

Order: graphs by `export_graph`, then `write_configs` and `write_tokenizer`, then `write_bundle_json`,
which hashes all that is there. A folder without bundle.json was not finished.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tokenizers import Tokenizer, models, trainers

from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.tokenizer import BEGIN, END, split_words
from pipeline.files import file_sha256

PROSE = (".md", ".png")  # a model card may be improved without the model becoming another one
GRAPH_CLASSES = {
    "text_encoder": "CLIPTextModel",
    "unet": "UNet2DConditionModel",
    "vae_decoder": "AutoencoderKL",
    "vae_encoder": "AutoencoderKL",
    "vae_encoder_vjp": "AutoencoderKL",
}


def write_json(path: Path, value: Mapping[str, Any]) -> None:
    """Write `value` as JSON a person can read, in the order given."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value, indent=2, ensure_ascii=False) + "\n", "utf-8")


def write_configs(
    folder: Path,
    *,
    latent_size: int,
    latent_channels: int,
    latent_scale: float,
    downsampling: int,
    scheduler: Mapping[str, Any],
) -> None:
    """Write model_index.json, the scheduler's config and the config.json of the graphs that are there.

    `latent_size`: side of the training latents, pixels. `downsampling`: image pixels a latent pixel, a
    power of two. `scheduler`: diffusers' keys (num_train_timesteps, beta_start, beta_end, beta_schedule,
    prediction_type, ...).
    """
    halvings = downsampling.bit_length() - 1
    if 2**halvings != downsampling:
        raise ValueError(f"downsampling is {downsampling}, expected a power of two")
    write_json(folder / "scheduler" / "scheduler_config.json", {"_class_name": "DDIMScheduler", **scheduler})
    vae = {
        "latent_channels": latent_channels,
        "scaling_factor": latent_scale,
        "sample_size": latent_size * downsampling,
        # Readers take the downsampling from the number of blocks.
        "block_out_channels": [64] * (halvings + 1),
    }
    unet = {"sample_size": latent_size, "in_channels": latent_channels, "out_channels": latent_channels}
    graphs = [name for name in GRAPH_CLASSES if (folder / name / "model.onnx").is_file()]
    for name in graphs:
        config = unet if name == "unet" else vae if name.startswith("vae") else {}
        write_json(folder / name / "config.json", {"_class_name": GRAPH_CLASSES[name], **config})
    components = {name: ["diffusers", "OnnxRuntimeModel"] for name in graphs}
    components |= {
        "tokenizer": ["transformers", "CLIPTokenizer"],
        "scheduler": ["diffusers", "DDIMScheduler"],
    }
    write_json(folder / "model_index.json", {"_class_name": "OnnxStableDiffusionPipeline", **components})


def train_tokenizer(folder: Path, captions: Iterable[str], *, vocabulary_size: int, max_length: int) -> None:
    """Learn a byte-pair tokenizer in CLIP's format from `captions` and write it to `folder`.

    Every byte stays in the vocabulary, so any text encodes. `max_length`: tokens a text, with the begin
    and end tokens. The smallest vocabulary is 514: 256 bytes, 256 bytes at the end of a word, 2 tokens.
    """
    if vocabulary_size < 514:
        raise ValueError(f"vocabulary_size is {vocabulary_size}, expected at least 514")
    normalizer, splitter = split_words()
    learner = Tokenizer(models.BPE(end_of_word_suffix="</w>"))
    learner.normalizer, learner.pre_tokenizer = normalizer, splitter
    trainer = trainers.BpeTrainer(
        vocab_size=vocabulary_size,
        initial_alphabet=bytes_alphabet(),
        # Only to give the word-final bytes fixed numbers: the trainer numbers unknown ones in random order
        # and breaks ties between merges by number.
        special_tokens=[byte + "</w>" for byte in bytes_alphabet()],
        end_of_word_suffix="</w>",
        show_progress=False,
    )
    learner.train_from_iterator(captions, trainer)
    merges = [(first, second) for first, second in json.loads(learner.to_str())["model"]["merges"]]
    write_tokenizer(folder, merges[: vocabulary_size - 514], max_length=max_length)


def write_tokenizer(
    folder: Path, merges: Iterable[tuple[str, str]], *, max_length: int, pad: str = END
) -> None:
    """Write vocab.json, merges.txt and the two configs for `merges`, ids in CLIP's order.

    CLIP's order: the 256 bytes, the same at the end of a word, one token a merge, begin, end.
    """
    merges = list(merges)
    alphabet = bytes_alphabet()
    tokens = [
        *alphabet,
        *(byte + "</w>" for byte in alphabet),
        *("".join(pair) for pair in merges),
        BEGIN,
        END,
    ]
    tokens = list(dict.fromkeys(tokens))
    write_json(folder / "vocab.json", {token: index for index, token in enumerate(tokens)})
    lines = ["#version: 0.2", *(" ".join(pair) for pair in merges)]
    (folder / "merges.txt").write_text("\n".join(lines) + "\n", "utf-8")
    special = {"bos_token": BEGIN, "eos_token": END, "unk_token": END, "pad_token": pad}
    write_json(folder / "special_tokens_map.json", special)
    config = {
        "tokenizer_class": "CLIPTokenizer",
        "model_max_length": max_length,
        "do_lower_case": True,
        **special,
    }
    write_json(folder / "tokenizer_config.json", config)


def bytes_alphabet() -> list[str]:
    """Return the 256 printable characters that stand for the bytes, in GPT-2's (and CLIP's) order."""
    printable = [*range(ord("!"), ord("~") + 1), *range(0xA1, 0xAD), *range(0xAE, 0x100)]
    others = [byte for byte in range(256) if byte not in printable]
    return [chr(byte) for byte in printable] + [chr(256 + index) for index in range(len(others))]


def write_bundle_json(folder: Path, description: Mapping[str, Any]) -> None:
    """Write bundle.json with the checksums of all files that are there, and open the bundle as a check.

    `description`: the keys of bundle.json but `format` and `files` (name, image_size, latent_size,
    latent_channels, latent_scale, view_prompts, distillation, known_words, latent_to_rgb, ...).
    """
    place = folder / "bundle.json"
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p != place and p.suffix not in PROSE)
    checksums = {path.relative_to(folder).as_posix(): file_sha256(path) for path in files}
    write_json(place, {"format": 1, **description, "files": checksums})
    open_bundle(folder)
