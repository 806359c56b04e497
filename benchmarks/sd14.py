"""Stable Diffusion 1.4's architecture and sizes with random weights, from export to decoded picture.

The real weights cannot be had here; time and memory do not depend on their values. Each phase is a process of
its own, as the stages of a run are, so that each peak of memory is its own:

- export: 860 million UNet parameters, the real sizes of VAE and CLIP-L, to a bundle, compared with torch;
- text, paint: ten steps of score distillation at 64 x 64, one view a step (a guided batch of 2);
- decode, encode: one picture of 512 x 512;
- denoiser: the pipeline's denoiser, plain onnxruntime on the same graph and diffusers in torch, in turn.

`jobs` reckons from these what a whole job takes its networks. `SMALL=1` runs the same on toy sizes.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pipeline.options.nerf import TrainNerf
from pipeline.options.paint import TrainPaint

STEPS, ROUNDS = 10, 5
STRENGTHS = (0.125, 0.25)
"""Of the hand-overs whose time is reckoned."""
PHASES = ("export", "text", "paint", "decode", "encode", "denoiser")
SMALL = bool(os.environ.get("SMALL"))
SIDE = 16 if SMALL else 64
LENGTH = 77
TEXT: dict[str, Any] = {"vocab_size": 600 if SMALL else 49408, "hidden_size": 32 if SMALL else 768}
UNET: dict[str, Any] = {
    "sample_size": SIDE,
    "cross_attention_dim": TEXT["hidden_size"],
    "block_out_channels": (32, 32, 64, 64) if SMALL else (320, 640, 1280, 1280),
    "attention_head_dim": 8,
    "layers_per_block": 1 if SMALL else 2,
}
VAE_CHANNELS = [32] * 4 if SMALL else [128, 256, 512, 512]
SCHEDULER = {
    "num_train_timesteps": 1000,
    "beta_start": 0.00085,
    "beta_end": 0.012,
    "beta_schedule": "scaled_linear",
    "prediction_type": "epsilon",
    "steps_offset": 1,
}


def make_unet() -> Any:
    """Return the UNet; equal weights in every process."""
    from diffusers import UNet2DConditionModel

    torch.manual_seed(0)
    unet: Any = UNet2DConditionModel(**UNET)
    return unet.eval()


def make_vae() -> Any:
    """Return the VAE."""
    from diffusers import AutoencoderKL

    torch.manual_seed(1)
    vae: Any = AutoencoderKL(
        block_out_channels=VAE_CHANNELS, down_block_types=["DownEncoderBlock2D"] * 4, latent_channels=4,
        up_block_types=["UpDecoderBlock2D"] * 4, layers_per_block=2, sample_size=8 * SIDE,
    )  # fmt: skip
    return vae.eval()


def make_text_encoder() -> Any:
    """Return the text encoder of CLIP-L's sizes."""
    from transformers import CLIPTextConfig, CLIPTextModel

    torch.manual_seed(2)
    layers: dict[str, Any] = {
        "num_hidden_layers": 2 if SMALL else 12,
        "num_attention_heads": 4 if SMALL else 12,
    }
    width: dict[str, Any] = {"intermediate_size": 4 * TEXT["hidden_size"]}
    ids: dict[str, Any] = {"bos_token_id": TEXT["vocab_size"] - 2, "eos_token_id": TEXT["vocab_size"] - 1}
    return CLIPTextModel(CLIPTextConfig(**TEXT, **layers, **width, **ids)).eval()


def export(work: Path) -> dict[str, Any]:
    """Export everything to work/sd14."""
    from export.bundle_files import train_tokenizer
    from export.checkpoint import Checkpoint
    from export.export_checkpoint import ExportOptions, export_cost, install_checkpoint

    makers = {"text_encoder": make_text_encoder, "unet": make_unet, "vae": make_vae}
    parameters = {}
    for name, make in makers.items():
        with torch.device("meta"):
            parameters[name] = sum(p.numel() for p in make().parameters())
    checkpoint = Checkpoint(
        path=Path("random weights"), **makers, scheduler=SCHEDULER, parameters=parameters,
        write_tokenizer=lambda folder: train_tokenizer(
            folder, ["a red chair"], vocabulary_size=600, max_length=LENGTH
        ),
    )  # fmt: skip
    options = ExportOptions(vjp=False)
    cost = export_cost(checkpoint, options)
    differences = install_checkpoint(checkpoint, work / "sd14", options)
    return {
        "parameters": parameters,
        "largest_differences": differences,
        "foreseen_gb": round(cost.memory_gb, 1),
    }


