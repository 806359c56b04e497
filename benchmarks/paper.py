"""Every prompt of the paper, in its mode, into docs/gallery.md: nothing selected, nothing retouched.

    make bench ONLY=paper

Text alone, Sketch-Shape with the sketches of examples/, and Latent-Paint on meshes that stand for the
paper's: shapes of the training data's makers that no training saw, under build/paper/meshes. The paper
refines in RGB; here a few prompts of each mode are refined once more with REFINE=1. All with the default
model, `standard` quality and seed 0, two at a time on one thread each; runs are kept under build/paper, so
that a second call makes only what is missing. What came out wrong is written by hand, about the pictures of
the present model, into results/paper-remarks.json: {"a giraffe": "five legs", "a giraffe (REFINE=1)": "..."}.
"""

import io
import json
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from jaxtyping import UInt8
from PIL import Image

from benchmarks._pool import at_once
from benchmarks._results import Result, make_result, tiled
from benchmarks._tables import markdown
from export.everyday_objects.data.kinds import BY_WORD
from export.everyday_objects.data.shapes import assemble
from pipeline.errors import InputError

RUNS, SKETCHES, DOCS = Path("build/paper"), Path("examples/sketches"), Path("docs")
MESHES = RUNS / "meshes"
TILE = 160
"""Side of a view [pixels]."""
MOST_BYTES = 60_000
"""Of a picture."""
NOT_LOOKED_AT = "not looked at yet"
TEXT, SKETCH, MESH = "Text", "Sketch-Shape", "Latent-Paint"


class Case(NamedTuple):
    """One prompt of the paper."""

    mode: str
    prompt: str
    shape: str = ""
    """Name of its sketch in `SKETCHES`, or main word of the kind whose shape is painted."""
    refine: bool = False

    def title(self) -> str:
        """What remarks call it."""
        return f"{self.prompt} (REFINE=1)" if self.refine else self.prompt

    def variables(self, meshes: Path = MESHES) -> dict[str, str]:
        """What a user would say to `make run`."""
        given = {"PROMPT": self.prompt}
        if self.mode == SKETCH:
            given["SKETCH"] = str(SKETCHES / f"{self.shape}.obj")
        if self.mode == MESH:
            given["MESH"] = str(mesh_path(meshes, self.shape))
        return {**given, "REFINE": "1"} if self.refine else given


CASES = (
    Case(TEXT, "a stack of pancakes covered in maple syrup"),
    Case(TEXT, "a highly detailed sandcastle"),
    Case(TEXT, "a giraffe"),
    Case(TEXT, "a vase with sunflowers"),
    Case(TEXT, "a basket with fruits"),
    Case(TEXT, "a castle made of cheesecake surrounded by a moat made of ice cream"),
    Case(TEXT, "a vase with pink flowers"),
    Case(TEXT, "a hamburger"),
    Case(TEXT, "a squirrel"),
    Case(TEXT, "ice cream"),
    Case(TEXT, "a temple"),
    Case(TEXT, "a giraffe", refine=True),
    Case(TEXT, "a hamburger", refine=True),
    Case(SKETCH, "a deer", "animal"),
    Case(SKETCH, "a German Shepherd", "animal"),
    Case(SKETCH, "a pig", "animal"),
    Case(SKETCH, "a house made of lego", "house"),
    Case(SKETCH, "a gingerbread house", "house"),
    Case(SKETCH, "a gothic house", "house"),
    Case(SKETCH, "a house made of candy", "house"),
    Case(SKETCH, "a robot hand", "hand"),
    Case(SKETCH, "a teddy bear in a tuxedo", "teddy_bear"),
    Case(SKETCH, "a lego man", "lego_man"),
    Case(SKETCH, "a sports car", "car"),
    Case(SKETCH, "a lego man", "lego_man", refine=True),
    Case(MESH, "a wooden brown cabinet", "cabinet"),
    Case(MESH, "a steel cabinet", "cabinet"),
    Case(MESH, "a next gen nascar", "race car"),
    Case(MESH, "a black grand piano", "grand piano"),
    Case(MESH, "a pink grand piano", "grand piano"),
    Case(MESH, "a garden gnome with a red hat", "garden gnome"),
    Case(MESH, "a garden gnome with a green hat", "garden gnome"),
    Case(MESH, "a black boot", "boot"),
    Case(MESH, "a blue converse allstar shoe", "shoe"),
    Case(MESH, "an UGG boot", "boot"),
    Case(MESH, "a piranha fish", "piranha"),
    Case(MESH, "a fish with leopard spots", "fish"),
    Case(MESH, "a goldfish", "fish"),
    Case(MESH, "a next gen nascar", "race car", refine=True),
    Case(MESH, "a goldfish", "fish", refine=True),
)


def mesh_path(meshes: Path, word: str) -> Path:
    """Return where the mesh of a kind is written."""
    return meshes / f"{slug(word)}.obj"


def slug(text: str) -> str:
    """Return a text as a part of a file's name: a-z, 0-9 and dashes."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


def held_out_mesh(word: str) -> trimesh.Trimesh:
    """Return the first shape of a kind that no training saw, in a ball of radius 0.75, vertices merged."""
    kind = BY_WORD[word]
    shape = assemble(kind.make(np.random.default_rng(kind.variants)))
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    mesh.merge_vertices()
    return mesh


def write_meshes(meshes: Path, words: Sequence[str]) -> None:
    """Write the shapes of kinds as OBJ files without texture coordinates, the same bytes every time."""
    meshes.mkdir(parents=True, exist_ok=True)
    for word in words:
        text = held_out_mesh(word).export(file_type="obj", include_normals=False, include_texture=False)
        mesh_path(meshes, word).write_text(str(text), encoding="ascii")


def command(case: Case) -> str:
    """Return what a user would type."""
    return " ".join(["make run", *(quoted(*pair) for pair in case.variables().items())])


def quoted(name: str, value: str) -> str:
    """Return a variable for the shell, in double quotes where it needs some and they do."""
    plain = shlex.quote(value) == value or set(value) & set('"$`\\!')
    return f"{name}={shlex.quote(value)}" if plain else f'{name}="{value}"'


def picture_name(number: int, case: Case) -> str:
    """Return the file of a case's picture, cases counted from 1."""
    return f"{number:02d}-{slug(case.title())}.jpg"


