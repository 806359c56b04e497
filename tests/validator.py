"""Khronos' glTF validator, which runs on node: installed once into .cache."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / ".cache" / "gltf-validator"


def issues(path: Path) -> dict[str, Any]:
    """Return what the validator says of a file; skips the test where there is no npm."""
    if shutil.which("npm") is None:
        pytest.skip("the Khronos validator runs on node")
    if not (FOLDER / "node_modules" / "gltf-validator").is_dir():
        FOLDER.mkdir(parents=True, exist_ok=True)
        (FOLDER.parent / ".gitignore").write_text("*\n")
        subprocess.run(["npm", "install", "--silent", "--no-save", "gltf-validator"], cwd=FOLDER, check=True)
    command = ["node", str(ROOT / "tests" / "gltf_validator.mjs"), str(FOLDER), str(path)]
    found: dict[str, Any] = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    return found