def embeddings(work: Path) -> Any:
    """Return texts that the exported encoder embedded, as stage `embed` makes them."""
    from pipeline.diffusion.sessions import text_encoder
    from pipeline.diffusion.tokenizer import load_tokenizer
    from pipeline.diffusion.view_gradient import Embeddings

    ids = load_tokenizer(work / "sd14" / "tokenizer").encode("a red chair")
    with text_encoder(work / "sd14" / "text_encoder") as encode:
        row = encode(ids[None])[0]
    return Embeddings(np.stack([row] * 5), np.zeros_like(row), "paper", None)


def steps(work: Path, make_step: Callable[[Any], Callable[[Any], dict[str, float]]]) -> dict[str, Any]:
    """Take the steps of one mode; return medians of each part's seconds and of the whole step's."""
    from pipeline.diffusion.schedule import load_schedule
    from pipeline.diffusion.sessions import denoiser
    from pipeline.diffusion.view_gradient import distillation_gradient

    told = embeddings(work)
    step = make_step(told)
    rows = []
    began = time.perf_counter()
    with denoiser(work / "sd14" / "unet") as denoise:
        opened = time.perf_counter() - began
        guidance = distillation_gradient(
            denoise, load_schedule(work / "sd14" / "scheduler"), told, TrainNerf()
        )
        for index in range(STEPS):
            rows.append(step(guidance))
            print(f"step {index + 1}: {sum(rows[-1].values()):.2f} s", file=sys.stderr, flush=True)
    parts = {part: statistics.median(row[part] for row in rows) for part in rows[0]}
    whole = statistics.median(sum(row.values()) for row in rows)
    # Of each step the share of everything but the denoiser: what is slow for both hardly shows in it.
    overhead = statistics.median(1 - row["denoiser"] / sum(row.values()) for row in rows)
    return {"open_s": opened, "step_s": whole, "parts_s": parts, "overhead_fraction": overhead}


def text(work: Path) -> dict[str, Any]:
    """Ten steps of training a field."""
    from pipeline.diffusion.view_gradient import flat_backgrounds
    from pipeline.nerf.step import initial_state, training_step

    def make_step(told: Any) -> Callable[[Any], dict[str, float]]:
        options = TrainNerf(steps=STEPS, cameras_per_step=1)
        state = initial_state(options, flat_backgrounds(told), 0)
        return lambda guidance: training_step(state, options, SIDE, guidance).seconds

    return steps(work, make_step)


def paint(work: Path) -> dict[str, Any]:
    """Ten steps of painting a ball."""
    import trimesh

    from pipeline.diffusion.view_gradient import flat_backgrounds
    from pipeline.mesh.mesh import Mesh
    from pipeline.paint.step import initial_paint, make_pool, paint_step

    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.6)

    def make_step(told: Any) -> Callable[[Any], dict[str, float]]:
        options = TrainPaint(steps=STEPS, cameras_per_step=1, views=8)
        mesh = Mesh(np.asarray(ball.vertices, np.float64), np.asarray(ball.faces, np.int64))
        pool = make_pool(mesh, options, None, SIDE, 0)
        state = initial_paint(options, pool, flat_backgrounds(told), 0)
        return lambda guidance: paint_step(state, options, pool, guidance).seconds

    return steps(work, make_step)


def decode(work: Path) -> dict[str, Any]:
    """One picture."""
    from pipeline.diffusion.sessions import vae_decoder

    latents = np.random.default_rng(0).standard_normal((1, 4, SIDE, SIDE), np.float32)
    with vae_decoder(work / "sd14" / "vae_decoder") as decoder:
        began = time.perf_counter()
        shape = decoder(latents).shape
    return {"seconds": time.perf_counter() - began, "shape": list(shape)}


def encode(work: Path) -> dict[str, Any]:
    """One picture."""
    from pipeline.diffusion.sessions import vae_encoder

    pictures = np.random.default_rng(0).random((1, 8 * SIDE, 8 * SIDE, 3), np.float32)
    with vae_encoder(work / "sd14" / "vae_encoder") as encoder:
        began = time.perf_counter()
        shape = encoder(pictures).shape
    return {"seconds": time.perf_counter() - began, "shape": list(shape)}


def whole_job(
    step_s: float, decode_s: float, encode_s: float, strength: float | None = None
) -> dict[str, float]:
    """Return what the networks of a text's whole job take by these seconds of one view [min]: from nothing,
    or handed over at that strength. What else a run does takes minutes; what the small model does, one."""
    from pipeline.options.asset import Bake
    from pipeline.options.start import StartFit, set_out

    train = TrainNerf() if strength is None else set_out(TrainNerf(), strength)
    parts = {
        "encoding": 0.0 if strength is None else StartFit().views * encode_s,
        "distillation": train.steps * train.cameras_per_step * step_s,
        "decoding": Bake().large_views * decode_s,
    }
    minutes = {part: round(seconds / 60, 1) for part, seconds in parts.items()}
    return {**minutes, "together": round(sum(parts.values()) / 60, 1)}