def small_jpeg(picture: UInt8[np.ndarray, "h w 3"], most: int = MOST_BYTES) -> bytes:
    """Return a JPEG of at most so many bytes: as good as fits.

    Raises:
        ValueError: even the worst is larger.
    """
    for quality in (92, 85, 75, 60, 40, 20):
        file = io.BytesIO()
        Image.fromarray(picture).save(file, format="JPEG", quality=quality, optimize=True)
        if file.tell() <= most:
            return file.getvalue()
    raise ValueError(f"a picture of {picture.shape} does not fit into {most} bytes")


def read_remarks(text: str, cases: Sequence[Case] = CASES) -> dict[str, str]:
    """Return the remarks by title.

    Raises:
        InputError: one is about no case.
    """
    remarks: dict[str, str] = json.loads(text)
    if unknown := sorted(set(remarks) - {case.title() for case in cases}):
        raise InputError(f"paper-remarks.json speaks of {', '.join(unknown)}, which is no prompt here")
    return remarks


def gallery(cases: Sequence[Case], results: Sequence[Result], remarks: Mapping[str, str]) -> str:
    """Return the page: which modes and which refined, then a table a mode in the order of the cases."""
    rows = list(zip(range(1, len(cases) + 1), cases, results, strict=True))
    modes = list(dict.fromkeys(case.mode for case in cases))
    overview = markdown(("mode", "prompts", "once more with REFINE=1"), [counts(m, cases) for m in modes])
    parts = [
        "# Every prompt of the paper",
        "`make bench ONLY=paper` wrote this page: the bundled model, `standard` quality, seed 0, each run "
        "once, nothing selected. Six views each: front, front right, right; back, left, from above. Seconds "
        "are those of one thread while another run had the other core. The meshes of Latent-Paint stand for "
        "the paper's and are written by the same command.",
        overview.strip(),
    ]
    for mode in modes:
        lines = [table_line(*row, remarks) for row in rows if row[1].mode == mode]
        parts += [
            f"## {mode}",
            markdown(("six views", "command", "seconds", "what came out wrong"), lines).strip(),
        ]
    return "\n\n".join(parts) + "\n"


def counts(mode: str, cases: Sequence[Case]) -> tuple[str, int, str]:
    """Return a line of the overview: the mode, how many prompts, which are refined."""
    own = [case for case in cases if case.mode == mode]
    refined = ", ".join(case.prompt for case in own if case.refine)
    return mode, sum(not case.refine for case in own), refined or "none"


def table_line(number: int, case: Case, result: Result, remarks: Mapping[str, str]) -> tuple[str, ...]:
    """Return a case's line of the page: picture, command, seconds, remark."""
    wrong = f"no asset: {result.fault}" if result.fault else remarks.get(case.title(), NOT_LOOKED_AT)
    return (
        f"![{case.title()}](gallery/{picture_name(number, case)})",
        f"`{command(case)}`",
        "" if result.fault else f"{result.seconds:.0f}",
        wrong.replace("|", "\\|").replace("\n", " "),
    )


def write_gallery(
    docs: Path, cases: Sequence[Case], results: Sequence[Result], remarks: Mapping[str, str]
) -> None:
    """Write docs/gallery.md and its pictures; pictures of former cases go."""
    folder = docs / "gallery"
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("[0-9][0-9]-*.jpg"):
        old.unlink()
    for number, (case, result) in enumerate(zip(cases, results, strict=True), 1):
        (folder / picture_name(number, case)).write_bytes(small_jpeg(tiled(result.views, 3)))
    (docs / "gallery.md").write_text(gallery(cases, results, remarks), encoding="utf-8")


def summary(cases: Sequence[Case], results: Sequence[Result]) -> dict[str, Any]:
    """Return how many runs, refined and failed ones among them, and the seconds of those that ended."""
    seconds = [result.seconds for result in results if not result.fault]
    return {
        "runs": len(cases),
        "prompts": len({(case.mode, case.prompt) for case in cases}),
        "refined": sum(case.refine for case in cases),
        "failed": sum(bool(result.fault) for result in results),
        "seconds": round(sum(seconds), 1),
        "median_seconds": round(float(np.median(seconds)), 1) if seconds else 0.0,
    }


def main(folder: Path) -> dict[str, Any]:
    """Make all runs, write the gallery, return the figures; `folder` holds the remarks."""
    path = folder / "paper-remarks.json"
    remarks = read_remarks(path.read_text(encoding="utf-8")) if path.is_file() else {}
    write_meshes(MESHES, sorted({case.shape for case in CASES if case.mode == MESH}))
    results = at_once(make_result, [(case.variables(), RUNS, TILE) for case in CASES], "runs")
    write_gallery(DOCS, CASES, results, remarks)
    rows = [
        {
            "mode": case.mode,
            "prompt": case.title(),
            "seconds": round(result.seconds, 1),
            "fault": result.fault,
        }
        for case, result in zip(CASES, results, strict=True)
    ]
    return {"summary": summary(CASES, results), "rows": rows}
