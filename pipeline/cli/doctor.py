"""What this machine can do and what is wrong with it, with what to do about each thing.

`checks` and `model_findings` look; `self_test` makes a small asset.
"""

import fcntl
import importlib.metadata
import json
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from pipeline.diffusion.bundle import open_bundle
from pipeline.diffusion.providers import present_providers
from pipeline.errors import InputError
from pipeline.options import job as jobs
from pipeline.options.models import DEFAULT_MODEL, known_models
from pipeline.run import engine
from pipeline.run.estimate import available_memory_mb
from pipeline.run.failures import install_hint

ROOM_MB = 2_000
"""Memory that a draft takes with room to spare [MB]."""
VECTOR_SETS = ("avx2", "fma", "f16c", "avx512f", "avx512_vnni", "amx_tile", "asimd", "sve")
SELF_TEST = """
prompt: a red armchair
quality: draft
train_nerf: {steps: 24}
extract: {resolution: 48, views: 6}
clean: {faces: 1000}
unwrap: {resolution: 256}
bake: {views: 4, texture: 256}
publish: {preview_size: 64, turntable_size: 64, turntable_frames: 4}
"""
"""A job with every stage, and little work in each."""


class Finding(NamedTuple):
    """A line of the doctor."""

    state: Literal["ok", "note", "wrong"]
    what: str
    found: str
    mend: str = ""
    """What to do about it."""


def checks(out: Path, usable_cores: int) -> Iterator[Finding]:
    """Give a finding a thing that a run depends on; `out`: where runs are kept."""
    yield _python()
    yield from _packages()
    yield from _libraries()
    yield from _processor(usable_cores)
    yield _memory()
    yield _disk(out)
    yield from _temporary()
    yield from _providers()
    yield _locks(out)


def _python() -> Finding:
    found = f"{platform.python_version()}, {platform.system()} {platform.machine()}, {sys.executable}"
    if sys.platform != "linux":
        return Finding("note", "Python", found, "tried on Linux only: see docs/deployment.md")
    return Finding("ok", "Python", found)


def _packages() -> Iterator[Finding]:
    """Compare what is installed with what the project asks for."""
    try:
        asked = importlib.metadata.requires("latent-nerf-onnx") or []
    except importlib.metadata.PackageNotFoundError:
        yield Finding(
            "wrong", "packages", "latent-nerf-onnx is not installed", "pip install -e . in the clone"
        )
        return
    missing, others, count = [], [], 0
    for line in asked:
        if "extra ==" in line:
            continue
        name, bounds = re.match(r"([A-Za-z0-9_.-]+)(.*)", line.partition(";")[0]).groups()  # type: ignore[union-attr]
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
            continue
        count += 1
        if not _within(version, bounds):
            others.append(f"{name} {version} (asked for {bounds.strip()})")
    if missing:
        mend = "give the command that installed the program again; for an onnxruntime for other devices: fine"
        yield Finding(
            "wrong" if set(missing) - {"onnxruntime"} else "note",
            "packages",
            f"no {', '.join(missing)}",
            mend,
        )
    if others:
        yield Finding(
            "note", "packages", "; ".join(others), "results may differ: install again in a new environment"
        )
    if not missing and not others:
        yield Finding("ok", "packages", f"{count} as asked for")
    torch = importlib.metadata.version("torch")
    cuda = [d.name for d in importlib.metadata.distributions() if (d.name or "").startswith("nvidia-")]
    if cuda and "+cpu" not in torch:
        yield Finding(
            "note",
            "torch",
            f"{torch} with {len(cuda)} CUDA packages, which nothing here uses",
            "the README has the command for the build without them; it saves some gigabytes",
        )


def _libraries() -> Iterator[Finding]:
    """Load the packages that need libraries of the system."""
    for name in ("pymeshlab", "cv2", "av"):
        try:
            import_module(name)
        except ImportError as error:
            yield Finding("wrong", "libraries", f"{name}: {error}", install_hint())


def _within(version: str, bounds: str) -> bool:
    """Say whether a version keeps to bounds such as ``>=2.2,<3``: by the numbers in it, as ours are
    written.
    """
    mine = _numbers(version)
    for bound in filter(None, (part.strip() for part in bounds.split(","))):
        sign, wanted = re.match(r"(==|>=|<=|<|>)\s*(.*)", bound).groups()  # type: ignore[union-attr]
        theirs = _numbers(wanted)
        same = mine[: len(theirs)] == theirs
        good = {
            "==": same,
            ">=": mine >= theirs,
            "<=": mine <= theirs or same,
            "<": mine < theirs,
            ">": mine > theirs,
        }
        if not good[sign]:
            return False
    return True


def _numbers(version: str) -> list[int]:
    return [int(part) for part in re.match(r"[0-9.]*", version)[0].split(".") if part]  # type: ignore[index]


