# What both chains share: where the model is, and how a stage is called.
# update(): Snakemake leaves an existing output alone, so that a stage that finds it valid can keep it.
import os
import sys
from pathlib import Path
from urllib.parse import unquote

from pipeline.mesh.file_checks import buffer_files


def relative(path):
    """Relative paths keep this machine's folders out of every entry."""
    return os.path.relpath(path, unquote(config["run"]))


folder = unquote(config["bundle"])
bundle = relative(folder).replace("{", "{{").replace("}", "}}")  # braces would be wildcards
described = os.path.exists(os.path.join(folder, "bundle.json"))
description = {"description": f"{bundle}/bundle.json"} if described else {}
optional = {name: f"{bundle}/{name}" for name in ("vae_encoder", "vae_encoder_vjp")
            if os.path.isdir(os.path.join(folder, name))}
encoder = {name: path for name, path in optional.items() if name == "vae_encoder"}
# A comma inside a path is percent-encoded.
tokens = {f"token{i}": relative(unquote(path))
          for i, path in enumerate(filter(None, str(config.get("tokens", "")).split(",")))}
STAGES = config["stages"].split("+")


def named_files(wildcards, input, output):
    return [f"--input={name}={path}" for name, path in input.items()] + [
        f"--output={name}={path}" for name, path in output.items() if name != "entry"]


def given_files(name):
    """Return the parameter that names a file of the user, and the buffers of a .gltf. They are no inputs to
    Snakemake, which would take braces in a path for wildcards; the plan looks at their contents, and has the
    stage run when these changed."""
    path = unquote(config[name])
    return given({name: path} | {f"buffer{i}": buffer for i, buffer in enumerate(buffer_files(Path(path)))})


def given(files):
    arguments = [f"--input={label}={relative(file)}" for label, file in files.items()]
    return lambda wildcards: arguments


def start_files():
    """Return the parameter that names the files of what START names."""
    named = (part.partition("=") for part in str(config["start"]).split(","))
    return given({label: unquote(path) for label, _, path in named})


PYTHON = sys.executable
FILES = "--job job.yaml {params.files:q}"
WARM = "exec {PYTHON:q} -m pipeline.run.stage_server {rule} " + FILES
COLD = "exec {PYTHON:q} -m pipeline.stages.{rule} " + FILES  # a stage that need not wait for torch


rule all:
    input: "report.html", "manifest.json"

rule embed:
    input:
        **description, **encoder, **tokens, text_encoder=f"{bundle}/text_encoder",
        tokenizer=f"{bundle}/tokenizer"
    output: embeddings=update("embeddings.npz"), entry=update("stages/embed.json")
    params: files=named_files
    threads: config["threads"]
    shell: COLD
