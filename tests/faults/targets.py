"""What a stranger's file reaches: for every format that is read, files that are whole, and what reads them.

A reader either ends, or raises InputError in one line. Anything else is a fault.
"""

import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
import trimesh
from PIL import Image, ImageDraw
from safetensors.numpy import save

from pipeline import arrays
from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.graphs import open_graph
from pipeline.diffusion.schedule import load_schedule
from pipeline.diffusion.token_files import read_token
from pipeline.diffusion.tokenizer import load_tokenizer
from pipeline.mesh.coloured import read_coloured
from pipeline.mesh.mesh import Mesh
from pipeline.mesh.readers import read_mesh
from pipeline.nerf.field import FieldShape, LatentField
from pipeline.nerf.occupancy import Occupancy
from pipeline.nerf.scene import Scene, load_scene, to_arrays
from pipeline.options import job as jobs
from pipeline.options.paint import Prepare
from pipeline.paint.given_mesh import to_unit_ball
from pipeline.run.staleness import read_entry
from pipeline.run.verify import verify
from pipeline.sketch.reading import read_sketch
from pipeline.stages import prepare
from pipeline.training.background import FlatBackground
from tests.faults import hostile
from tests.tiny_bundle import write_tiny_bundle


class Target(NamedTuple):
    """A format: the name a file has, files that are whole, and what reads one."""

    file: str
    seeds: list[bytes]
    read: Callable[[Path], object]


def targets(work: Path) -> dict[str, Target]:
    """Return all of them; `work` gets a model that bundles' files are exchanged in."""
    write_tiny_bundle(work / "model")
    model = work / "model"
    described = json.loads((model / "bundle.json").read_text())
    (model / "bundle.json").write_text(json.dumps({**described, "files": {}}))
    found = {name: Target(f"case.{name}", seeds, prepare_mesh) for name, seeds in _meshes().items()}
    found["scene"] = Target("case.npz", [_scene()], load_scene)
    found["start"] = Target("case.gltf", [hostile.textured_gltf(_pngs()[0])], read_coloured)
    found["svg"] = Target("case.svg", _svgs(), lambda path: read_sketch(path, 0.3))
    found["png"] = Target("case.png", _pngs(), lambda path: read_sketch(path, 0.3))
    vectors = np.random.default_rng(0).standard_normal((2, 16)).astype(np.float32)
    found["safetensors"] = Target(
        "case.safetensors", [save({"<mine>": vectors}), save({"emb_params": vectors})], read_token
    )
    found["pt"] = Target("case.pt", _torch_files(vectors), read_token)
    found["bin"] = Target("case.bin", _torch_files(vectors), read_token)
    found["yaml"] = Target("case.yaml", [jobs.to_yaml(jobs.Job(prompt="a ball")).encode()], _job)
    entry = {
        "key": "k", "options": {}, "inputs": {"a": {"path": "a", "sha256": "0"}}, "metrics": {},
        "outputs": {"a": {"path": "a", "sha256": "0"}}, "seconds": 1.0, "peak_memory_mb": 1.0,
    }  # fmt: skip
    found["entry"] = Target("clean.json", [json.dumps(entry).encode()], _entry)
    manifest = json.dumps({"files": {"asset.glb": {"sha256": "0" * 64}}}).encode()
    found["manifest"] = Target("manifest.json", [manifest], lambda path: verify(path.parent))
    for place in (
        "bundle.json", "unet/config.json", "scheduler/scheduler_config.json", "tokenizer/vocab.json",
        "tokenizer/merges.txt", "tokenizer/tokenizer_config.json", "tokenizer/special_tokens_map.json",
        "unet/model.onnx", "vae_decoder/model.onnx",
    ):  # fmt: skip
        found[place] = Target(place, [(model / place).read_bytes()], _in_bundle(model, place))
    return found


def prepare_mesh(path: Path, most: int = 2000) -> None:
    """Read a mesh as the stage `prepare` does; up to so many faces, give it texture coordinates too (xatlas
    takes its time), at a small resolution."""
    given = read_mesh(path)
    if len(given.faces) > most:
        return
    unit = to_unit_ball(given, "+y", "+z")
    prepare.check_seen(unit, given.faces, path)
    prepare.coordinates(Mesh(unit, given.faces, given.uv, given.uv_faces), Prepare(resolution=128), [])


