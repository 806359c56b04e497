"""Who may import what, and what a user's environment holds."""

import ast
import graphlib
import importlib.metadata
import re
import subprocess
import sys
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

from pipeline.run.staleness import DISTRIBUTIONS, imports

ROOT = Path(__file__).resolve().parents[1]
EXPORT_ONLY = {"diffusers", "transformers"}


def imported(path: Path) -> set[str]:
    """Return the top-level packages that a file imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add((node.module or "").partition(".")[0])
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("import_module", "__import__")):
            found |= {str(a.value).partition(".")[0] for a in node.args if isinstance(a, ast.Constant)}
    return found


def python_files(folder: str) -> list[Path]:
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    return files


def test_only_export_knows_diffusers_and_transformers_and_pipeline_never_imports_export() -> None:
    for path in python_files("pipeline"):
        assert not imported(path) & (EXPORT_ONLY | {"export", "tests", "onnx"}), path


def test_only_pipeline_diffusion_opens_onnxruntime() -> None:
    users = {
        path.relative_to(ROOT).parent.as_posix()
        for path in python_files("pipeline")
        if "onnxruntime" in imported(path)
    }
    assert users == {"pipeline/diffusion"}


ROOMS = [
    ["__main__"],
    ["api", "cli", "server"],
    ["stages"],
    ["report"],
    ["run"],
    ["nerf", "paint"],
    ["diffusion"],
    ["training"],
    ["formats", "sketch"],
    ["mesh"],
    ["options"],
    ["kernels"],
    ["documents", "stand_ins"],
    ["arrays", "cameras", "files", "progress"],
    ["errors"],
]
"""From top to bottom: who is in a row imports only what is in its own room, or in a row below."""


def test_rooms_import_only_what_is_below_them() -> None:
    row = {room: number for number, rooms in enumerate(ROOMS) for room in rooms}
    for path in python_files("pipeline"):
        own = path.relative_to(ROOT / "pipeline").with_suffix("").parts[0]
        if own == "__init__":
            continue
        for name in imports(path.read_text(encoding="utf-8"), ""):
            package, _, rest = name.partition(".")
            room = rest.partition(".")[0]
            if package == "pipeline" and rest and room != own:
                assert row[own] < row[room], f"{path.relative_to(ROOT)} imports {name}"


def test_no_stage_imports_a_stage_and_no_module_imports_itself_round_a_circle() -> None:
    def above(path: Path) -> set[Path]:
        found = set()
        for name in imports(path.read_text(encoding="utf-8"), ""):
            file = ROOT.joinpath(*name.split(".")).with_suffix(".py")
            if name.startswith("pipeline.") and file.is_file():
                found.add(file)
        return found

    graph = {path: above(path) for path in python_files("pipeline") if path.name != "__init__.py"}
    for path, below in graph.items():
        if path.parent.name == "stages":
            assert not [file for file in below if file.parent.name == "stages"], path
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError


def test_whatever_is_public_is_documented_and_no_file_is_long() -> None:
    for path in [*python_files("pipeline"), *python_files("export"), *python_files("benchmarks")]:
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        inside = [node for top in tree.body if isinstance(top, ast.ClassDef) for node in top.body]
        named = [n for n in (*tree.body, *inside) if isinstance(n, ast.FunctionDef | ast.ClassDef)]
        for node in (tree, *(n for n in named if not n.name.startswith("_"))):
            assert ast.get_docstring(node), f"{path.relative_to(ROOT)}: {getattr(node, 'name', 'the module')}"
        assert len(text.splitlines()) <= 350, path


def test_ruff_enforces_the_same_bans() -> None:
    for module in [*sorted(EXPORT_ONLY), "onnxruntime"]:
        command = [sys.executable, "-m", "ruff", "check", "--select", "TID251", "--stdin-filename"]
        for name, allowed in {
            "pipeline/nerf/x.py": False,
            "pipeline/x.py": False,
            "export/x.py": True,
        }.items():
            result = subprocess.run(
                [*command, name, "-"],
                input=f"import {module}\n",
                text=True,
                cwd=ROOT,
                capture_output=True,
                check=False,
            )
            assert (result.returncode == 0) == allowed, (module, name, result.stdout)


def runtime_closure(*extras: str) -> set[str]:
    """Return every distribution that installing the project brings, by its normalised name."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    optional = [text for extra in extras for text in project["optional-dependencies"][extra]]
    waiting = [Requirement(text) for text in [*project["dependencies"], *optional]]
    found: set[tuple[str, str]] = set()
    while waiting:
        requirement = waiting.pop()
        name = re.sub(r"[-_.]+", "-", requirement.name).lower()
        for extra in ("", *requirement.extras):
            if (name, extra) in found:
                continue
            found.add((name, extra))
            for text in importlib.metadata.requires(name) or []:
                inner = Requirement(text)
                if inner.marker is None or inner.marker.evaluate({"extra": extra}):
                    waiting.append(inner)
    return {name for name, _ in found}


def test_the_runtime_environment_has_neither_diffusers_nor_transformers() -> None:
    closure = runtime_closure()
    assert {"torch", "numpy", "onnxruntime", "huggingface-hub"} <= closure, "the walk reaches indirect ones"
    assert not closure & {*EXPORT_ONLY, "accelerate", "optimum", "latent-nerf-onnx"}


def test_everything_the_pipeline_imports_is_in_the_runtime_environment() -> None:
    closure, serving, usd = runtime_closure(), runtime_closure("serve"), runtime_closure("usd")
    for path in python_files("pipeline"):
        # The page and its API are an extra, and so is USD.
        present = {"server": serving, "formats": usd}.get(path.parent.name, closure)
        for name in imported(path) - {"pipeline", *sys.stdlib_module_names}:
            assert DISTRIBUTIONS.get(name, name).replace("_", "-").lower() in present, (path, name)


def loaded_by(code: str) -> set[str]:
    """Return the top-level modules that a fresh interpreter holds after running code."""
    code += "\nimport sys; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return set(result.stdout.split())


def test_importing_every_module_loads_neither() -> None:
    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in python_files("pipeline")
        if path.name != "__main__.py"
    ]
    loaded = loaded_by("\n".join(f"import {name}" for name in modules))
    assert "torch" in loaded
    assert not loaded & EXPORT_ONLY


def test_the_front_door_is_light() -> None:
    """Deciding that there is nothing to do must not wait for torch."""
    loaded = loaded_by(
        "import pipeline.__main__, pipeline.run.plan, pipeline.run.engine, pipeline.diffusion.bundle"
    )
    assert not loaded & {"torch", "onnxruntime", "numba", "scipy", "snakemake", "pymeshlab"}