def _processor(usable: int) -> Iterator[Finding]:
    text = Path("/proc/cpuinfo").read_text(encoding="utf-8") if Path("/proc/cpuinfo").exists() else ""
    name = next((m[1] for m in re.finditer(r"model name\s*: (.*)", text)), platform.processor() or "unknown")
    flags = set(
        (re.search(r"^(?:flags|Features)\s*: (.*)$", text, flags=re.MULTILINE) or ["", ""])[1].split()
    )
    sets = [one for one in VECTOR_SETS if one in flags]
    total = os.cpu_count() or 1
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    told = f"{name}; {usable} of {total} cores for this program; {' '.join(sets) or 'no vector sets known'}"
    slow = bool(flags) and platform.machine() == "x86_64" and "avx2" not in flags
    yield Finding(
        "note" if slow else "ok",
        "processor",
        told,
        "without AVX2 a run takes several times as long; in a virtual machine, pass the host's CPU on"
        if slow
        else "",
    )
    if load > 1.2 * total:
        yield Finding(
            "note", "load", f"{load:.1f} on {total} cores", "other programs compute: runs take longer"
        )


def _memory() -> Finding:
    free = available_memory_mb()
    if free is None:
        return Finding("note", "memory", "this system does not say")
    told = f"{free:.0f} MB for a stage"
    if free < ROOM_MB:
        return Finding(
            "wrong", "memory", told, f"a run takes 600 to 900 MB; leave it {ROOM_MB} MB: close programs"
        )
    return Finding("ok", "memory", told)


def _disk(out: Path) -> Finding:
    place = next(path for path in (out.absolute(), *out.absolute().parents) if path.exists())
    free = shutil.disk_usage(place).free
    told = f"{free / 1e9:.1f} GB free at {place}"
    if not os.access(place, os.W_OK):
        return Finding("wrong", "disk", f"{place} cannot be written to", "choose another folder with OUT=")
    return (
        Finding("ok", "disk", told)
        if free > engine.ENOUGH_DISK
        else Finding("wrong", "disk", told, "a run takes 50 MB and asks for 200: free some, or choose OUT=")
    )


def _temporary() -> Iterator[Finding]:
    try:
        with tempfile.NamedTemporaryFile() as file:
            file.write(b"x")
    except OSError as error:
        yield Finding("wrong", "temporary files", str(error), "set TMPDIR to a folder that can be written to")


def _providers() -> Iterator[Finding]:
    try:
        version, names = present_providers()
    except ImportError as error:
        yield Finding("wrong", "onnxruntime", str(error).splitlines()[0], "pip install onnxruntime again")
        return
    yield Finding("ok", "onnxruntime", f"{version}, PROVIDER={' or '.join(names)}")


def _locks(out: Path) -> Finding:
    """Try the lock that keeps two runs out of one folder, where the runs will be."""
    place = next(path for path in (out.absolute(), *out.absolute().parents) if path.exists())
    try:
        with tempfile.TemporaryFile(dir=place) as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return Finding(
            "wrong",
            "locks",
            f"{place}: {error.strerror}",
            "this file system has none: choose another folder with OUT=",
        )
    return Finding("ok", "locks", "work where runs are kept")


def model_findings() -> Iterator[Finding]:
    """Give a finding a model: every file against its checksum."""
    for name, folder in known_models().items():
        try:
            bundle = open_bundle(folder)
        except InputError as error:
            yield Finding("wrong", f"model {name}", str(error), "copy or export the bundle again")
            continue
        told = f"{len(bundle.files)} files as made" if bundle.files else "whole; it brings no checksums"
        yield Finding("ok", f"model {name}", told)


def self_test(threads: int, model: str = DEFAULT_MODEL) -> Finding:
    """Make a small asset with every stage in a temporary folder, and say the seconds a step of training."""
    with tempfile.TemporaryDirectory(prefix="latent-nerf-doctor-") as scratch:
        asked = Path(scratch, "job.yaml")
        asked.write_text(SELF_TEST, encoding="utf-8")
        began = time.monotonic()
        try:
            job = jobs.resolve({"JOB": str(asked), "MODEL": model})
            run = engine.run_job(job, Path(scratch, "runs"), threads)
        except (InputError, engine.StageFailure) as error:
            return Finding("wrong", "self-test", str(error), "what stands above may be the reason")
        seconds = time.monotonic() - began
        history = json.loads((run / "training.json").read_text(encoding="utf-8"))
    # The first steps compile and warm up.
    pace = float(np.median([sum(row["seconds"].values()) for row in history[len(history) // 3 :]]))
    told = f"an asset of {len(history)} steps in {seconds:.0f} s; {pace:.2f} s a step of train_nerf"
    return Finding("ok", "self-test", told)


def report(findings: Iterator[Finding], say: Callable[[str], None]) -> int:
    """Say every finding; return how many are wrong."""
    wrong = 0
    for finding in findings:
        wrong += finding.state == "wrong"
        say(f"{finding.state:<6} {finding.what}: {finding.found}")
        if finding.mend:
            say(f"{'':<6} -> {finding.mend}")
    return wrong
