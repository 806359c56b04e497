"""The contract of every stage: read files, write files, say how.

A stage is run in the run's folder as
``python -m pipeline.stages.<name> --job job.yaml --input name=path ... --output name=path ...``.
Its module holds pure functions and a thin ``main(context)``, and ends with ``execute("<name>", main)``.
Outputs appear in place only when main has returned, and the entry ``stages/<name>.json`` last of all, so a
kill at any point leaves either the old state or the new one. A stage whose key (see
`pipeline.run.staleness`) is that of its entry, or of a sibling run's, does not run again.
"""

import argparse
import ctypes
import json
import os
import resource
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline import files, progress
from pipeline.errors import InputError
from pipeline.options import job as jobs
from pipeline.options.job import Job
from pipeline.progress import Progress as Progress
from pipeline.progress import say as say
from pipeline.run import staleness
from pipeline.run.chain import stage_options
from pipeline.run.failures import memory_limit

_NO_MEMORY = (
    "alloc_cpu.cpp",  # torch
    "Cannot allocate memory",
    "std::bad_alloc",  # pybind11
    "Failed to allocate memory",  # onnxruntime
    "Insufficient memory",  # OpenCV
    "failed to map segment from shared object",  # the loader of libraries
    "can't start new thread",
)
USER_ERROR = 2
FAILURE = 1
FOLLOW_PARENT = "PIPELINE_FOLLOW_PARENT"
"""Set by the front door: a stage ends with what started it, so that a killed run leaves nothing behind."""


@dataclass(frozen=True)
class Context:
    """What a stage's main works with. Paths are relative to the run's folder, or absolute."""

    job: Job
    inputs: dict[str, Path]
    outputs: dict[str, Path]
    """Where to write: the final names in a temporary folder, moved into place when main returns."""
    scratch: Path
    """Survives a kill and is removed after success: checkpoints. Emptied when the stage's key changes."""
    metrics: dict[str, Any] = field(default_factory=dict)
    """For the manifest (JSON values); ``metrics["warnings"]``, a list of sentences, is shown."""


def execute(name: str, main: Callable[[Context], None]) -> None:
    """Run a stage from the command line and end the process: status 0, 2 for an InputError, 1 for a fault.

    What main, or a library under it, prints goes to logs/<name>.log; progress goes to the caller's standard
    output. A failure leaves its one-line reason in stages/<name>.error.
    """
    arguments = _parse(sys.argv[1:])
    if FOLLOW_PARENT in os.environ:
        die_with_parent()
    run = Path.cwd()
    failed = run / "stages" / f"{name}.error"
    status, reason = 0, ""
    try:
        failed.unlink(missing_ok=True)
        with _diverted_output(run / "logs" / f"{name}.log"):
            try:
                _run(name, main, run, arguments)
            except InputError as error:
                status, reason = USER_ERROR, str(error)
            except OSError as error:
                if not (refused := files.refusal(error)):
                    raise
                status, reason = USER_ERROR, str(refused)
            except Exception as error:
                if not _is_lack_of_memory(error):
                    raise
                status, reason = (
                    USER_ERROR,
                    f"stage {name} ran out of memory at {_peak_memory_mb():.0f} MB{memory_limit()}: close "
                    "other programs, raise the limit, or lower QUALITY (make plan says what is needed)",
                )
    except Exception as error:
        status, reason = (
            FAILURE,
            f"stage {name} failed: {_one_line(error)}; details in {run / 'logs' / name}.log",
        )
    if status:
        try:
            files.write_text(failed, f"{status} {reason}\n")
        except OSError:
            print(f"error: {reason}", file=sys.stderr)  # noqa: T201 (the disk refuses even the reason)
        sys.exit(status)


def _run(name: str, main: Callable[[Context], None], run: Path, arguments: argparse.Namespace) -> None:
    job = jobs.load(arguments.job)
    inputs, outputs = dict(arguments.input), dict(arguments.output)
    options = stage_options(job, name)
    hashes = {}
    for label, path in inputs.items():
        if not path.exists():
            raise InputError(f"stage {name} needs {path} ({label}), which does not exist")
        hashes[label] = files.path_sha256(path)
    key = staleness.key(options, f"pipeline.stages.{name}", hashes)
    entry = staleness.read_entry(run, name)
    if entry and entry["key"] == key and not staleness.damaged(run, entry):
        _touch(run, name, outputs)
        say(f"{name}: unchanged")
        return
    if sibling := staleness.twin(run, name, key):
        _copy(name, run, sibling)
        say(f"{name}: reused from {sibling.name}")
        return

    say(f"{name} ...")
    began = time.monotonic()
    partial = _empty(run / f".partial-{name}")
    context = Context(
        job,
        inputs,
        {label: partial / path for label, path in outputs.items()},
        _scratch(run / "checkpoints" / name, key),
    )
    for path in context.outputs.values():
        path.parent.mkdir(parents=True, exist_ok=True)
    main(context)
    for label, path in context.outputs.items():
        if not path.is_file() or path.stat().st_size == 0:
            raise RuntimeError(f"stage {name} wrote no {label} ({outputs[label]})")
    seconds = time.monotonic() - began
    source, versions = staleness.code(f"pipeline.stages.{name}")
    entry = {
        "stage": name,
        "key": key,
        "source": source,
        "options": options,
        "inputs": {label: {"path": str(path), "sha256": hashes[label]} for label, path in inputs.items()},
        "outputs": {
            label: {"path": str(path), "sha256": files.file_sha256(context.outputs[label])}
            for label, path in outputs.items()
        },
        "versions": versions,
        "seed": job.seed,
        "threads": int(os.environ.get("OMP_NUM_THREADS") or 0),
        "seconds": round(seconds, 3),
        "peak_memory_mb": round(_peak_memory_mb(), 1),
        "metrics": context.metrics,
    }
    text = json.dumps(entry, indent=1, allow_nan=False)
    files.publish([(context.outputs[label], run / path) for label, path in outputs.items()])
    files.write_text(staleness.entry_path(run, name), text + "\n")
    shutil.rmtree(partial)
    shutil.rmtree(context.scratch, ignore_errors=True)
    say(f"{name}: {progress.duration(seconds)}")
    for warning in context.metrics.get("warnings", ()):
        say(f"warning: {warning}")


