"""A checkpoint of Stable Diffusion's class to a bundle under onnx_models/: `make export`.

Everything is written to a hidden folder beside the bundle's place, graph after graph, each compared with
torch; the last act is to give that folder its name. So an export that fails or is stopped leaves no bundle.
"""

from __future__ import annotations

import gc
import os
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from export.bundle_files import write_bundle_json, write_configs
from export.checkpoint import Checkpoint
from export.text_encoder import export_text_encoder
from export.unet import export_unet
from export.vae import downsampling, export_decoder, export_encoder, export_vjp
from pipeline.errors import InputError
from pipeline.progress import say

TOLERANCE = 1e-4
"""Largest |onnx - torch| of a graph, relative to its largest output."""


@dataclass(frozen=True)
class ExportOptions:
    """How the graphs are written."""

    half_weights: bool = False
    """Store weights as fp16; they are computed in fp32 all the same."""
    fixed: bool = False
    """Fix batch and size to those of training."""
    vjp: bool = True
    """The encoder's input gradient too, which refinement in RGB needs."""


@dataclass(frozen=True)
class Cost:
    """What an export takes."""

    memory_gb: float
    disk_gb: float
    minutes: float


def export_cost(checkpoint: Checkpoint, options: ExportOptions) -> Cost:
    """Return what an export takes, beforehand: a constant and a rate a parameter.

    Peak memory is the largest network twice, in torch and in onnxruntime; another copy is rounded to fp16.
    """
    largest = 4e-9 * max(checkpoint.parameters.values())
    total = sum(checkpoint.parameters.values())
    memory = 1.0 + largest * (3.0 if options.half_weights else 2.0)
    # The gradient at 512 x 512 holds every activation of the encoder.
    memory = max(memory, 6.0) if options.vjp and checkpoint.parameters["vae"] > 2e7 else memory
    return Cost(memory, (2e-9 if options.half_weights else 4e-9) * total * 1.1, 1.0 + 3e-9 * total)


def install_checkpoint(checkpoint: Checkpoint, folder: Path, options: ExportOptions) -> dict[str, float]:
    """Export to `folder`, which must not exist; return every graph's largest difference from torch.

    Raises:
        InputError: the folder exists, its name is no plain name, the disk is too full.
        ValueError: a graph differs from torch by more than TOLERANCE.
    """
    name = folder.name
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}", name):
        raise InputError(f"NAME is {name!r}, expected letters, digits, dots, dashes and underscores")
    if folder.exists():
        raise InputError(f"{folder} exists: choose another NAME, or remove it first")
    folder.parent.mkdir(parents=True, exist_ok=True)
    cost = export_cost(checkpoint, options)
    free = shutil.disk_usage(folder.parent).free / 1e9
    if free < cost.disk_gb:
        raise InputError(
            f"{folder.parent} has {free:.1f} GB of disk left, the bundle needs {cost.disk_gb:.1f} GB"
        )
    say(
        f"exporting {checkpoint.path} to {folder}: about {cost.memory_gb:.1f} GB of memory, "
        f"{cost.disk_gb:.1f} GB of disk, {cost.minutes:.0f} min"
    )
    for leftover in folder.parent.glob(f".{name}.export-*"):  # of an export that was killed
        shutil.rmtree(leftover)
    scratch = folder.parent / f".{name}.export-{os.getpid()}"
    try:
        differences = _write_bundle(checkpoint, scratch, name, options)
        os.replace(scratch, folder)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return differences


def _write_bundle(
    checkpoint: Checkpoint, folder: Path, name: str, options: ExportOptions
) -> dict[str, float]:
    """Write a whole bundle; each network is loaded when its turn comes, and released after it."""
    differences: dict[str, float] = {}
    half: dict[str, Any] = {"half_weights": options.half_weights, "tolerance": TOLERANCE}
    shape: dict[str, Any] = {**half, "fixed": options.fixed}

    def write(graph: str, export: Callable[[Path], float]) -> None:
        differences[graph] = export(folder / graph)
        say(f"{graph}: largest difference from torch {differences[graph]:.1e}, tolerance {TOLERANCE:.0e}")
        gc.collect()

    checkpoint.write_tokenizer(folder / "tokenizer")
    text_encoder = checkpoint.text_encoder()
    length = text_encoder.config.max_position_embeddings
    write(
        "text_encoder", lambda place: export_text_encoder(text_encoder, length, place, **half, release=True)
    )
    del text_encoder

    unet = checkpoint.unet()
    latent_size = int(unet.config.sample_size)
    write("unet", lambda place: export_unet(unet, length, place, **shape, release=True))
    del unet

    vae = checkpoint.vae()
    factor = downsampling(vae)
    image_size = latent_size * factor
    write("vae_decoder", lambda place: export_decoder(vae, latent_size, place, **shape))
    write("vae_encoder", lambda place: export_encoder(vae, image_size, place, **shape))
    if options.vjp:
        write("vae_encoder_vjp", lambda place: export_vjp(vae, image_size, place, **half))
    channels, scale = int(vae.config.latent_channels), float(vae.config.scaling_factor)
    write_configs(
        folder, latent_size=latent_size, latent_channels=channels, latent_scale=scale, downsampling=factor,
        scheduler=checkpoint.scheduler,
    )  # fmt: skip
    write_bundle_json(folder, _description(name, latent_size, image_size, channels, scale, differences))
    return differences


def _description(
    name: str,
    latent_size: int,
    image_size: int,
    channels: int,
    scale: float,
    differences: Mapping[str, float],
) -> dict[str, Any]:
    return {
        "name": name,
        "image_size": image_size,
        "latent_size": latent_size,
        "latent_channels": channels,
        "latent_scale": scale,
        "view_prompts": "paper",
        "onnx_max_diff": {graph: float(f"{value:.2e}") for graph, value in differences.items()},
        "onnx_tolerance": TOLERANCE,
    }
