"""Does a learned token bring text -> 3D closer to an object that the model has never seen?

    make bench ONLY=learn-token

Six renders of an object, a shape that the model was not trained on, in colours of our choice, teach a token
("a *"); a scene is made with it and one without, from the object's noun alone, everything else being equal;
so for each of the `OBJECTS`. `distance_with`, `distance_without`: mean distance of the classifier's
features (cosine) between the views of the scene and of the object from the same cameras.
"""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from benchmarks import _scenes as scenes
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.looks import Look, dress
from export.everyday_objects.data.pictures import IMAGE_SIZE, variant
from export.everyday_objects.data.render import Drawable, Looks, render
from export.everyday_objects.networks.judge import Judge, shrink
from export.everyday_objects.train.learn_token import STEPS, learn, read_pictures, save
from export.everyday_objects.train.restore import restore_networks
from pipeline.cameras import Camera, orbit_camera, ring
from pipeline.diffusion.bundle import Bundle
from pipeline.diffusion.tokenizer import load_tokenizer

OBJECTS = {
    "lamp": Look("purple", parts={"base": "green"}),
    "bottle": Look("orange", parts={"label": "blue"}),
    "chair": Look("pink", parts={"cushion": "black"}),
}
TAUGHT = {"front": 0, "front-left": 45, "left-side": 90, "back": 180, "right-side": 270, "front-right": 315}
SEED = 1
"""Of the shapes, after those that are trained on."""


def unseen(noun: str) -> tuple[Drawable, Looks]:
    """Return a held-out shape of a kind, dressed as `OBJECTS` says."""
    kind = BY_WORD[noun]
    thing = variant(list(BY_WORD).index(noun), kind.variants + SEED)
    return thing, dress(np.random.default_rng(SEED), kind, thing.shape, OBJECTS[noun])


def shown(thing: Drawable, looks: Looks, camera: Camera) -> np.ndarray:
    """Return a picture of the object over the grey that scenes are shown on, uint8."""
    picture = render(thing, looks, camera, IMAGE_SIZE, np.full(3, scenes.GREY, np.float32))
    return np.round(picture * 255).astype(np.uint8)


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
    thing, worn = unseen(noun)
    images = work / "images"
    images.mkdir(parents=True, exist_ok=True)
    for name, degrees in TAUGHT.items():
        camera = orbit_camera(np.radians(degrees), np.radians(75), 2.5, np.radians(40))
        Image.fromarray(shown(thing, worn, camera)).save(images / f"{name}.png")
    token = work / "mine.safetensors"
    start = teach(images, token, bundle)
    cameras = ring(scenes.VIEWS, np.radians(75), 2.5, np.radians(40))
    truth = np.stack([shown(thing, worn, camera) for camera in cameras])
    rows, figures = [(f"{noun}, unseen", truth[::2])], dict[str, Any]()
    for name, asked in {"with": {"prompt": "a <mine>", "token": str(token)}, "without": {}}.items():
        place = work / name
        job = scenes.make_job(f"a {noun}", place, asked)
        scenes.train(job, place, {"token0": token} if job.token else {})
        with scenes.open_decoder() as decode:
            looks = scenes.look(place / "field.npz", decode)
        figures[f"distance_{name}"] = distance(judged, looks.pictures.astype(np.float32), truth)
        rows.append((f"{job.prompt}: {figures[f'distance_{name}']:.3f}", scenes.strip(looks)))
    return rows, {"started_from": start, **figures}


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
