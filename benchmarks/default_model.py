"""Is the default model good enough? Pictures and meshes of prompts, judged by a classifier of their own.

The judge (export/everyday_objects/networks/judge.py) knows the kinds, the colours, the materials, front
from back, and a class of failures; it comes from `python -m export.everyday_objects.train.train_judge`. The
meshes are ordinary runs under build/, so a second call makes only what is missing.
"""

import json
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from benchmarks._pool import at_once
from benchmarks._results import mesh_of_run, texture_of_run
from export.everyday_objects.data.colours import COLOURS
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.materials import MATERIALS
from export.everyday_objects.networks.judge import (
    KINDS,
    MADE_OF,
    SIDES,
    Judge,
    judge_images,
    judge_sides,
    load_judge,
    side_of,
)
from export.everyday_objects.train.export_bundle import example_pictures
from export.everyday_objects.train.sample import AZIMUTHS, of_bundle, paint
from export.everyday_objects.train.train_judge import JUDGE
from pipeline.diffusion import sessions
from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.diffusion.view_gradient import told_cameras
from pipeline.options import job as jobs
from pipeline.options.models import bundle_folder
from pipeline.progress import Progress
from pipeline.report.png import to_bytes
from pipeline.report.preview import albedo_shade, picture, turn
from pipeline.run import engine

RUNS = Path("build/default-model")
HELD_OUT = 200
"""Pictures for the autoencoder."""
GUIDANCE, STEPS = 5.0, 25
# Text to mesh: combinations that no setting was tuned on (`_scenes.PROMPTS` are for that).
PROMPTS = (
    "a blue chair", "a green table", "a yellow bed", "a pink stool", "a red cabinet", "an orange armchair",
    "a green car", "a yellow bus", "a blue truck", "a white airplane", "a red boat", "a white horse",
    "a grey rabbit", "a pink teddy bear", "a purple dragon", "a green bottle", "a brown guitar", "a snowman",
    "a castle",
    "a wooden barrel", "a blue striped sofa", "a red dotted mug", "a green checkered suitcase",
    "a brick lighthouse", "a marble elephant", "a gingerbread house", "a candy mushroom", "a leopard boot",
    "a steel teapot", "a golden owl", "a lego rocket", "a stone lion",
)  # fmt: skip
TILE = 128
MATERIAL_EVERY = 3
"""Pictures: one in so many kinds is asked for in a material."""
BROADER = {
    "desk": "table", "dog house": "house", "sports car": "car", "race car": "car", "rowboat": "boat",
    "grand piano": "piano", "German Shepherd": "dog",
}  # fmt: skip
"""The kind that the judge may name instead: every one of the first is one of the second."""


class Asked(NamedTuple):
    """What a prompt names: places in the judge's lists, -1 for no colour, or two, and for no material."""

    kind: int
    colour: int
    material: int


def asked_for(prompt: str) -> Asked:
    """Return what a prompt names: "a red dotted mug", "a house made of bricks".

    Raises:
        ValueError: it names no kind.
    """
    text, _, noun = prompt.partition(" made of ")
    kinds = [k for k in KINDS if f" {text}".endswith(f" {k}")]
    if not kinds:
        raise ValueError(f"{prompt!r} names none of the kinds that the judge knows")
    kind = max(kinds, key=len)
    words = text.removesuffix(kind).split()
    colours = [i for i, colour in enumerate(COLOURS) if colour in words]
    materials = [
        i for i, m in enumerate(MADE_OF) if m in words or (m in MATERIALS and noun == MATERIALS[m].noun != "")
    ]
    return Asked(
        KINDS.index(kind), colours[0] if len(colours) == 1 else -1, materials[0] if materials else -1
    )