def _job(path: Path) -> None:
    jobs.resolve({"JOB": str(path), "PROMPT": "x"})


def _entry(path: Path) -> None:
    run = path.parent / "run"
    (run / "stages").mkdir(parents=True)
    os.replace(path, run / "stages" / "clean.json")
    read_entry(run, "clean")


def _in_bundle(model: Path, place: str) -> Callable[[Path], None]:
    """Return a reader of the model with one file exchanged, as the front door and the stages read it."""

    def read(path: Path) -> None:
        root = path
        for _ in Path(place).parts:
            root = root.parent
        for file in model.rglob("*"):
            mine = root / file.relative_to(model)
            if file.is_file() and not mine.exists():
                mine.parent.mkdir(parents=True, exist_ok=True)
                mine.symlink_to(file)
        open_bundle(root, verify=False)
        if place.startswith("tokenizer"):
            load_tokenizer(root / "tokenizer").encode("a red ball")
        elif place.startswith("scheduler"):
            load_schedule(root / "scheduler")
        elif place.endswith(".onnx"):
            with open_graph(path.parent, threads=1):
                pass
        else:
            jobs.resolve({"PROMPT": "x", "MODEL": str(root)})

    return read


def _meshes() -> dict[str, list[bytes]]:
    ball = trimesh.creation.icosphere(1)
    box = trimesh.creation.box()
    textured = (
        b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\no a\nusemtl b\n"
    )
    textured += b"f 1/1 2/2 3/3 4/4\nf -4//1 -3//1 -2//1 # it\n"
    found = {
        kind: [_bytes(mesh.export(file_type=kind)) for mesh in (ball, box)] for kind in ("ply", "off", "stl")
    }
    found["obj"] = [textured, _bytes(box.export(file_type="obj"))]
    found["ply"].append(_bytes(box.export(file_type="ply", encoding="ascii")))
    found["stl"].append(_bytes(box.export(file_type="stl_ascii")))
    found["glb"] = [_bytes(trimesh.Scene({"ball": ball, "box": box}).export(file_type="glb"))]
    found["gltf"] = [hostile.gltf(), hostile.gltf(nodes=[{"children": [1]}, {"mesh": 0, "scale": [1, 2, 3]}])]
    return found


def _scene() -> bytes:
    rng = np.random.default_rng(0)
    field = LatentField(FieldShape(levels=2, coarsest=2, finest=4, table_log2=6), rng)
    grid = Occupancy(np.zeros((4, 4, 4), np.float32), np.ones((4, 4, 4), np.bool_))
    return arrays.pack(to_arrays(Scene(field, grid, FlatBackground(np.zeros((1, 4), np.float32)), 8)))


def _svgs() -> list[bytes]:
    return [
        hostile.svg('<path d="M10 10h50v50z M20 20L30 30 40 20z"/><circle r="9" cx="60" cy="70"/>'),
        hostile.svg('<defs><clipPath id="c"><rect width="9" height="9"/></clipPath><filter id="f">'
                    '<feGaussianBlur stdDeviation="2"/><feMorphology radius="1"/></filter></defs>'
                    '<g clip-path="url(#c)" filter="url(#f)" transform="rotate(3)"><use href="#c"/>'
                    '<rect width="50" height="50" stroke-dasharray="1 2"/></g>'),
    ]  # fmt: skip


def _pngs() -> list[bytes]:
    found = []
    for mode in ("RGBA", "L", "P"):
        image = Image.new(mode, (40, 30))
        image.putpalette([0, 0, 0, 255, 255, 255]) if mode == "P" else None
        ImageDraw.Draw(image).rectangle([9, 9, 25, 20], fill=1 if mode == "P" else "white")
        stream = io.BytesIO()
        image.save(stream, "PNG")
        found.append(stream.getvalue())
    return found


def _torch_files(vectors: np.ndarray) -> list[bytes]:
    tensor = torch.from_numpy(vectors)
    values = ({"<mine>": tensor}, {"string_to_param": {"*": tensor}, "name": "mine"})
    found = []
    for value in values:
        for archive in (True, False):
            stream = io.BytesIO()
            torch.save(value, stream, _use_new_zipfile_serialization=archive)
            found.append(stream.getvalue())
    return found


def _bytes(written: str | bytes) -> bytes:
    return written if isinstance(written, bytes) else written.encode()
