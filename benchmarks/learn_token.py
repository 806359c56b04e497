"""Does a learned token bring text -> 3D closer to an object that the model has never seen?

    make bench ONLY=learn-token

Six renders of a held-out object of the catalogue teach a token ("a *"); a scene is made with it and one
without, from the object's noun alone, everything else being equal; so for each of the `OBJECTS`.
`distance_with`, `distance_without`: mean distance of the classifier's features (cosine) between the views of
the scene and of the object from the same cameras. Needs Debian's sweethome3d-furniture.
"""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from benchmarks import _scenes as scenes
from export.everyday_objects.catalogue import Model, load_model
from export.everyday_objects.dataset import IMAGE_SIZE, split_entries
from export.everyday_objects.judge import Judge, shrink
from export.everyday_objects.learn_token import STEPS, learn, read_pictures, save
from export.everyday_objects.render import Light, render
from export.everyday_objects.restore import restore_networks
from pipeline.diffusion.bundle import Bundle
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.scene.cameras import Camera, orbit_camera, ring

OBJECTS = ("lamp", "bottle", "chair")
"""The first held-out object of each of these nouns."""
TAUGHT = {"front": 0, "front-left": 45, "left-side": 90, "back": 180, "right-side": 270, "front-right": 315}
CATALOGUE = Path("build/everyday")


def shown(model: Model, camera: Camera) -> np.ndarray:
    """Return a picture of the object over the grey that scenes are shown on, uint8."""
    light = Light(0.75, 0.2, 0.1, orbit_camera(0.5, 0.7, 1, 1).pose[:3, 2])
    wood = np.zeros(len(model.colours), np.float32)
    background = np.full(3, scenes.GREY, np.float32)
    return np.round(render(model, wood, camera, IMAGE_SIZE, light, background).image * 255).astype(np.uint8)


@torch.no_grad()
def distance(judged: Judge, first: np.ndarray, second: np.ndarray) -> float:
    """Return the mean over views of 1 - cosine between the classifier's features of two sets of pictures."""
    a, b = judged.features(shrink(first)), judged.features(shrink(second))
    return float((1 - torch.nn.functional.cosine_similarity(a, b)).mean())


def teach(images: Path, token: Path, bundle: Bundle) -> str:
    """Learn a token from pictures; return the noun it started from."""
    steps = 2 if scenes.TINY else STEPS
    networks, tokenizer = restore_networks(bundle.path), load_tokenizer(bundle.path / "tokenizer")
    embeddings, start = learn(read_pictures(images), networks, tokenizer, steps)
    save(token, "mine", embeddings)
    return start


def compare(noun: str, judged: Judge) -> tuple[list[tuple[str, np.ndarray]], dict[str, Any]]:
    """Learn a token for the noun's held-out object and make both scenes; return a row of views each (the
    object's, with the token, without), and the figures.
    """
    bundle, work = scenes.model(), scenes.WORK / "learn-token" / noun
    entry = split_entries(CATALOGUE)[1][noun][0]
    model = load_model(entry)
    images = work / "images"
    images.mkdir(parents=True, exist_ok=True)
    for name, degrees in TAUGHT.items():
        camera = orbit_camera(np.radians(degrees), np.radians(75), 2.5, np.radians(40))
        Image.fromarray(shown(model, camera)).save(images / f"{name}.png")
    token = work / "mine.safetensors"
    start = teach(images, token, bundle)
    cameras = ring(scenes.VIEWS, np.radians(75), 2.5, np.radians(40))
    truth = np.stack([shown(model, camera) for camera in cameras])
    rows, figures = [(f"{entry.name} ({entry.key})", truth[::2])], dict[str, Any]()
    for name, asked in {"with": {"prompt": "a <mine>", "token": str(token)}, "without": {}}.items():
        place = work / name
        job = scenes.make_job(f"a {noun}", place, asked)
        scenes.train(job, place, {"token0": token} if job.token else {})
        with scenes.open_decoder() as decode:
            looks = scenes.look(place / "field.npz", decode)
        figures[f"distance_{name}"] = distance(judged, looks.pictures.astype(np.float32), truth)
        rows.append((f"{job.prompt}: {figures[f'distance_{name}']:.3f}", scenes.strip(looks)))
    return rows, {"object": entry.key, "started_from": start, **figures}


def main(folder: Path) -> dict[str, Any]:
    """Compare for every object; write a sheet, an object a column, and the figures' means."""
    judged = scenes.judge()
    rows, figures = zip(*(compare(noun, judged) for noun in OBJECTS), strict=True)
    by_place = [row for place in zip(*rows, strict=True) for row in place]
    scenes.contact_sheet(folder / "learn-token.png", by_place, len(OBJECTS))
    names = ("distance_with", "distance_without")
    return {
        "summary": {
            **{name: round(float(np.mean([f[name] for f in figures])), 4) for name in names},
            "closer_with": sum(f["distance_with"] < f["distance_without"] for f in figures),
            "objects": len(OBJECTS),
        },
        "by_object": dict(zip(OBJECTS, figures, strict=True)),
    }