def draw_prompts() -> list[str]:
    """Return two prompts a kind, the same ones every time: one without a colour, now and then in a
    material, and one with a colour.
    """
    rng = np.random.default_rng(2026)
    materials = list(MATERIALS)
    prompts = []
    for i, kind in enumerate(KINDS):
        material = materials[i // MATERIAL_EVERY % len(materials)] if i % MATERIAL_EVERY == 0 else ""
        for look in (material, COLOURS[rng.integers(len(COLOURS))]):
            text = f"{look} {kind}".strip()
            prompts.append(f"{'an' if text[0] in 'aeiou' else 'a'} {text}")
    return prompts


def paint_pictures(bundle: Bundle, prompts: list[str]) -> np.ndarray:
    """Return samples (n, views, p, p, 3) in [0, 1]; a prompt's views are made together, as `paint` does."""
    images = []
    with of_bundle(bundle.path) as painter, Progress("pictures", len(prompts)) as progress:
        for i, prompt in enumerate(prompts):
            images.append(paint(painter, [prompt], GUIDANCE, STEPS, seed=i)[0])
            progress.update(i + 1)
    return np.stack(images)


def guided_step_ms(bundle: Bundle, views: int = 4) -> float:
    """Return the median time [ms] of evaluating the denoiser on a step's views, with and without text."""
    rng = np.random.default_rng(0)
    size, rows = bundle.latent_size, 2 * max(views, bundle.views)
    x = rng.standard_normal((rows, 4, size, size), np.float32)
    tokenizer = load_tokenizer(bundle.path / "tokenizer")
    with sessions.text_encoder(bundle.path / "text_encoder") as encode_text:
        text = np.repeat(encode_text(tokenizer.encode("a red chair")[None]), rows, axis=0)
    seconds = []
    with sessions.denoiser(bundle.path / "unet", rows_expected=rows, views=bundle.views) as denoise:
        run: Callable[..., np.ndarray] = denoise
        told = told_cameras(run, np.zeros((rows, len(bundle.camera)), np.float32))
        for _ in range(12):
            began = time.perf_counter()
            told(x, np.full(rows, 500), text)
            seconds.append(time.perf_counter() - began)
    return round(1000 * float(np.median(seconds[2:])), 1)


def psnr_heldout(bundle: Bundle) -> float:
    """Return the mean PSNR [dB] of held-out shapes through the bundle's own encoder and decoder."""
    images = example_pictures(HELD_OUT)
    decibels = []
    with (
        sessions.vae_encoder(bundle.path / "vae_encoder", bundle.latent_scale) as encode,
        sessions.vae_decoder(bundle.path / "vae_decoder", bundle.latent_scale) as decode,
    ):
        for i in range(0, len(images), 25):
            part = images[i : i + 25]
            error = ((decode(encode(part)).clip(0, 1) - part) ** 2).mean((1, 2, 3))
            decibels.append(-10 * np.log10(np.maximum(error, 1e-10)))
    return round(float(np.concatenate(decibels).mean()), 2)


def views_of_run(run: Path, size: int = TILE) -> np.ndarray:
    """Eight pictures (8, size, size, 3) uint8 around the asset of a finished run, as in its preview."""
    mesh = mesh_of_run(run)
    shade = albedo_shade(mesh, texture_of_run(run))
    return np.stack([to_bytes(picture(mesh, camera, size, shade, 3)) for camera in turn(mesh, 8)])


def contact_sheet(path: Path, rows: list[tuple[str, np.ndarray]], columns: int) -> None:
    """Write labelled strips of pictures, each (n, size, size, 3) uint8, `columns` strips a row."""
    count, size = rows[0][1].shape[:2]
    width, height = count * size + 8, size + 18
    page = Image.new("RGB", (columns * width, -(-len(rows) // columns) * height), "white")
    draw = ImageDraw.Draw(page)
    for i, (label, strip) in enumerate(rows):
        left, top = i % columns * width, i // columns * height
        page.paste(Image.fromarray(np.concatenate(list(strip), axis=1)), (left, top + 16))
        draw.text((left + 2, top + 2), label, fill="black")
    page.save(path, optimize=True)


def thumbnails(images: np.ndarray) -> np.ndarray:
    """(n, p, p, 3) pictures in [0, 1] at half the size, uint8."""
    n, p = images.shape[:2]
    return np.stack([to_bytes(image) for image in images.reshape(n, p // 2, 2, p // 2, 2, 3).mean((2, 4))])


def share(hits: Iterable[bool]) -> float:
    """Return the share of true ones, four decimals; NaN of none."""
    values = list(hits)
    return round(float(np.mean(values)), 4) if values else float("nan")


def judge_flat(judge: Judge, bundle: Bundle, folder: Path) -> tuple[dict[str, float], dict[str, Any]]:
    """Pictures: share whose kind and whose colour the judge names first, the views of a prompt together;
    the kinds that are known; and the share of back views that it takes for the front.
    """
    prompts = draw_prompts()
    images = paint_pictures(bundle, prompts)
    wanted = [asked_for(prompt) for prompt in prompts]
    flat = images.reshape(-1, *images.shape[2:])
    kinds, colours, materials = (
        p.reshape(*images.shape[:2], -1).mean(1).argmax(1) for p in judge_images(judge, flat)
    )
    sides = judge_sides(judge, flat).reshape(*images.shape[:2], -1).argmax(2)
    names = [*KINDS, "failed"]
    right = [
        names[k] in (KINDS[w.kind], BROADER.get(KINDS[w.kind])) for k, w in zip(kinds, wanted, strict=True)
    ]
    rates = {
        kind: share(ok for ok, w in zip(right, wanted, strict=True) if w.kind == i)
        for i, kind in enumerate(KINDS)
    }
    behind = [side_of(np.radians(a)) == "back" for a in AZIMUTHS]
    fronted = np.array([BY_WORD[KINDS[w.kind]].front for w in wanted])
    rows = [
        (f"{'+' if ok else '-'} {prompt}: {names[k]}", thumbnails(views))
        for ok, prompt, k, views in zip(right, prompts, kinds, images, strict=True)
    ]
    contact_sheet(folder / "default-model-2d.png", rows, 8)
    return {
        "noun_top1_2d": share(right),
        "colour_top1_2d": share(c == w.colour for c, w in zip(colours, wanted, strict=True) if w.colour >= 0),
        "nouns": sum(rate >= 0.5 for rate in rates.values()),
        "back_as_front_2d": share((sides[fronted][:, behind] == SIDES.index("front")).ravel()),
    }, {
        "material_top1_2d": share(
            m == w.material for m, w in zip(materials, wanted, strict=True) if w.material >= 0
        ),
        "noun_rates_2d": rates,
    }


def make_mesh(prompt: str) -> Path:
    """Run the whole pipeline on a prompt, on one thread; return the run's folder."""
    return engine.run_job(jobs.resolve({"PROMPT": prompt}), RUNS, 1)


def judge_meshes(judge: Judge, folder: Path) -> tuple[dict[str, float], dict[str, Any]]:
    """Meshes: share whose kind is among the judge's first five, and whose colour and material are its
    first.
    """
    rows, table = [], []
    ranks: list[int] = []
    painted: list[bool] = []
    made: list[bool] = []
    runs = at_once(make_mesh, [(prompt,) for prompt in PROMPTS], "meshes")
    for prompt, run in zip(PROMPTS, runs, strict=True):
        spent = json.loads((run / "manifest.json").read_text(encoding="utf-8"))["seconds"]
        views = views_of_run(run)
        kinds, colours, materials = (p.mean(0) for p in judge_images(judge, views))
        wanted = asked_for(prompt)
        rank = int((kinds > kinds[wanted.kind]).sum()) + 1
        named = [*KINDS, "failed"][int(kinds.argmax())]
        ranks.append(rank)
        painted += [bool(colours.argmax() == wanted.colour)] if wanted.colour >= 0 else []
        made += [bool(materials.argmax() == wanted.material)] if wanted.material >= 0 else []
        table.append(
            {
                "prompt": prompt,
                "rank": rank,
                "named": named,
                "colour": COLOURS[int(colours.argmax())],
                "material": MADE_OF[int(materials.argmax())],
                "stage_seconds": round(spent, 1),
            }
        )
        rows.append((f"{prompt}: {named}, rank {rank}", views[[0, 1, 2, 4]]))
    contact_sheet(folder / "default-model-3d.png", rows, 2)
    return {
        "noun_top5_3d": share(rank <= 5 for rank in ranks),
        "noun_top1_3d": share(rank == 1 for rank in ranks),
        "colour_top1_3d": share(painted),
        "material_top1_3d": share(made),
    }, {"meshes": table}


def main(folder: Path) -> dict[str, Any]:
    """Measure the default bundle; write contact sheets of everything, failures included."""
    judge, accuracy = load_judge(JUDGE)
    bundle = open_bundle(bundle_folder("everyday-objects"))
    described = json.loads((bundle.path / "bundle.json").read_text(encoding="utf-8"))
    flat, flat_table = judge_flat(judge, bundle, folder)
    meshes, mesh_table = judge_meshes(judge, folder)
    summary = {
        "psnr_heldout": psnr_heldout(bundle),
        **flat,
        **meshes,
        "onnx_max_diff": max(described["onnx_max_diff"].values()),
        "guided_step_ms": guided_step_ms(bundle),
    }
    return {"summary": summary, "judge_held_out": accuracy, **flat_table, **mesh_table}
