"""Is the default model good enough? Pictures and meshes of prompts, judged by a classifier of their own.

The judge (export/everyday_objects/judge.py) knows the kinds, the colours, and a class of failures; it comes
from `python -m export.everyday_objects.train_judge`. Needs Debian's sweethome3d-furniture for the held-out
pictures. The meshes are ordinary runs under build/, so a second call makes only what is missing.
"""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from benchmarks._pool import at_once
from export.everyday_objects.captions import COLOURS
from export.everyday_objects.dataset import write_shards
from export.everyday_objects.judge import KINDS, Judge, judge_images, load_judge
from export.everyday_objects.nouns import NOUNS
from export.everyday_objects.sample import ddim
from export.everyday_objects.train_judge import JUDGE
from pipeline import engine
from pipeline import job as jobs
from pipeline.diffusion import sessions
from pipeline.diffusion.bundle import Bundle, open_bundle
from pipeline.diffusion.prompts import view_table
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.progress import Progress
from pipeline.report.preview import albedo_shade, picture, to_bytes, turn
from pipeline.scene.mesh import read_obj

WORK, RUNS = Path("build/everyday"), Path("build/default-model")
PICTURES, BATCH = 128, 16
GUIDANCE, STEPS = 5.0, 25
# Text to mesh: combinations that no setting was tuned on (`_scenes.PROMPTS` are for that).
PROMPTS = (
    "a blue chair", "an orange sofa", "a green table", "a yellow bed", "a brown bench", "a pink stool",
    "a grey armchair", "a red cabinet", "a white bookcase", "a green lamp", "a green car", "a yellow bus",
    "a blue truck", "a white airplane", "a red boat", "a white horse", "a grey rabbit", "a pink teddy bear",
    "a green cactus", "a pine tree", "a blue bottle", "an orange vase", "a white mug", "a red fire hydrant",
    "a wooden barrel", "a blue house", "a brown mushroom", "a red rocket", "a pink donut", "a yellow duck",
    "a snowman", "an orange pumpkin",
)  # fmt: skip
TILE = 128
RECOLOURED = 0.25
"""Kinds with a smaller share of recoloured training pictures are asked for as they are, without a colour."""
BROADER = {"desk": "table", "dog house": "house"}
"""The kind that the judge may name instead: every one of the first is one of the second."""


