"""Textual inversion on the default bundle: learn a token from a few pictures of one object.

`make learn-token IMAGES=dir NAME=mine` writes tokens/mine.safetensors, for `make run PROMPT="a <mine>"
TOKEN=tokens/mine.safetensors`. Gal et al. 2022: all weights stay as they are, only the token's embeddings
are trained, by the denoiser's own loss on the pictures. They start from the known noun that explains the
pictures best, and get no longer than it is. Plain backdrops are exchanged for others, or the token would mean
them too. A file name may say from where a picture is taken, front.png, back-left-2.png: the caption then says
so, and the denoiser is told a camera there.
"""

import argparse
import itertools
import os
import re
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from PIL import Image
from safetensors.torch import save_file
from torch.nn import functional as F

from export.everyday_objects.data.kinds import KINDS
from export.everyday_objects.data.pictures import IMAGE_SIZE, draw_backdrop
from export.everyday_objects.networks.autoencoder import Encoder
from export.everyday_objects.networks.denoiser import Denoiser
from export.everyday_objects.networks.text_encoder import WIDTH, TextEncoder
from export.everyday_objects.train.backdrops import coverage
from export.everyday_objects.train.batches import camera_rows, draw_timesteps
from export.everyday_objects.train.export_bundle import NAME
from export.everyday_objects.train.loss import alphas_cumprod
from export.everyday_objects.train.restore import Networks, restore_networks
from export.everyday_objects.train.train_autoencoder import to_batch
from pipeline.diffusion.prompts import view_table
from pipeline.diffusion.tokenizer import ClipTokenizer, load_tokenizer
from pipeline.diffusion.tokens import LearnedToken, TokenTable, insert_tokens
from pipeline.errors import InputError
from pipeline.files import say_refusal
from pipeline.options.models import bundle_folder
from pipeline.run.stage import Progress

FORMATS = (".png", ".jpg", ".jpeg", ".webp")
FEWEST, MOST = 1, 64
VECTORS, STEPS, BATCH, RATE = 2, 300, 8, 3e-3
BACKDROPS = 12
"""On how many backdrops each picture is shown that has a plain one of its own."""
POLAR, OVERHEAD, DISTANCE, FOV = 75.0, 25.0, 2.5, 39.5
"""Of the camera that a file's name stands for [deg, scene units]."""
_DRAWS = 4
"""Noise levels at which each noun is tried."""


class Pictures(NamedTuple):
    """What a token is learned from."""

    images: np.ndarray
    """(n, IMAGE_SIZE, IMAGE_SIZE, 3) uint8"""
    views: list[str]
    """View words, "" where the file's name has none."""
    coverages: list[np.ndarray | None]
    """Where the object is, (IMAGE_SIZE, IMAGE_SIZE) in [0, 1]; None where its backdrop is not plain."""


def read_pictures(folder: Path) -> Pictures:
    """Read the pictures of a folder in the order of their names, cropped to squares.

    A transparent backdrop is left out, an opaque one is looked for (`backdrops.coverage`).

    Raises:
        InputError: no folder, too few or too many pictures, a file that is none.
    """
    paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in FORMATS) if folder.is_dir() else []
    if not FEWEST <= len(paths) <= MOST:
        raise InputError(
            f"IMAGES {folder} holds {len(paths)} pictures ({', '.join(FORMATS)}), "
            f"expected {FEWEST} to {MOST} (3 to 8 are usual)"
        )
    images, coverages = [], []
    for path in paths:
        try:
            with Image.open(path, formats=["PNG", "JPEG", "WEBP"]) as opened:
                picture = opened.convert("RGBA")
        except (OSError, ValueError, Image.DecompressionBombError) as error:
            raise InputError(f"{path} is no picture that can be read ({error}): replace it") from None
        side = min(picture.size)
        left, top = (picture.width - side) // 2, (picture.height - side) // 2
        picture = picture.crop((left, top, left + side, top + side))
        pixels = np.asarray(picture.resize((IMAGE_SIZE, IMAGE_SIZE), Image.Resampling.BOX))
        images.append(pixels[..., :3])
        opaque = pixels[..., 3].min() == 255
        coverages.append(coverage(images[-1]) if opaque else pixels[..., 3].astype(np.float32) / 255)
    return Pictures(np.stack(images), [view_of(path.stem) for path in paths], coverages)


