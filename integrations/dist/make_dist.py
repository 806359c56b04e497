"""`make dist`: a folder that installs the program on machines without a network.

build/dist/ gets the wheel with its model, the wheels of everything that it needs on this kind of machine (same
system, processor and Python), their checksums, and install.sh. pip's settings decide from where they come.
"""

import contextlib
import hashlib
import importlib.metadata
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent
TARGET = ROOT / "build" / "dist"
PARTS = ("pipeline", "export", "onnx_models", "pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE")
EXTRAS = "serve"


def build_wheel(wheels: Path) -> Path:
    """Build the project's wheel into a folder, from a copy: setuptools would take over what it built before."""
    with tempfile.TemporaryDirectory() as scratch:
        for name in PARTS:
            source = ROOT / name
            ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
            if source.is_dir():
                shutil.copytree(source, Path(scratch, name), ignore=ignored)
            else:
                shutil.copy2(source, scratch)
        _pip("wheel", "--no-deps", "--wheel-dir", wheels, scratch)
    (made,) = wheels.glob("latent_nerf_onnx-*.whl")
    return made


def collect(wheel: Path, wheels: Path) -> None:
    """Add the wheels of everything that a wheel of ours needs, in the versions that are installed here."""
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as pins:
        for one in importlib.metadata.distributions():
            if one.name and one.name != "latent-nerf-onnx":
                # A local version, such as +cpu, is this machine's own: any build of the version will do.
                pins.write(f"{one.name}=={one.version.partition('+')[0]}\n")
        pins.flush()
        # What has no wheel is built here.
        _pip("wheel", "--wheel-dir", wheels, "--constraint", pins.name, f"{wheel}[{EXTRAS}]")
    # The packages that every installation needs.
    _pip("download", "--no-deps", "--dest", wheels, "pip", "setuptools", "wheel")


def write_checksums(folder: Path) -> int:
    """Write SHA256SUMS of all files below a folder; return their number."""
    files = sorted(file for file in folder.rglob("*") if file.is_file() and file.name != "SHA256SUMS")
    lines = []
    for file in files:
        with file.open("rb") as stream:
            lines.append(f"{hashlib.file_digest(stream, 'sha256').hexdigest()}  {file.relative_to(folder).as_posix()}\n")
    (folder / "SHA256SUMS").write_text("".join(lines), encoding="utf-8")
    return len(lines)


def main() -> int:
    """Make the folder anew."""
    with contextlib.suppress(FileNotFoundError):
        shutil.rmtree(TARGET)
    wheels = TARGET / "wheels"
    wheels.mkdir(parents=True)
    print("building the wheel, and collecting what it needs (some minutes) ...", file=sys.stderr)
    try:
        collect(build_wheel(wheels), wheels)
    except subprocess.CalledProcessError as error:
        print(f"error: {' '.join(map(str, error.cmd))} ended with status {error.returncode}", file=sys.stderr)
        return 1
    shutil.copy2(HERE / "install.sh", TARGET / "install.sh")
    count = write_checksums(TARGET)
    size = sum(file.stat().st_size for file in TARGET.rglob("*") if file.is_file())
    print(f"{count} files, {size / 1e6:.0f} MB: copy the folder, then sh install.sh")
    print(TARGET.relative_to(ROOT))
    return 0


def _pip(command: str, *arguments: object) -> None:
    words = [sys.executable, "-m", "pip", command, "--quiet", "--disable-pip-version-check", *map(str, arguments)]
    subprocess.run(words, check=True, env={**os.environ, "PIP_PROGRESS_BAR": "off"}, stdout=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
