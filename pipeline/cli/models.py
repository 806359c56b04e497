"""The models there are: where they lie, what they say about themselves, whether their files are whole."""

from collections.abc import Callable
from pathlib import Path

from pipeline.diffusion.bundle import OPTIONAL_GRAPHS, open_bundle
from pipeline.errors import InputError
from pipeline.options.models import DEFAULT_MODEL, known_models, new_models


def list_models(verify: bool, say: Callable[[str], None]) -> list[str]:
    """Say a line a model, and where others go; return what is wrong, a line a fault.

    Args:
        verify: also read every byte: checksums where the bundle has them.
    """
    faults = []
    for name, folder in known_models().items():
        try:
            bundle = open_bundle(folder, verify=verify)
        except InputError as error:
            faults.append(str(error))
            say(f"{name:<24} {_megabytes(folder):>7}  broken")
            continue
        lacks = [graph for graph in OPTIONAL_GRAPHS if not (folder / graph).is_dir()]
        facts = [f"{bundle.latent_size} px latents, {bundle.image_size} px pictures"]
        if name == DEFAULT_MODEL:
            facts.append("the default")
        if bundle.views > 1:
            facts.append(f"{bundle.views} views together")
        if bundle.camera:
            facts.append("told the camera")
        if lacks:
            facts.append(f"without {', '.join(lacks)} (RGB refinement by their gradient)")
        if verify:
            facts.append(
                f"{len(bundle.files)} files as made"
                if bundle.files
                else "whole graphs, no checksums to compare"
            )
        say(f"{name:<24} {_megabytes(folder):>7}  {'; '.join(facts)}")
    say(f"another model's folder (from an export, or Optimum's layout) goes to {new_models()}/")
    return faults


def _megabytes(folder: Path) -> str:
    size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    return f"{size / 1e6:.0f} MB"