def over_backdrops(rng: np.random.Generator, pictures: Pictures) -> tuple[np.ndarray, np.ndarray]:
    """Return all pictures (BACKDROPS, n, IMAGE_SIZE, IMAGE_SIZE, 3) uint8 on flat backdrops like those that
    the model was trained on, and these (BACKDROPS, n, 3) in [0, 1], NaN where a picture keeps its own.
    """
    shown = np.repeat(pictures.images[None], BACKDROPS, axis=0)
    backdrops = np.full((*shown.shape[:2], 3), np.nan, np.float32)
    for i, covered in enumerate(pictures.coverages):
        if covered is None:
            continue
        for k in range(BACKDROPS):
            backdrops[k, i] = draw_backdrop(rng)
            mixed = covered[..., None] * pictures.images[i] + (1 - covered[..., None]) * 255 * backdrops[k, i]
            shown[k, i] = np.round(mixed).astype(np.uint8)
    return shown, backdrops


def flat_latents(encoder: Encoder, colours: np.ndarray) -> np.ndarray:
    """Return the latents (n, 4) of flat colours (n, 3) in [0, 1]."""
    flat = torch.from_numpy(colours)[:, :, None, None].expand(-1, -1, 16, 16)
    return encoder(flat)[:, :, 1, 1].numpy()


def cameras_of(views: list[str], backdrops: np.ndarray) -> torch.Tensor:
    """Return camera inputs (n, 10), see `networks.denoiser.CAMERA`, for view words ("": no known camera) and
    latents of backdrops (n, 4) (NaN: none known).
    """
    words = view_table("eight")
    places = np.array([words.index(view) if view else 0 for view in views])
    polars = np.where(places < 8, POLAR, OVERHEAD)
    ones = np.ones(len(views))
    angles = np.radians([places % 8 * 45.0, polars, FOV * ones])
    cameras = np.stack([angles[0], angles[1], DISTANCE * ones, angles[2]], axis=1)
    told, behind = np.array([view != "" for view in views]), np.isfinite(backdrops).all(axis=1)
    return torch.from_numpy(camera_rows(cameras, np.nan_to_num(backdrops), told, behind))


def view_of(stem: str) -> str:
    """Return the view words that a file's name starts with: "back-left-2" -> "back left view"."""
    said = re.sub(r"[^a-z]+", " ", stem.lower()).strip()
    fitting = [
        view for view in view_table("eight") if f"{said} ".startswith(f"{view.removesuffix(' view')} ")
    ]
    return max(fitting, key=len, default="")


def captioned(what: str, view: str) -> str:
    """Return a caption as the model knows them."""
    named = f"{'an' if what[0] in 'aeiou' else 'a'} {what}"
    return f"{named}, {view}" if view else named


def denoising_loss(
    denoiser: Denoiser,
    clean: torch.Tensor,
    text: torch.Tensor,
    cameras: torch.Tensor,
    rng: np.random.Generator,
) -> torch.Tensor:
    """Return the loss (b,) that the denoiser was trained with, at random noise levels, each picture alone."""
    t = torch.from_numpy(draw_timesteps(rng, len(clean)))
    noise = torch.from_numpy(rng.standard_normal(clean.shape, np.float32))
    a = alphas_cumprod()[t].view(-1, 1, 1, 1)
    noised, target = a.sqrt() * clean + (1 - a).sqrt() * noise, a.sqrt() * noise - (1 - a).sqrt() * clean
    predicted = denoiser(noised, t, text, cameras, views=1)
    return F.mse_loss(predicted, target, reduction="none").mean((1, 2, 3))


@torch.no_grad()
def nearest_noun(
    networks: tuple[Denoiser, TextEncoder],
    tokenizer: ClipTokenizer,
    clean: torch.Tensor,
    views: list[str],
    cameras: torch.Tensor,
) -> str:
    """Return the noun of the training captions under which the pictures are denoised best.

    Every noun meets the same noise.
    """
    denoiser, text_encoder = networks
    losses = {}
    for noun in (kind.words[0] for kind in KINDS):
        ids = torch.from_numpy(np.stack([tokenizer.encode(captioned(noun, view)) for view in views]))
        text = text_encoder(ids)
        draws = (
            denoising_loss(denoiser, clean, text, cameras, np.random.default_rng(i)) for i in range(_DRAWS)
        )
        losses[noun] = float(sum(draw.mean() for draw in draws))
    return min(losses, key=losses.__getitem__)


