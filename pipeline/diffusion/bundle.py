"""A model bundle: a folder in Hugging Face Optimum's layout, and what it says about itself.

    model_index.json  {text_encoder,unet,vae_decoder[,vae_encoder]}/model.onnx [+ config.json]
    tokenizer/{vocab.json,merges.txt,...}  scheduler/scheduler_config.json  [bundle.json]

`bundle.json` is this project's addition; a foreign folder lacks it and gets Stable Diffusion's values.
Everything that can be wrong with the files is found here, before a network is opened, and named in
one line. Importing this module is cheap: no onnxruntime, no torch.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

from pipeline import documents
from pipeline.diffusion.onnx_file import OnnxFile, check_external, read_onnx
from pipeline.errors import InputError
from pipeline.files import file_sha256
from pipeline.options.schema import short

T = TypeVar("T")

STABLE_DIFFUSION_SCALE = 0.18215
STABLE_DIFFUSION_LATENTS = 64
VIEW_PROMPTS = ("paper", "eight")
CAMERA_COLUMNS = ("camera_told", "azimuth", "polar", "distance", "fov", "backdrop_told", "backdrop")
"""What a denoiser's camera input may hold, see `conditions.camera_rows`."""
MOST_VIEWS = 64
"""That a denoiser may see together."""
REQUIRED_GRAPHS = ("text_encoder", "unet", "vae_decoder")
OPTIONAL_GRAPHS = ("vae_encoder", "vae_encoder_vjp")
# onnxruntime's transformer optimiser writes these for CUDA and ROCm; no CPU kernel exists.
GPU_ONLY = {
    "GroupNorm",
    "SkipGroupNorm",
    "NhwcConv",
    "BiasSplitGelu",
    "BiasAdd",
    "NhwcFusedConv",
    "PackedAttention",
}
STANDARD_DOMAINS = {"", "ai.onnx", "ai.onnx.ml", "com.microsoft", "com.microsoft.nchwc", "ai.onnx.training"}


@dataclass(frozen=True)
class Bundle:
    """What a bundle is: sizes in pixels, its prompts, and its recommended training options."""

    path: Path
    name: str
    image_size: int
    """Side of a decoded image, pixels."""
    latent_size: int
    """Side of a latent image, latent pixels."""
    latent_channels: int
    latent_scale: float
    """Latents outside the graphs are the VAE's own times this."""
    view_prompts: str
    """Which words describe a view: "paper" (five) or "eight" (azimuth sectors), see prompts.py."""
    distillation: dict[str, Any]
    """Values of `TrainNerf` that suit this model better than the defaults."""
    known_words: frozenset[str] | None
    """Words of its training captions; None when any text will do."""
    latent_to_rgb: tuple[tuple[float, ...], ...] | None
    """3 x c matrix A of the linear map from scaled latents z to colour, RGB = (A z + bias + 1) / 2."""
    latent_to_rgb_bias: tuple[float, ...]
    camera: tuple[str, ...]
    """Columns of the denoiser's input `camera`, of CAMERA_COLUMNS; none: it has no such input."""
    views: int
    """How many views of one object, in consecutive rows, the denoiser sees together; 1: each on its own."""
    trained_on: Any
    has_vae_encoder: bool
    files: dict[str, str]
    """sha256 of every file by its path inside the bundle; empty in a foreign folder."""

    def linear_rgb(self, latents: Float[np.ndarray, "b c h w"]) -> Float[np.ndarray, "b h w 3"] | None:
        """Return the colours in [0, 1] that the linear map sees in scaled latents; None without a map.

        The paper's quick look at latents (its equation of the 3 x 4 matrix): no decoder runs.
        """
        if self.latent_to_rgb is None:
            return None
        colours = np.einsum("rc,bchw->bhwr", np.array(self.latent_to_rgb), latents)
        return np.clip((colours + np.array(self.latent_to_rgb_bias) + 1) / 2, 0, 1).astype(np.float32)