def draw_prompts(count: int) -> list[tuple[str, str]]:
    """Kinds and colours ("" for kinds that are trained in their own), each kind as often as any other, the
    same ones every time.
    """
    rng = np.random.default_rng(2026)
    kinds = [str(k) for _ in range(-(-count // len(KINDS))) for k in rng.permutation(KINDS)][:count]
    colours = [COLOURS[rng.integers(len(COLOURS))] for _ in kinds]
    own = {n.words[0] for n in NOUNS if n.recolour < RECOLOURED}
    return [(kind, "" if kind in own else colour) for kind, colour in zip(kinds, colours, strict=True)]


def paint_pictures(bundle: Bundle, texts: list[str]) -> np.ndarray:
    """Samples (n, p, p, 3) in [0, 1] of prompts with their view words."""
    schedule = load_schedule(bundle.path / "scheduler")
    tokenizer = load_tokenizer(bundle.path / "tokenizer")
    with sessions.text_encoder(bundle.path / "text_encoder") as encode_text:
        embeddings = encode_text(np.stack([tokenizer.encode(t) for t in ["", *texts]]))
    images = []
    with (
        sessions.denoiser(bundle.path / "unet") as denoise,
        sessions.vae_decoder(bundle.path / "vae_decoder", bundle.latent_scale) as decode,
        Progress("pictures", len(texts)) as progress,
    ):
        for i in range(0, len(texts), BATCH):
            cond = embeddings[1 + i : 1 + i + BATCH]
            latents = ddim(
                denoise, schedule, cond, embeddings[0], bundle.latent_size, GUIDANCE, STEPS, seed=i
            )
            images.append(decode(latents).clip(0, 1))
            progress.update(min(i + BATCH, len(texts)))
    return np.concatenate(images)


def guided_step_ms(bundle: Bundle, views: int = 4) -> float:
    """Median time of a guided evaluation of the denoiser, with and without text, of a step's views [ms]."""
    rng = np.random.default_rng(0)
    size = bundle.latent_size
    x = rng.standard_normal((2 * views, 4, size, size), np.float32)
    tokenizer = load_tokenizer(bundle.path / "tokenizer")
    with sessions.text_encoder(bundle.path / "text_encoder") as encode_text:
        text = np.repeat(encode_text(tokenizer.encode("a red chair")[None]), 2 * views, axis=0)
    seconds = []
    with sessions.denoiser(bundle.path / "unet") as denoise:
        for _ in range(12):
            began = time.perf_counter()
            denoise(x, np.full(2 * views, 500), text)
            seconds.append(time.perf_counter() - began)
    return round(1000 * float(np.median(seconds[2:])), 1)


def psnr_heldout(bundle: Bundle) -> float:
    """Mean PSNR [dB] of held-out objects through the bundle's own encoder and decoder."""
    write_shards(WORK, "held_out", range(1), held_out=True)
    images = np.load(WORK / "held_out" / "000.npy").astype(np.float32) / 255
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


def kind_and_colour(prompt: str) -> tuple[int, int]:
    """The kind and the colour that a prompt names; -1 for no colour of the list."""
    kind = max((k for k in KINDS if prompt.endswith(k)), key=len)
    return KINDS.index(kind), next((i for i, c in enumerate(COLOURS) if c in prompt.split()), -1)


def views_of_run(run: Path, size: int = TILE) -> np.ndarray:
    """Eight pictures (8, size, size, 3) uint8 around the asset of a finished run."""
    mesh = read_obj(run / "mesh_uv.obj")
    with Image.open(run / "albedo.png") as image:
        texture = np.asarray(image.convert("RGB"), np.float32) / 255
    shade = albedo_shade(mesh, texture)
    return np.stack([to_bytes(picture(mesh, camera, size, shade, 3)) for camera in turn(mesh, 8)])


def contact_sheet(path: Path, rows: list[tuple[str, np.ndarray]], columns: int) -> None:
    """Write labelled strips of pictures, each (n, size, size, 3) uint8, `columns` strips a row."""
    count = len(rows[0][1])
    width, height = count * TILE + 8, TILE + 18
    page = Image.new("RGB", (columns * width, -(-len(rows) // columns) * height), "white")
    draw = ImageDraw.Draw(page)
    for i, (label, strip) in enumerate(rows):
        left, top = i % columns * width, i // columns * height
        page.paste(Image.fromarray(np.concatenate(list(strip), axis=1)), (left, top + 16))
        draw.text((left + 2, top + 2), label, fill="black")
    page.save(path, optimize=True)


def judge_flat(judge: Judge, bundle: Bundle, folder: Path) -> tuple[dict[str, float], dict[str, Any]]:
    """Pictures: share whose kind and whose colour the judge names first, and the kinds that are known."""
    wanted = draw_prompts(PICTURES)
    views = [v for v in view_table(bundle.view_prompts) if not v.startswith("overhead")]
    texts = [
        f"{' '.join(word for word in ('a', colour, kind) if word)}, {views[i % len(views)]}"
        for i, (kind, colour) in enumerate(wanted)
    ]
    images = paint_pictures(bundle, texts)
    kinds, colours = (p.argmax(1) for p in judge_images(judge, images))
    names = [*KINDS, "failed"]
    right = np.array(
        [names[k] in (kind, BROADER.get(kind)) for k, (kind, _) in zip(kinds, wanted, strict=True)]
    )
    painted = np.array(
        [COLOURS[c] == colour for c, (_, colour) in zip(colours, wanted, strict=True) if colour]
    )
    rates = {k: float(right[[kind == k for kind, _ in wanted]].mean()) for k in KINDS}
    rows = [
        (f"{'+' if ok else '-'} {text.split(',')[0]}", np.round(image[None] * 255).astype(np.uint8))
        for ok, text, image in zip(right, texts, images, strict=True)
    ]
    contact_sheet(folder / "default-model-2d.png", rows, 16)
    return {
        "noun_top1_2d": round(float(right.mean()), 4),
        "colour_top1_2d": round(float(painted.mean()), 4),
        "nouns": sum(rate >= 0.5 for rate in rates.values()),
    }, {"noun_rates_2d": rates}


def make_mesh(prompt: str) -> Path:
    """Run the whole pipeline on a prompt, on one thread; return the run's folder."""
    return engine.run_job(jobs.resolve({"PROMPT": prompt}), RUNS, 1)


def judge_meshes(judge: Judge, folder: Path) -> tuple[dict[str, float], dict[str, Any]]:
    """Meshes: share whose kind is among the judge's first five, and whose colour is its first."""
    rows, table = [], []
    ranks: list[int] = []
    painted: list[bool] = []
    runs = at_once(make_mesh, [(prompt,) for prompt in PROMPTS], "meshes")
    for prompt, run in zip(PROMPTS, runs, strict=True):
        spent = json.loads((run / "manifest.json").read_text(encoding="utf-8"))["seconds"]
        views = views_of_run(run)
        kinds, colours = (p.mean(0) for p in judge_images(judge, views))
        kind, colour = kind_and_colour(prompt)
        rank = int((kinds > kinds[kind]).sum()) + 1
        named = [*KINDS, "failed"][int(kinds.argmax())]
        ranks.append(rank)
        painted += [bool(colours.argmax() == colour)] if colour >= 0 else []
        table.append(
            {
                "prompt": prompt,
                "rank": rank,
                "named": named,
                "colour": COLOURS[int(colours.argmax())],
                "stage_seconds": round(spent, 1),
            }
        )
        rows.append((f"{prompt}: {named}, rank {rank}", views[[0, 1, 2, 4]]))
    contact_sheet(folder / "default-model-3d.png", rows, 2)
    return {
        "noun_top5_3d": round(float(np.mean(np.array(ranks) <= 5)), 4),
        "noun_top1_3d": round(float(np.mean(np.array(ranks) == 1)), 4),
        "colour_top1_3d": round(float(np.mean(painted)), 4),
    }, {"meshes": table}


def main(folder: Path) -> dict[str, Any]:
    """Measure the default bundle; write contact sheets of everything, failures included."""
    judge, accuracy = load_judge(JUDGE)
    bundle = open_bundle(jobs.bundle_folder("everyday-objects"))
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
