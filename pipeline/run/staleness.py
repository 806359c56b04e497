"""Whether a stage has to run again: its key, and the entry that records how its outputs were made.

The key is a hash of everything that a stage's outputs depend on: its options, its source files (the modules
it imports, transitively), the versions of the packages these import, and the contents of its inputs.
"""

import ast
import contextlib
import functools
import hashlib
import importlib.metadata
import json
import os
import platform
import sys
from pathlib import Path
from typing import Any

from pipeline.documents import read_json
from pipeline.errors import InputError
from pipeline.files import file_sha256

ROOT = Path(__file__).resolve().parents[2]
# Where a package's name on the index differs from the name it is imported by.
DISTRIBUTIONS = {
    "cv2": "opencv-contrib-python-headless",
    "PIL": "pillow",
    "igl": "libigl",
    "mapbox_earcut": "mapbox-earcut",
    "pxr": "usd-core",
    "resvg_py": "resvg-py",
    "skimage": "scikit-image",
    "yaml": "pyyaml",
}
Entry = dict[str, Any]


def imports(source: str, package: str) -> set[str]:
    """Return the absolute dotted names that a module's source imports anywhere, with names imported from a
    module appended to it (they may be submodules). `package` resolves relative imports."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join(
                    [*package.split(".")[: len(package.split(".")) - node.level + 1], *filter(None, [base])]
                )
            found |= {base} | {f"{base}.{alias.name}" for alias in node.names}
    return found


def sources(module: str, root: Path = ROOT) -> tuple[list[Path], set[str]]:
    """Return the source files of a module's import closure inside its own top-level package, sorted, and the
    third-party packages that these import."""
    top = module.partition(".")[0]
    files: dict[str, Path] = {}
    packages: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in files:
            continue
        if name.partition(".")[0] != top:
            packages.add(name.partition(".")[0])
            continue
        base = root.joinpath(*name.split("."))
        path = base / "__init__.py" if base.is_dir() else base.with_suffix(".py")
        if not path.is_file():
            continue  # an attribute of a module, not a module
        files[name] = path
        parent = name.rpartition(".")[0]
        waiting += [parent] if parent else []
        waiting += _imports_of(path, name if base.is_dir() else parent, path.stat().st_mtime_ns)
    return sorted(files.values()), packages - set(sys.stdlib_module_names)


@functools.cache
def _imports_of(path: Path, package: str, changed: int) -> set[str]:
    """Return what a source file, last changed then [ns], imports: the stages share most of their files."""
    return imports(path.read_text(encoding="utf-8"), package)


@functools.cache
def _version(package: str) -> str:
    """Return the version of the distribution that a package comes from: the usual one, or others that were
    installed in its stead (onnxruntime-gpu for onnxruntime), by their names."""
    try:
        return importlib.metadata.version(DISTRIBUTIONS.get(package, package))
    except importlib.metadata.PackageNotFoundError:
        others = sorted(set(importlib.metadata.packages_distributions().get(package, ())))
        return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in others)


@functools.cache
def code(module: str, root: Path = ROOT) -> tuple[str, dict[str, str]]:
    """Return the hash of a module's import closure and the versions of Python and the packages it uses."""
    files, packages = sources(module, root)
    digest = hashlib.sha256()
    for path in files:
        digest.update(f"{path.relative_to(root).as_posix()}\0{file_sha256(path)}\n".encode())
    versions = {"python": platform.python_version()}
    for package in sorted(packages):
        versions[DISTRIBUTIONS.get(package, package)] = _version(package)
    return digest.hexdigest(), versions


def key(options: dict[str, Any], module: str, inputs: dict[str, str]) -> str:
    """Return the key of a stage: `inputs` maps every input's name to its sha256."""
    source, versions = code(module)
    parts = {"options": options, "source": source, "versions": versions, "inputs": inputs}
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def entry_path(run: Path, stage: str) -> Path:
    """Return the file of a stage's entry."""
    return run / "stages" / f"{stage}.json"


def read_entry(run: Path, stage: str) -> Entry | None:
    """Return a stage's entry, or None where there is none that can be read."""
    try:
        entry = read_json(entry_path(run, stage), "")
    except InputError:
        return None
    return entry if _is_entry(entry) else None


def _is_entry(entry: Entry) -> bool:
    """Whether it has what the pipeline reads of entries; files it names are in the run's folder."""
    kinds = {"key": str, "outputs": dict, "inputs": dict, "metrics": dict}
    if not all(isinstance(entry.get(name), kind) for name, kind in kinds.items()):
        return False
    if not all(type(entry.get(name)) in (int, float) for name in ("seconds", "peak_memory_mb")):
        return False
    files = [*entry["outputs"].values(), *entry["inputs"].values()]
    if not all(isinstance(f, dict) and {type(f.get("path")), type(f.get("sha256"))} == {str} for f in files):
        return False
    paths = [Path(output["path"]) for output in entry["outputs"].values()]
    return not any(path.is_absolute() or ".." in path.parts for path in paths)


def damaged(run: Path, entry: Entry) -> list[str]:
    """Return the names of the outputs that are not as the entry says, each with what is wrong."""
    faults = []
    for output in entry["outputs"].values():
        path = run / output["path"]
        if not path.is_file():
            faults.append(f"{output['path']} is missing")
        elif path.stat().st_size == 0:
            faults.append(f"{output['path']} is empty")
        elif file_sha256(path) != output["sha256"]:
            faults.append(f"{output['path']} was changed")
    return faults


def twin(run: Path, stage: str, key: str) -> Path | None:
    """Return the newest sibling run that holds intact outputs of this stage under this key, or None.

    Siblings that cannot be read, or that someone is deleting, are passed over.
    """
    found = []
    for candidate in run.parent.glob(f"*/stages/{stage}.json"):
        sibling = candidate.parents[1]
        entry = read_entry(sibling, stage)
        if not sibling.is_symlink() and sibling != run and entry and entry["key"] == key:
            with contextlib.suppress(OSError):
                found.append((os.path.getmtime(candidate), sibling, entry))
    for _, sibling, entry in sorted(found, key=lambda one: one[0], reverse=True):
        with contextlib.suppress(OSError, KeyError, TypeError, AttributeError):
            if not damaged(sibling, entry):
                return sibling
    return None