def open_bundle(folder: Path, *, verify: bool = True) -> Bundle:
    """Return the description of the bundle in `folder` after checking its files.

    Checked: every needed file is there and not empty; models are whole ONNX files that a CPU can run
    with all their external weights; with `verify`, the checksums in bundle.json. Raises InputError
    with one line: the file, what was found, what was expected, what to do.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such model folder; see the folders in {folder.parent} or export one")
    described = read_json(folder / "bundle.json") if (folder / "bundle.json").exists() else {}
    files = _field(folder, described, "files", dict, {})
    graphs = [*REQUIRED_GRAPHS, *(name for name in OPTIONAL_GRAPHS if _is_listed(folder, name, files))]
    for relative in files:
        _check_relative(folder, relative)
    if verify:
        _verify_checksums(folder, files)
    for name in graphs:
        check_graph(folder / name)
    _check_tokenizer(folder / "tokenizer")
    read_json(folder / "scheduler" / "scheduler_config.json")
    return _describe(folder, described, files, graphs)


def _is_listed(folder: Path, graph: str, files: dict[str, str]) -> bool:
    return (folder / graph).is_dir() or f"{graph}/model.onnx" in files


def _check_relative(folder: Path, relative: str) -> None:
    path = Path(relative)
    if path.is_absolute() or ".." in path.parts:
        raise InputError(
            f"{folder / 'bundle.json'}: lists the file {relative!r}, expected a path inside the bundle"
        )


def _verify_checksums(folder: Path, files: dict[str, str]) -> None:
    for relative, expected in files.items():
        path = folder / relative
        if not path.is_file():
            raise InputError(f"{path}: missing, listed in bundle.json; copy the bundle again")
        if file_sha256(path) != expected:
            raise InputError(
                f"{path}: {path.stat().st_size} bytes that differ from the checksum in bundle.json "
                "(truncated or changed); copy the bundle again"
            )


def read_json(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file of a bundle; raises InputError as `documents.read_json`."""
    return documents.read_json(path, "copy or export the bundle again")


def training_light(description: Path | None) -> tuple[float, float, float] | None:
    """Return the unit vector towards the one light of all pictures that a model was trained on, from
    bundle.json; None where there was no such light, or no file says so."""
    described = read_json(description) if description else {}
    if described.get("light") is None or description is None:
        return None
    x, y, z = _numbers(description, described, "light", (3,))
    length = (x * x + y * y + z * z) ** 0.5
    if not 0.99 < length < 1.01:
        raise InputError(f"{description}: light has length {length:.3g}, expected 1; export again")
    return x, y, z


def check_graph(folder: Path) -> OnnxFile:
    """Return the outline of `folder/model.onnx`; raises InputError when it cannot work on a CPU.

    Missing, empty, truncated, a pointer or a page instead of a model, external weights missing or
    outside the folder, operators that exist only on a GPU or nowhere.
    """
    path = folder / "model.onnx"
    if not path.is_file():
        raise InputError(
            f"{path}: missing, expected the ONNX graph of {folder.name}; copy or export the bundle again"
        )
    model = read_onnx(path)
    check_external(model)
    gpu = sorted(name for domain, name in model.operators if domain == "com.microsoft" and name in GPU_ONLY)
    if gpu:
        raise InputError(
            f"{path}: optimised for a GPU (operators {', '.join(gpu)}), expected plain ONNX; export the "
            "checkpoint again without onnxruntime's GPU optimisation"
        )
    foreign = {pair for pair in model.operators - model.functions if pair[0] not in STANDARD_DOMAINS}
    if foreign:
        names = ", ".join(sorted(f"{domain}::{name}" for domain, name in foreign)[:5])
        raise InputError(
            f"{path}: uses the custom operator(s) {names}, expected standard ones; custom code is "
            "never loaded, export the model without it"
        )
    return model


def _check_tokenizer(folder: Path) -> None:
    whole = folder / "tokenizer.json"
    for name in ("vocab.json", "merges.txt"):
        path = folder / name
        if not path.is_file() and not whole.is_file():
            raise InputError(
                f"{path}: missing, expected the tokenizer's {path.stem}; copy or export the bundle again"
            )
        if path.is_file() and path.stat().st_size == 0:
            raise InputError(f"{path}: 0 bytes, expected the tokenizer's {path.stem}; copy the bundle again")


def graph_config(folder: Path) -> dict[str, Any]:
    """Return the config.json beside a graph, {} where the exporter wrote none."""
    return read_json(folder / "config.json") if (folder / "config.json").exists() else {}


