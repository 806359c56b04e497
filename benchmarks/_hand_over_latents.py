"""Two bundles of different latents: the bundled model, and one whose autoencoder is a matrix, of other size.

The second one's latents are a linear function of 2 x 2 pixels: 64 x 64 where the bundled model has 32 x 32.
Its other graphs are the bundled model's: the hand-over asks none of them.
"""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from pipeline.options.job import resolve
from pipeline.options.models import bundle_folder
from pipeline.run import engine
from pipeline.run.stage import Context
from pipeline.stages import embed, start

PROMPT = "a red armchair"
SIDE, SCALE = 2, 1.3


def analysis() -> np.ndarray:
    """Return how 2 x 2 pixels in [-1, 1] become latents, (4, 3, 2, 2): the mean colour in another basis, and
    how much brighter the left two are than the right two."""
    basis = np.array([[0.6, 0.6, 0.5], [0.8, -0.7, 0.1], [0.3, 0.4, -0.9]])
    kernel = np.zeros((4, 3, SIDE, SIDE))
    kernel[:3] = basis[:, :, None, None] / SIDE**2
    kernel[3, :, :, 0], kernel[3, :, :, 1] = 1 / 12, -1 / 12
    return kernel


def save(folder: Path, name: str, operator: str, kernel: np.ndarray, ports: tuple[str, str]) -> None:
    """Write a graph of one convolution to folder/name/model.onnx."""
    shapes: list[list[str | int | None]] = [["b", 3, "h", "w"], ["b", 4, "y", "x"]]
    given, made = shapes if operator == "Conv" else shapes[::-1]
    graph = helper.make_graph(
        [helper.make_node(operator, [ports[0], "kernel"], [ports[1]], strides=[SIDE, SIDE])],
        name,
        [helper.make_tensor_value_info(ports[0], TensorProto.FLOAT, given)],
        [helper.make_tensor_value_info(ports[1], TensorProto.FLOAT, made)],
        [numpy_helper.from_array(kernel.astype(np.float32), "kernel")],
    )
    (folder / name).mkdir(parents=True)
    model = helper.make_model(graph, ir_version=9, opset_imports=[helper.make_opsetid("", 20)])
    onnx.save(model, folder / name / "model.onnx")
    (folder / name / "config.json").write_text(json.dumps({"scaling_factor": SCALE}), encoding="utf-8")


def other_bundle(folder: Path) -> Path:
    """Write the second bundle."""
    ours = bundle_folder("everyday-objects")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name in ("text_encoder", "unet", "tokenizer", "scheduler"):
        os.symlink(ours / name, folder / name)
    kernel = analysis()
    inverse = np.linalg.pinv(kernel.reshape(4, -1)).T.reshape(kernel.shape)
    save(folder, "vae_encoder", "Conv", kernel, ("sample", "latent_sample"))
    save(folder, "vae_decoder", "ConvTranspose", inverse, ("latent_sample", "sample"))
    described = json.loads((ours / "bundle.json").read_text(encoding="utf-8"))
    colours = inverse.mean((2, 3)).T / SCALE
    described |= {
        "name": "matrix",
        "files": {},
        "latent_size": 64,
        "latent_scale": SCALE,
        "latent_to_rgb": colours.tolist(),
        "latent_to_rgb_bias": [0.0] * 3,
    }
    (folder / "bundle.json").write_text(json.dumps(described), encoding="utf-8")
    return folder


def handed_over(cache: Path) -> dict[str, Any]:
    """Hand a draft of the bundled model over to the other bundle; return the metrics of stage `start`."""
    other = other_bundle(cache / "matrix")
    run = engine.run_job(resolve({"PROMPT": PROMPT, "QUALITY": "draft"}), cache / "runs", 1)
    job = resolve({"PROMPT": PROMPT, "MODEL": str(other), "START": str(run)})
    work = cache / "over"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir()
    networks = {name: other / name for name in ("text_encoder", "tokenizer", "vae_encoder", "vae_decoder")}
    made = {"embeddings": work / "embeddings.npz"}
    embed.main(Context(job, {**networks, "description": other / "bundle.json"}, made, work))
    model = bundle_folder("everyday-objects")
    inputs = {
        **networks,
        **made,
        "start_scene": run / "field.npz",
        "start_decoder": model / "vae_decoder",
        "start_description": model / "bundle.json",
    }
    context = Context(job, inputs, {"scene": work / "start.npz"}, work)
    start.main(context)
    return {key: context.metrics[key] for key in ("psnr", "steps", "views")}
