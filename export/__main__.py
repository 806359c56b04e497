"""The door behind `make export`: all options come from the environment.

CHECKPOINT, NAME, STORAGE=fp32|fp16, SHAPES=free|fixed, GRADIENT=yes|no, PREDICTION=epsilon|v_prediction.
Exit status: 0, 2 for what the user can mend, 1 for a graph that differs from torch.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from types import FrameType

from pipeline.errors import InputError, one_line
from pipeline.files import say_refusal
from pipeline.options.models import new_models

CHOICES = {
    "STORAGE": ("fp32", "fp16"),
    "SHAPES": ("free", "fixed"),
    "GRADIENT": ("yes", "no"),
    "PREDICTION": ("", "epsilon", "v_prediction"),
}


def main(environment: Mapping[str, str], models: Path | None = None) -> int:
    """Export what the environment names into `models` (none: where new models go); return the exit status."""
    models = models or new_models()
    # Before diffusers is imported: nothing may be fetched.
    os.environ["HF_HUB_OFFLINE"] = "1"
    signal.signal(signal.SIGTERM, _stop)
    try:
        chosen = {name: _choice(environment, name) for name in CHOICES}
        for name in ("CHECKPOINT", "NAME"):
            if not environment.get(name):
                raise InputError(
                    f"{name} is empty: say make export CHECKPOINT=folder-or-file.safetensors NAME=my-model"
                )
        if Path(environment["NAME"]).name != environment["NAME"]:
            raise InputError(f"NAME is {environment['NAME']!r}, expected a name without slashes")
        path = Path(environment["CHECKPOINT"])
        if not path.exists():
            raise InputError(
                f"CHECKPOINT {path} does not exist: give a diffusers folder or a .safetensors file"
            )
        if not path.is_dir() and path.suffix != ".safetensors":
            raise InputError(
                f"{path}: expected a .safetensors file or a diffusers folder (.ckpt and .bin files are "
                "pickles, which can run code when read: convert it first)"
            )

        # They take seconds to import.
        import diffusers
        import transformers

        from export.checkpoint import open_folder
        from export.export_checkpoint import ExportOptions, install_checkpoint
        from export.single_file import open_single_file

        transformers.utils.logging.set_verbosity_error()
        transformers.utils.logging.disable_progress_bar()
        diffusers.utils.logging.set_verbosity_error()

        checkpoint = open_folder(path) if path.is_dir() else open_single_file(path, chosen["PREDICTION"])
        options = ExportOptions(
            half_weights=chosen["STORAGE"] == "fp16",
            fixed=chosen["SHAPES"] == "fixed",
            vjp=chosen["GRADIENT"] == "yes",
        )
        install_checkpoint(checkpoint, models / environment["NAME"], options)
    except (InputError, OSError) as error:
        say_refusal(error)
        return 2
    except (ValueError, NotImplementedError) as error:
        print(f"error: {one_line(str(error))}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped; nothing was installed", file=sys.stderr)
        return 130
    print(models / environment["NAME"])
    return 0


def _choice(environment: Mapping[str, str], name: str) -> str:
    value = environment.get(name) or CHOICES[name][0]
    if value not in CHOICES[name]:
        raise InputError(f"{name} is {value!r}, expected {' or '.join(filter(None, CHOICES[name]))}")
    return value


def _stop(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main(os.environ))
