"""A trained scene: everything that rendering it needs, and its file.

Letters: n points.
"""

import json
import math
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
from pipeline.nerf.grid_levels import FEATURES, hash_grid
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
        ValueError: an array is absent or has another shape or type, or the header asks for more.
    """
    try:
        header = parse_json(values["header"].tobytes())
        rng = np.random.default_rng(0)  # what it initialises is overwritten
        shape = FieldShape(**header["field"])
        _check_sizes(shape, int(header["samples_per_ray"]), values)
        field = LatentField(shape, rng)
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
    except (KeyError, TypeError, RuntimeError, AttributeError, OverflowError) as error:
        said = " ".join(str(error).split())[:200]
        raise ValueError(f"not a scene: {said}") from None


def _check_sizes(shape: FieldShape, samples: int, values: Mapping[str, np.ndarray]) -> None:
    """Raise ValueError where the header, which memory and kernels go by, does not fit the arrays."""
    if not all(map(math.isfinite, shape)) or shape.blob_radius <= 0:
        raise ValueError("the header holds numbers that are none")
    if not all(isinstance(number, int) for number in shape[:4]):
        raise ValueError("the header holds counts that are none")
    if not (0 < shape.levels <= 32 and 0 < shape.coarsest <= shape.finest <= 2**14):
        raise ValueError(f"a grid of {shape.levels} levels from {shape.coarsest} to {shape.finest} cells")
    if not (0 < shape.table_log2 <= 24 and 0 < samples <= 2**12):
        raise ValueError(f"tables of 2^{shape.table_log2} entries, {samples} samples a ray")
    wanted = (hash_grid(*shape[:4]).entries, FEATURES)
    if (found := values["field.table"].shape) != wanted:
        raise ValueError(f"a table of shape {found}, expected {wanted} for its grid")
    density, occupied = values["occupancy.density"], values["occupancy.occupied"]
    cells = len(density)
    if not density.shape == occupied.shape == (cells, cells, cells) or not 0 < cells <= 2**10:
        raise ValueError(f"a grid of occupied cells of shape {density.shape} and {occupied.shape}")
    if density.dtype != np.float32 or occupied.dtype != np.bool_:
        raise ValueError(f"occupied cells of type {density.dtype} and {occupied.dtype}")


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
