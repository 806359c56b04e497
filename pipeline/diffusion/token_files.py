"""Files of learned embeddings (textual inversion); nothing in a file executes.

Formats, one file a concept, n x d numbers being n tokens of width d:
- diffusers: `learned_embeds.safetensors` or `.bin` (torch), {placeholder: tensor (d,) or (n, d)};
- AUTOMATIC1111: `.safetensors` with `emb_params`; `.pt` (torch) with `string_to_param` {"*": tensor} and
  `name`.
"""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_safetensors

from pipeline.diffusion.token_checks import check_token
from pipeline.diffusion.tokens import ANY, LearnedToken
from pipeline.errors import InputError
from pipeline.options.schema import short

MOST_VECTORS = 75
"""More tokens do not fit into CLIP's window."""
MOST_WIDTH = 65_536
"""Of an embedding: the widest text encoders have 4,096."""


def read_token(path: Path) -> LearnedToken:
    """Read a concept.

    Raises:
        InputError: not one of the formats, damaged, objects instead of numbers, several tensors, no finite
            numbers, too many tokens.
    """
    check_token(path)
    values = _safetensors(path) if path.suffix.lower() == ".safetensors" else _torch_file(path)
    name, tensor = _concept(path, values)
    if tensor.layout != torch.strided or tensor.is_quantized or tensor.is_complex() or tensor.is_meta:
        raise InputError(
            f"TOKEN {path}: a tensor of {tensor.dtype}, {tensor.layout}, on {tensor.device}, expected plain "
            "floats; learn it again"
        )
    count, width = (1, *tensor.shape) if tensor.ndim == 1 else tensor.shape if tensor.ndim == 2 else (0, 0)
    if not 1 <= count <= MOST_VECTORS or not 1 <= width <= MOST_WIDTH:
        raise InputError(
            f"TOKEN {path}: an array of shape {tuple(tensor.shape)}, expected 1 to {MOST_VECTORS} embeddings"
        )
    vectors = np.ascontiguousarray(tensor.detach().to(torch.float32).numpy().reshape(count, width))
    if not np.isfinite(vectors).all():
        raise InputError(f"TOKEN {path}: holds NaN or infinity, expected finite numbers; learn it again")
    names = dict.fromkeys(text for text in (name, path.stem) if text.strip() and text != ANY)
    return LearnedToken(path, tuple(names), vectors)


def _safetensors(path: Path) -> dict[str, Any]:
    try:
        return dict(load_safetensors(path.read_bytes()))
    except (SafetensorError, ValueError, KeyError, RuntimeError) as error:
        raise InputError(
            f"TOKEN {path}: no readable safetensors file ({_line(error)}); copy it again"
        ) from None


def _torch_file(path: Path) -> dict[str, Any]:
    try:
        # Old files wrap their tensors in a ParameterDict, a plain container.
        with torch.serialization.safe_globals([torch.nn.ParameterDict]), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            values = torch.load(
                path, map_location="cpu", weights_only=True
            )  # pickles that execute are refused
    except pickle.UnpicklingError as error:
        raise InputError(
            f"TOKEN {path}: holds more than numbers, or is damaged ({_line(error)}); objects are never "
            "loaded: use a .safetensors file"
        ) from None
    except Exception as error:  # torch's reader raises nothing more precise for damaged files
        raise InputError(f"TOKEN {path}: no readable torch file ({_line(error)}); copy it again") from None
    if not isinstance(values, Mapping):
        raise InputError(f"TOKEN {path}: holds a {type(values).__name__}, expected a table of embeddings")
    return dict(values)


def _concept(path: Path, values: Mapping[str, Any]) -> tuple[str, torch.Tensor]:
    """Return a concept's own name ("" where the format has none) and its tensor."""
    inner = values.get("string_to_param")
    if isinstance(inner, (Mapping, torch.nn.ParameterDict)):
        name = values.get("name")
        found = {str(name) if isinstance(name, str) else "": tensor for tensor in inner.values()}
        count = len(inner)
    elif "emb_params" in values:
        found, count = {"": values["emb_params"]}, 1
    else:
        found, count = {str(k): v for k, v in values.items()}, len(values)
    if count != 1 or not all(isinstance(tensor, torch.Tensor) for tensor in found.values()):
        shown = ", ".join(short(name) for name in list(values)[:5])
        raise InputError(
            f"TOKEN {path}: holds {count} entries ({shown}), expected one learned embedding for one encoder"
        )
    ((name, tensor),) = found.items()
    return name, tensor


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
