"""Does RGB refinement pay for itself? Before and after, in its variants, on the same latent scenes.

    make bench ONLY=refine

Variants: `fit` (the RGB field is fitted to decoded views, no distillation), `encoder` and `image`
(distillation through the encoder's gradient, or towards decoded pictures) after that fit, and `encoder-alone`
(the paper's: distillation from the linear layer). `before` is the latent scene, decoded. Sharpness is the
gradient energy of the renders inside the object; `agreement` the probability that the classifier of the
default model's benchmark gives the prompt's noun; `likeness` the PSNR [dB] against the decoded views. Where
the bundle lacks vae_encoder_vjp, its two variants are left out.
"""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import _scenes as scenes
from benchmarks._pool import at_once
from benchmarks._tables import markdown

PROMPT_COUNT = 4
CHOSEN = "encoder"
"""What REFINE=1 does by default where the bundle can."""
VARIANTS: dict[str, dict[str, Any]] = {
    "fit": {"steps": 0, "fit_steps": 60},
    "image": {"gradient": "image"},
    "encoder": {"gradient": "encoder"},
    "encoder-alone": {"gradient": "encoder", "fit_steps": 0},
}


def judged(prompt: str, variants: tuple[str, ...]) -> list[tuple[dict[str, Any], np.ndarray]]:
    """Train a prompt's latent scene and refine it in every way; return figures and pictures of each."""
    judge, work = scenes.judge(), scenes.WORK / "refine" / prompt.replace(" ", "-")
    found = []
    latent_step = 0.0
    for name in ("before", *variants):
        section = VARIANTS.get(name, {})
        job = scenes.make_job(prompt, work, {"refinement": section} if section else {})
        scenes.train(job, work)
        row: dict[str, Any] = {"prompt": prompt, "variant": name}
        if name == "before":
            with scenes.open_decoder() as decode:
                looks = scenes.look(work / "field.npz", decode)
            latent_step = row["step_seconds"] = scenes.step_seconds(work / "training.json")
        else:
            metrics = scenes.refined(job, work)
            (work / "refine.json").rename(work / f"refine-{name}.json")
            looks = scenes.look(work / "field_rgb.npz")
            row |= {"start_psnr": metrics["start_psnr"], "likeness": metrics["end_psnr"]}
            if job.refinement.steps:
                step = scenes.step_seconds(work / "refinement.json", job.refinement.fit_steps)
                row |= {"step_seconds": step, "step_ratio": step / latent_step}
        row |= {
            "sharpness": scenes.sharpness(looks),
            "agreement": scenes.agreement(judge, looks, prompt),
            "rank": scenes.rank(judge, looks, prompt),
        }
        found.append((row, scenes.strip(looks)))
    return found


def main(folder: Path) -> dict[str, Any]:
    """Refine the scene of every prompt in every way; write one sheet of pictures, a row a scene and way."""
    has_gradient = (scenes.model().path / "vae_encoder_vjp").is_dir()
    variants = tuple(n for n, v in VARIANTS.items() if has_gradient or v.get("gradient") != "encoder")
    chosen = CHOSEN if CHOSEN in variants else "image"
    calls = [(prompt, variants) for prompt in scenes.chosen(PROMPT_COUNT)]
    results = [one for found in at_once(judged, calls, "scenes") for one in found]
    rows = [row for row, _ in results]
    pictures = [(f"{row['prompt']}: {row['variant']}, rank {row['rank']}", strip) for row, strip in results]
    scenes.contact_sheet(folder / "refine.png", pictures, 1 + len(variants))
    table = {name: means([r for r in rows if r["variant"] == name]) for name in ("before", *variants)}
    heads = ("sharpness", "agreement", "noun_top5", "start_psnr", "likeness", "step_ratio")
    lines = [(name, *(row.get(head, "") for head in heads)) for name, row in table.items()]
    (folder / "refine.md").write_text(markdown(("variant", *heads), lines), encoding="utf-8")
    summary = {
        "start_psnr": table[chosen]["start_psnr"],
        "sharpness_gain": table[chosen]["sharpness"] / max(table["before"]["sharpness"], 1e-9),
        "noun_top5_before": table["before"]["noun_top5"],
        "noun_top5_after": table[chosen]["noun_top5"],
        "step_ratio": table[chosen]["step_ratio"],
    }
    return {"summary": rounded(summary), "chosen": chosen, "variants": table, "scenes": rows}


def means(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Return the mean of every figure of some rows, the ratio's median, and the share among the first
    five."""
    figures = {k for k, v in rows[0].items() if isinstance(v, float)}
    mean = {
        k: float((np.median if k.startswith("step") else np.mean)([r[k] for r in rows]))
        for k in sorted(figures)
    }
    return rounded({**mean, "noun_top5": float(np.mean([r["rank"] <= 5 for r in rows]))})


def rounded(values: dict[str, float]) -> dict[str, float]:
    """Return figures with four digits behind the point."""
    return {name: round(value, 4) for name, value in values.items()}
