# What both chains share: where the model is, and how a stage is called.
# update(): Snakemake leaves an existing output alone, so that a stage that finds it valid can keep it.
import os
import sys
from pathlib import Path
from urllib.parse import unquote

from pipeline.mesh.companion_files import buffer_files, image_files


def relative(path):
    """Relative paths keep this machine's folders out of every entry."""
    return os.path.relpath(path, unquote(config["run"]))


STAGES = config["stages"].split("+")
folder = unquote(config["bundle"])


def bundle(*names):
    """Return the files and folders of the bundle that a stage reads, and its description if there is one."""
    found = {name: os.path.join(folder, name) for name in names}
    description = os.path.join(folder, "bundle.json")
    return {"description": description, **found} if os.path.exists(description) else found


optional = [name for name in ("vae_encoder", "vae_encoder_vjp") if os.path.isdir(os.path.join(folder, name))]
encoder = [name for name in optional if name == "vae_encoder"]


def tokens():
    """Return the files of TOKEN. A comma inside a path is percent-encoded."""
    paths = filter(None, str(config.get("tokens", "")).split(","))
    return {f"token{i}": unquote(path) for i, path in enumerate(paths)}


def start_files():
    """Return the files of what START names."""
    named = (part.partition("=") for part in str(config["start"]).split(","))
    return {label: unquote(path) for label, _, path in named}


def given_files(name, pictures=False):
    """Return a file of the user, and the buffers (and pictures) of a .gltf."""
    path = unquote(config[name])
    found = {name: path} | {f"buffer{i}": buffer for i, buffer in enumerate(buffer_files(Path(path)))}
    if pictures:
        found |= {f"image{i}": image for i, image in enumerate(image_files(Path(path)))}
    return found


def files(*outside):
    """Return the parameter that names a stage's files: those of the run, which Snakemake knows as inputs and
    outputs, and those outside it, by label. These are no inputs to Snakemake, which would take braces in a path
    for wildcards; the plan looks at their contents, and has the stage run when these changed."""
    given = {label: relative(path) for group in outside for label, path in group.items()}

    def named(wildcards, input, output):
        return [f"--input={label}={path}" for label, path in (*given.items(), *input.items())] + [
            f"--output={label}={path}" for label, path in output.items() if label != "entry"]

    return named


PYTHON = sys.executable
FILES = "--job job.yaml {params.files:q}"
WARM = "exec {PYTHON:q} -m pipeline.run.stage_server {rule} " + FILES
COLD = "exec {PYTHON:q} -m pipeline.stages.{rule} " + FILES  # a stage that need not wait for torch


rule all:
    input: "report.html", "manifest.json"

rule embed:
    output: embeddings=update("embeddings.npz"), entry=update("stages/embed.json")
    params: files=files(bundle(*encoder, "text_encoder", "tokenizer"), tokens())
    threads: config["threads"]
    shell: COLD
