"""Where models lie: those of the clone or of the wheel, and those that the user added."""

import os
from pathlib import Path

from pipeline.errors import InputError

_CLONED, _INSTALLED = (Path(__file__).resolve().parents[level] / "onnx_models" for level in (2, 1))
MODELS = _CLONED if (_CLONED.parent / "pyproject.toml").is_file() else _INSTALLED
"""Of the clone; of an installed wheel, which carries the default model."""
DEFAULT_MODEL = "everyday-objects"


def new_models() -> Path:
    """Return the folder that exported and downloaded models go to: of the clone, or of the user where the
    program is installed (there it is nobody's to write to)."""
    if given := os.environ.get("LATENT_NERF_MODELS"):
        return Path(given).absolute()
    if MODELS == _CLONED:
        return MODELS
    data = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(data).absolute() / "latent-nerf" / "onnx_models"


def known_models(models: Path = MODELS) -> dict[str, Path]:
    """Return the folder of every model by name: those in `models`, then those of `new_models`."""
    found: dict[str, Path] = {}
    for place in dict.fromkeys([models, new_models()]):
        entries = sorted(place.iterdir()) if place.is_dir() else []
        # A hidden folder is an export that has not ended.
        found |= {e.name: e for e in entries if e.is_dir() and e.name[0] != "." and e.name not in found}
    return found


def bundle_folder(model: str, models: Path = MODELS) -> Path:
    """Return the absolute folder of a model: a name (see `known_models`), or a path (anything with a
    separator).

    Raises:
        InputError: there is no such folder; the text lists those there are, and says where more go.
    """
    known = known_models(models)
    if "/" in model or os.sep in model:
        folder = Path(model).absolute()
    else:
        folder = known.get(model, models / model).absolute()
    if model in ("", ".", "..") or not folder.is_dir():
        raise InputError(
            f"MODEL {model!r} does not exist; there are: {', '.join(known) or 'none'}; "
            f"a model's folder goes to {new_models()}, or is given as a path with a slash"
        )
    return folder