def denoiser(work: Path) -> dict[str, Any]:
    """The same guided batch through three programs in turn, and the machine's matrix product."""
    import onnxruntime
    from torch.utils.flop_counter import FlopCounterMode

    from pipeline.diffusion import sessions

    folder = work / "sd14" / "unet"
    random = np.random.default_rng(0)
    sample = random.standard_normal((2, 4, SIDE, SIDE), np.float32)
    timestep = np.array([400, 400])
    told = random.standard_normal((2, LENGTH, TEXT["hidden_size"]), np.float32)
    plain = onnxruntime.InferenceSession(str(folder / "model.onnx"), providers=["CPUExecutionProvider"])
    unet = make_unet()
    tensors = [torch.from_numpy(value) for value in (sample, timestep, told)]
    with sessions.denoiser(folder) as denoise, torch.no_grad():

        def in_torch() -> np.ndarray:
            output: np.ndarray = unet(*tensors, return_dict=False)[0].numpy()
            return output

        feeds = {"sample": sample, "timestep": timestep, "encoder_hidden_states": told}
        ways: dict[str, Callable[[], np.ndarray]] = {
            "pipeline": lambda: denoise(sample, timestep, told),
            "onnxruntime": lambda: plain.run(None, feeds)[0],
            "torch": in_torch,
        }
        with FlopCounterMode(display=False) as counter:
            reference = in_torch()
        error = float(np.abs(ways["pipeline"]() - reference).max() / np.abs(reference).max())
        ways["onnxruntime"]()
        seconds: dict[str, list[float]] = {way: [] for way in ways}
        for turn in range(ROUNDS):
            for way in sorted(ways, reverse=bool(turn % 2)):
                began = time.perf_counter()
                ways[way]()
                seconds[way].append(time.perf_counter() - began)
    medians = {way: statistics.median(values) for way, values in seconds.items()}
    gflop = counter.get_total_flops() / 1e9
    return {
        "seconds": medians,
        "all_seconds": seconds,
        "largest_relative_difference": error,
        "gflop": gflop,
        "gflop_s": gflop / medians["pipeline"],
        "matrix_product_gflop_s": matrix_product(),
    }


def matrix_product(size: int = 2048) -> float:
    """Return the best of ten fp32 matrix products [GFLOP/s]: what the machine gives at most."""
    left, right = torch.rand(size, size), torch.rand(size, size)
    best = float("inf")
    for _ in range(10):
        began = time.perf_counter()
        torch.mm(left, right)
        best = min(best, time.perf_counter() - began)
    return 2e-9 * size**3 / best


def run_phase(phase: str, work: Path) -> dict[str, Any]:
    """Run a phase in a process of its own; return its figures and its peak memory."""
    command = [sys.executable, "-m", "benchmarks.sd14", phase, str(work)]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True)
    print(f"{phase}: {done.stdout.splitlines()[-1]}", file=sys.stderr, flush=True)
    figures: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return figures


def main(folder: Path) -> dict[str, Any]:
    """Run every phase; `folder` gets no pictures."""
    with tempfile.TemporaryDirectory() as work:
        phases = {phase: run_phase(phase, Path(work)) for phase in PHASES}
    timed = phases["denoiser"]["seconds"]
    modes = [phases["text"], phases["paint"]]
    summary = {
        "step_s": round(phases["text"]["step_s"], 2),
        "denoiser_s": round(phases["text"]["parts_s"]["denoiser"], 2),
        "overhead_fraction": round(max(mode["overhead_fraction"] for mode in modes), 4),
        "denoiser_vs_ort": round(timed["pipeline"] / timed["onnxruntime"], 3),
        "denoiser_vs_torch": round(timed["pipeline"] / timed["torch"], 3),
        # The phase that compares holds the network three times, which no run does.
        "peak_gb": round(max(phases[name]["peak_gb"] for name in PHASES if name != "denoiser"), 2),
    }
    seconds = (phases["text"]["step_s"], phases["decode"]["seconds"], phases["encode"]["seconds"])
    jobs = {
        "from nothing": whole_job(*seconds),
        **{f"handed over, strength {s:g}": whole_job(*seconds, s) for s in STRENGTHS},
    }
    summary["job_minutes"] = {name: parts["together"] for name, parts in jobs.items()}
    return {
        "summary": summary,
        "load_at_end": os.getloadavg(),
        "small": SMALL,
        "jobs": jobs,
        "phases": phases,
    }


if __name__ == "__main__":
    result = globals()[sys.argv[1]](Path(sys.argv[2])) if sys.argv[1] in PHASES else {}
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    print(json.dumps({**result, "peak_gb": round(peak, 3)}))
