"""The judge: a small classifier of kind, colour, material and side that the default model is measured with.

It is independent of the model: it learns from renders of its own and from failed pictures, which are a kind
of their own, since a classifier that has only seen whole objects calls any lump by its nearest name.
"""

import itertools
import json
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.materials import MATERIALS
from pipeline.errors import InputError

SIZE = 64
KINDS = tuple(BY_WORD)
FAILED = len(KINDS)
"""The class of what is no object at all."""
MADE_OF = ("plain", *MATERIALS)
SIDES = ("front", "back", "side")
"""What a camera within 45 degrees of the front or of the back sees, and what any other does."""


class Residual(nn.Module):
    """Two normalised convolutions beside the identity."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.BatchNorm2d(channels), nn.ReLU(), nn.Conv2d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(channels), nn.ReLU(), nn.Conv2d(channels, channels, 3, padding=1, bias=False),
        )  # fmt: skip

    def forward(self, x: Tensor) -> Tensor:
        """(b, c, h, w) to the same."""
        return x + self.layers(x)


class Judge(nn.Module):
    """Pictures (b, 3, 64, 64) in [0, 1] to logits of kinds (b, kinds + 1), colours, materials, and sides."""

    def __init__(self, channels: tuple[int, ...] = (32, 64, 128, 256)) -> None:
        super().__init__()
        layers: list[nn.Module] = [nn.Conv2d(3, channels[0], 4, stride=2, padding=1)]
        for before, after in itertools.pairwise(channels):
            layers += [Residual(before), nn.Conv2d(before, after, 3, stride=2, padding=1)]
        self.body = nn.Sequential(*layers, Residual(channels[-1]), nn.BatchNorm2d(channels[-1]), nn.ReLU())
        self.kind = nn.Linear(channels[-1], len(KINDS) + 1)
        self.colour = nn.Linear(channels[-1], len(COLOURS))
        self.material = nn.Linear(channels[-1], len(MADE_OF))
        self.front = nn.Linear(channels[-1], len(SIDES))

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Classify."""
        features = self.features(images)
        return self.kind(features), self.colour(features), self.material(features), self.front(features)

    def features(self, images: Tensor) -> Tensor:
        """Pictures to (b, c): what all heads see, and a distance between pictures."""
        return self.body(images * 2 - 1).mean(dim=(2, 3))


def shrink(images: np.ndarray) -> Tensor:
    """(b, h, w, 3) pictures, uint8 or float in [0, 1], to (b, 3, 64, 64) in [0, 1]."""
    scale = 255.0 if images.dtype == np.uint8 else 1.0
    x = torch.from_numpy(np.asarray(images, np.float32) / scale).permute(0, 3, 1, 2)
    return F.interpolate(x, (SIZE, SIZE), mode="area")


def judge_images(judge: Judge, images: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n, h, w, 3) pictures to probabilities of kinds (n, kinds + 1), of colours (n, colours), and of MADE_OF
    (n, materials + 1).
    """
    kinds, colours, materials, _ = _probabilities(judge, images)
    return kinds, colours, materials


def judge_sides(judge: Judge, images: np.ndarray) -> np.ndarray:
    """(n, h, w, 3) pictures to probabilities of SIDES (n, 3); of no meaning for kinds without a front."""
    return _probabilities(judge, images)[3]


@torch.no_grad()
def _probabilities(judge: Judge, images: np.ndarray) -> list[np.ndarray]:
    parts = [judge(shrink(images[i : i + 64])) for i in range(0, len(images), 64)]
    return [torch.cat(head).softmax(1).numpy() for head in zip(*parts, strict=True)]


def side_of(azimuth: float) -> str:
    """Return which of SIDES a camera at an azimuth [rad] sees."""
    ahead = np.cos(azimuth)
    return "front" if ahead >= np.sqrt(0.5) else "back" if ahead <= -np.sqrt(0.5) else "side"


def save_judge(path: Path, judge: Judge, figures: dict[str, float]) -> None:
    """Write the weights in fp16, with the figures of the held-out test, as one npz file."""
    state = {
        k: v.numpy().astype(np.float16 if v.is_floating_point() else v.numpy().dtype)
        for k, v in judge.state_dict().items()
    }
    np.savez_compressed(path, figures=np.array(json.dumps(figures)), **state)


def load_judge(path: Path) -> tuple[Judge, dict[str, float]]:
    """Read what `save_judge` wrote.

    Raises:
        InputError: it is a judge of other kinds or heads than this one's.
    """
    with np.load(path, allow_pickle=False) as stored:
        figures = json.loads(str(stored["figures"]))
        state = {k: torch.from_numpy(np.asarray(stored[k])) for k in stored.files if k != "figures"}
    judge = Judge()
    expected = judge.state_dict()
    if {k: v.shape for k, v in state.items()} != {k: v.shape for k, v in expected.items()}:
        raise InputError(
            f"{path} is a judge of other kinds than the {len(KINDS)} of today: train one "
            "(python -m export.everyday_objects.train.train_judge build/everyday --steps 8000)"
        )
    judge.load_state_dict({k: v.float() if v.is_floating_point() else v for k, v in state.items()})
    return judge.eval(), figures