def graph_scale(folder: Path) -> float:
    """Return the latent scale of a VAE folder: config.json's `scaling_factor`, else Stable Diffusion's."""
    return _field(folder, graph_config(folder), "scaling_factor", float, STABLE_DIFFUSION_SCALE)


def latent_size(unet_folder: Path) -> int:
    """Return the side of the latents the network was trained at: config.json's `sample_size`, else 64."""
    return _field(unet_folder, graph_config(unet_folder), "sample_size", int, STABLE_DIFFUSION_LATENTS)


def _field(place: Path, values: dict[str, Any], key: str, kind: type[T], default: T) -> T:
    """Return values[key] (default where absent) as a `kind`; numbers must be positive, below a million."""
    value: Any = values.get(key, default)
    if kind is float and type(value) is int:
        value = float(value)
    out_of_range = isinstance(value, (int, float)) and not 0 < value < 1e6
    if type(value) is not kind or out_of_range:
        wanted = f"positive {kind.__name__}" if kind in (int, float) else kind.__name__
        raise InputError(f"{place}: {key} is {short(value)}, expected a {wanted}; correct it or export again")
    return value


def _numbers(place: Path, values: dict[str, Any], key: str, shape: tuple[int, ...]) -> Any:
    """Return values[key] as nested tuples of finite floats of that shape."""
    try:
        array = np.array(values[key], np.float64)
    except (KeyError, TypeError, ValueError):
        array = np.zeros(0)
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"{place}: {key}, expected {' x '.join(map(str, shape))} numbers; export again")
    return tuple(map(tuple, array.tolist())) if len(shape) > 1 else tuple(array.tolist())


def _describe(folder: Path, described: dict[str, Any], files: dict[str, str], graphs: list[str]) -> Bundle:
    place = folder / "bundle.json"
    size = _field(place, described, "latent_size", int, latent_size(folder / "unet"))
    blocks = graph_config(folder / "vae_decoder").get("block_out_channels", [0] * 4)
    scale = graph_scale(folder / "vae_decoder")
    if (said := _field(place, described, "latent_scale", float, scale)) != scale:
        raise InputError(
            f"{place}: latent_scale is {said}, vae_decoder/config.json says {scale}; make them agree"
        )
    view_prompts = _field(place, described, "view_prompts", str, "paper")
    if view_prompts not in VIEW_PROMPTS:
        raise InputError(
            f"{place}: view_prompts is {view_prompts!r}, expected one of {', '.join(VIEW_PROMPTS)}"
        )
    channels = _field(place, described, "latent_channels", int, 4)
    has_map = described.get("latent_to_rgb") is not None
    columns = _field(place, described, "camera", list, [])
    if unknown := [c for c in columns if c not in CAMERA_COLUMNS]:
        raise InputError(
            f"{place}: camera lists {short(unknown[0])}, expected of {', '.join(CAMERA_COLUMNS)}; "
            "export again"
            "export again"
        )
    views = _field(place, described, "views", int, 1)
    if views > MOST_VIEWS:
        raise InputError(f"{place}: views is {views}, expected 1 to {MOST_VIEWS}; export again")
    words = described.get("known_words")
    if words is not None and not (isinstance(words, list) and all(isinstance(w, str) for w in words)):
        raise InputError(f"{place}: known_words is no list of words; correct it or export again")
    return Bundle(
        path=folder,
        name=_field(place, described, "name", str, folder.name),
        image_size=_field(place, described, "image_size", int, size * 2 ** (len(blocks) - 1)),
        latent_size=size,
        latent_channels=channels,
        latent_scale=scale,
        view_prompts=view_prompts,
        distillation=_field(place, described, "distillation", dict, {}),
        known_words=None if words is None else frozenset(words),
        latent_to_rgb=_numbers(place, described, "latent_to_rgb", (3, channels)) if has_map else None,
        latent_to_rgb_bias=_numbers(place, described, "latent_to_rgb_bias", (3,))
        if has_map
        else (0.0, 0.0, 0.0),
        camera=tuple(columns),
        views=views,
        trained_on=described.get("trained_on", ""),
        has_vae_encoder="vae_encoder" in graphs,
        files=files,
    )