def _copy(name: str, run: Path, sibling: Path) -> None:
    """Take a sibling run's outputs and entry."""
    entry = staleness.read_entry(sibling, name)
    assert entry is not None
    partial = _empty(run / f".partial-{name}")
    partial.mkdir()
    pairs = []
    for label, output in entry["outputs"].items():
        shutil.copyfile(sibling / output["path"], partial / label)
        pairs.append((partial / label, run / output["path"]))
    files.publish(pairs)
    files.write_text(
        staleness.entry_path(run, name), json.dumps({**entry, "reused_from": sibling.name}, indent=1) + "\n"
    )
    shutil.rmtree(partial)
    for warning in entry["metrics"].get("warnings", ()):
        say(f"warning: {warning}")


def _empty(place: Path) -> Path:
    """Return the place of a temporary folder after removing what an earlier run left there."""
    if place.is_symlink() or place.is_file():
        place.unlink()
    shutil.rmtree(place, ignore_errors=True)
    return place


def _touch(run: Path, name: str, outputs: dict[str, Path]) -> None:
    """Make outputs newer than the inputs, which is how Snakemake judges them."""
    for path in [*(run / path for path in outputs.values()), staleness.entry_path(run, name)]:
        os.utime(path)


def _scratch(folder: Path, key: str) -> Path:
    """Return a stage's scratch folder, emptied unless it was filled under the same key."""
    owner = folder / ".key"
    if not owner.is_file() or owner.read_bytes() != key.encode():
        shutil.rmtree(folder, ignore_errors=True)
        files.write_text(owner, key)
    return folder


@contextmanager
def _diverted_output(log: Path) -> Iterator[None]:
    """Send what anything prints, native libraries included, to the log; progress keeps the old output."""
    sys.stdout.flush()
    sys.stderr.flush()
    saved = os.dup(1), os.dup(2)
    told = os.environ.get(progress.TOLD)
    heard = open(told, "a", encoding="utf-8") if told else os.fdopen(os.dup(1), "w", encoding="utf-8")  # noqa: SIM115
    with files.create(log) as stream, heard as channel:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
        progress.channel = channel
        try:
            yield
        except BaseException:
            traceback.print_exc()
            raise
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            progress.channel = None
            for descriptor, former in zip((1, 2), saved, strict=True):
                os.dup2(former, descriptor)
                os.close(former)


def die_with_parent() -> None:
    """Ask the kernel to kill this process when its parent ends (Linux; elsewhere nothing happens)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def _is_lack_of_memory(error: BaseException) -> bool:
    """Whether an error, or what it came from, says that memory could not be had: each library has its own."""
    while error:
        if isinstance(error, MemoryError) or any(word in str(error) for word in _NO_MEMORY):
            return True
        error = error.__cause__ or error.__context__  # type: ignore[assignment]
    return False


def _peak_memory_mb() -> float:
    """Return the largest resident size so far, of this process or of one it started [MiB]."""
    unit = 1024 if sys.platform == "darwin" else 1  # bytes there, KiB elsewhere
    return (
        max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        / unit
        / 1024
    )


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split()) or "no message"
    return f"{type(error).__name__}: {text if len(text) <= 300 else text[:297] + '...'}"


def _parse(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="One stage; `make run` calls this through Snakemake.")
    parser.add_argument("--job", type=Path, required=True, help="the resolved job")
    parser.add_argument("--input", type=_named_path, action="append", default=[], metavar="NAME=PATH")
    parser.add_argument("--output", type=_named_path, action="append", default=[], metavar="NAME=PATH")
    return parser.parse_args(arguments)


def _named_path(text: str) -> tuple[str, Path]:
    name, separator, path = text.partition("=")
    if not separator or not name or not path:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=PATH")
    return name, Path(path)
