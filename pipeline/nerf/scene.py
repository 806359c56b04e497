"""A trained scene: everything that rendering it needs, and its file.

Letters: n points.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import nn

from pipeline import arrays
from pipeline.documents import parse_json
from pipeline.errors import InputError
from pipeline.nerf.field import FieldShape, LatentField
from pipeline.nerf.linear_rgb import LinearRgb
from pipeline.nerf.occupancy import Occupancy
from pipeline.training.background import Background, FlatBackground, LearnedBackground

BOX_DIAGONAL = 2 * 3**0.5
_POINTS_PER_CHUNK = 65_536


@dataclass
class Scene:
    """A field in the box [-1, 1]^3, where it is not empty, and what is behind it."""

    field: LatentField
    occupancy: Occupancy
    background: Background
    samples_per_ray: int
    """Samples along the diagonal of the box."""
    rgb: LinearRgb | None = None
    """Of a refined scene; None: its colours are latents."""

    @property
    def step(self) -> float:
        """Length of a sample [scene units]."""
        return BOX_DIAGONAL / self.samples_per_ray

    @property
    def modules(self) -> dict[str, nn.Module]:
        """What is trained, by name."""
        parts: dict[str, nn.Module] = {"field": self.field, "background": self.background}
        return parts if self.rgb is None else {**parts, "rgb": self.rgb}


def density(scene: Scene, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Return the density [1 / scene unit] at `points`, with sharpening, also in unoccupied cells."""
    result = np.empty(len(points), np.float32)
    for first in range(0, len(points), _POINTS_PER_CHUNK):
        chunk = np.ascontiguousarray(points[first : first + _POINTS_PER_CHUNK], np.float32)
        result[first : first + len(chunk)] = scene.field.evaluate(torch.from_numpy(chunk)).density.numpy()
    return result


def to_arrays(scene: Scene) -> dict[str, np.ndarray]:
    """Return the scene as named arrays: `header` (JSON as bytes), the grid, field.*, background.* and
    (refined) rgb.*."""
    header = {
        "field": scene.field.shape._asdict(),
        "sharpening": scene.field.sharpening,
        "background": "learned" if isinstance(scene.background, LearnedBackground) else "flat",
        "samples_per_ray": scene.samples_per_ray,
    }
    return {
        "header": np.frombuffer(json.dumps(header).encode(), np.uint8),
        "occupancy.density": scene.occupancy.density,
        "occupancy.occupied": scene.occupancy.occupied,
        **{
            f"{m}.{name}": t.numpy()
            for m, module in scene.modules.items()
            for name, t in module.state_dict().items()
        },
    }


def from_arrays(values: Mapping[str, np.ndarray]) -> Scene:
    """Return the scene that `to_arrays` described.

    Raises:
        ValueError: an array is absent or has another shape or type.
    """
    try:
        header = parse_json(values["header"].tobytes())
        rng = np.random.default_rng(0)  # what it initialises is overwritten
        field = LatentField(FieldShape(**header["field"]), rng)
        field.sharpening = float(header["sharpening"])
        background: Background = (
            FlatBackground(np.zeros_like(values["background.colours"]))
            if header["background"] == "flat"
            else LearnedBackground(rng)
        )
        rgb = LinearRgb.zeros() if "rgb.matrix" in values else None
        occupancy = Occupancy(values["occupancy.density"], values["occupancy.occupied"])
        scene = Scene(field, occupancy, background, int(header["samples_per_ray"]), rgb)
        for name, module in scene.modules.items():
            prefix = f"{name}."
            state = {
                n.removeprefix(prefix): torch.from_numpy(v.copy())
                for n, v in values.items()
                if n.startswith(prefix)
            }
            module.load_state_dict(state)
        return scene
    except (KeyError, TypeError, RuntimeError) as error:
        raise ValueError(f"not a scene: {error}") from None


def save_scene(path: Path, scene: Scene) -> None:
    """Write the scene; equal scenes give equal bytes."""
    path.write_bytes(arrays.pack(to_arrays(scene)))


def load_scene(path: Path) -> Scene:
    """Read a scene.

    Raises:
        InputError: the file is damaged or is no scene.
    """
    try:
        return from_arrays(arrays.unpack(path.read_bytes()))
    except ValueError as error:
        raise InputError(f"{path} is no scene ({error}): delete it and run again") from None