def learn(
    pictures: Pictures,
    networks: Networks,
    tokenizer: ClipTokenizer,
    steps: int = STEPS,
    vectors: int = VECTORS,
    seed: int = 0,
) -> tuple[torch.Tensor, str]:
    """Return the embeddings (vectors, WIDTH) of a token for these pictures and the noun they started from."""
    encoder, _, denoiser, text_encoder = networks
    for network in networks:
        network.requires_grad_(False)
    rng = np.random.default_rng(seed)
    shown, backdrops = over_backdrops(rng, pictures)
    with torch.no_grad():
        latents = torch.stack([encoder(to_batch(images)) for images in shown])
        behind = [flat_latents(encoder, colours) for colours in backdrops]
    cameras = torch.stack([cameras_of(pictures.views, flat) for flat in behind])
    noun = nearest_noun((denoiser, text_encoder), tokenizer, latents[0], pictures.views, cameras[0])
    ids = tokenizer.encode(noun)
    word = text_encoder.tokens.weight[torch.from_numpy(ids[1 : list(ids).index(tokenizer.end)])].mean(0)
    start = rng.standard_normal((vectors, WIDTH)).astype(np.float32) * 0.1 * float(word.std())
    embeddings = (word + torch.from_numpy(start)).requires_grad_()
    stand_in = LearnedToken(Path("token"), ("*",), np.zeros((vectors, WIDTH), np.float32))
    table = TokenTable(text_encoder.tokens.num_embeddings, WIDTH)
    texts = [captioned("*", view) for view in pictures.views]
    inserted = insert_tokens([stand_in], texts[0], texts[1:], tokenizer, table)
    rows = torch.from_numpy(np.stack([inserted.tokenizer.encode(text) for text in inserted.texts]))
    optimiser = torch.optim.Adam([embeddings], RATE)
    order = itertools.cycle(range(len(texts)))
    with Progress("learn-token", steps, "steps") as progress:
        for step in range(steps):
            picks = list(itertools.islice(order, BATCH))
            chosen = rng.integers(BACKDROPS, size=BATCH), picks
            text = text_encoder(rows[picks], embeddings)
            loss = denoising_loss(denoiser, latents[chosen], text, cameras[chosen], rng).mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            with torch.no_grad():  # free ones get four times as long as any word, and guidance overshoots
                embeddings *= (word.norm() / embeddings.norm(dim=1, keepdim=True)).clamp(max=1)
            progress.update(step + 1, f"loss {float(loss.detach()):.4f}")
    return embeddings.detach(), noun


def save(path: Path, name: str, embeddings: torch.Tensor) -> None:
    """Write a token as diffusers does, under the placeholder <name>."""
    path.parent.mkdir(parents=True, exist_ok=True)
    save_file({f"<{name}>": embeddings.contiguous()}, path)


def main() -> int:
    """Command line; IMAGES and NAME come from the environment, as make passes them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=None)
    parser.add_argument("--steps", type=int, default=STEPS)
    options = parser.parse_args()
    name = os.environ.get("NAME", "")
    try:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,40}", name):
            raise InputError(f"NAME is {name!r}, expected letters, digits, - and _: NAME=mine gives <mine>")
        if not os.environ.get("IMAGES"):
            raise InputError("IMAGES is empty: name a folder with 3 to 8 pictures of one object")
        path = Path("tokens") / f"{name}.safetensors"
        if path.exists():
            raise InputError(
                f"NAME is {name!r}, but {path} exists: choose another name, or move that file away"
            )
        pictures = read_pictures(Path(os.environ["IMAGES"]))
        folder = options.folder or bundle_folder(NAME)
        tokenizer, networks = load_tokenizer(folder / "tokenizer"), restore_networks(folder)
        embeddings, noun = learn(pictures, networks, tokenizer, options.steps)
        save(path, name, embeddings)
    except (InputError, OSError) as error:
        say_refusal(error)
        return 2
    except KeyboardInterrupt:
        print("stopped; nothing was written", file=sys.stderr)
        return 130
    print(f"{path}: {len(embeddings)} embeddings of width {WIDTH}, started from {noun!r}")
    print(f'make run PROMPT="a <{name}>" TOKEN={path}')
    return 0


if __name__ == "__main__":
    sys.exit(main())
