"""Why a run failed, in the words of who asked for it: files have the names that the user gave them."""

import os
import re
import resource
import shutil
from pathlib import Path

from pipeline.errors import InputError
from pipeline.options.job import Job, token_files
from pipeline.options.models import bundle_folder

_NO_REASON = ("Using profile", "host: ", "Building DAG", "Assuming unrestricted")
"""Beginnings of lines that Snakemake writes in any case."""
SYSTEM_PACKAGES = "libgl1 libopengl0"
"""What pymeshlab loads and a minimal Debian does not have."""


class StageFailure(Exception):
    """A fault of the program, not of the input: one line for the user, exit status 1."""


def failure(job: Job, run: Path) -> InputError | StageFailure:
    """Return the reason that a stage left, or the best guess where it could leave none."""
    for path in sorted((run / "stages").glob("*.error"), key=os.path.getmtime):
        code, _, reason = path.read_text(encoding="utf-8").strip().partition(" ")
        reason = as_typed(reason, job, run)
        return InputError(reason) if code == "2" else StageFailure(reason)
    if shutil.disk_usage(run).free < 2**20:
        return InputError(
            f"{run}: no space is left on the device: free some, then give the same command again"
        )
    log = run / "logs" / "snakemake.log"
    said = log.read_text(encoding="utf-8", errors="replace").splitlines() if log.is_file() else []
    said = [line.strip() for line in said if line.strip() and not line.startswith(_NO_REASON)]
    if lacked := [line for line in said if line.startswith("ImportError: ") and "shared object" in line]:
        return InputError(
            f"{lacked[-1].removeprefix('ImportError: ')}; {install_hint()}, then the same command again"
        )
    silent = "Traceback (most recent call last):" in said or not said
    word = f"a stage ended without a word (killed, or out of memory{memory_limit()})" if silent else said[-1]
    return StageFailure(
        f"{word}; see {log.parent}/, then give the same command again: it goes on where it stopped"
    )


def install_hint() -> str:
    """Return what to do about a library of the system that is not there."""
    return f"a library of the system is missing: on Debian, apt-get install {SYSTEM_PACKAGES}"


def memory_limit() -> str:
    """Return the limit of memory that this process was started under, as the end of a sentence; "" if there
    is none."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return "" if limit == resource.RLIM_INFINITY else f": ulimit -v allows {limit >> 20} MB"


def as_typed(reason: str, job: Job, run: Path) -> str:
    """Return what a stage said with its paths, which lead from the run's folder, as the user knows them."""
    bundle = job.model if "/" in job.model else str(bundle_folder(job.model))
    typed = [job.mesh, job.sketch, job.start, *map(str, token_files(job.token)), bundle]
    # What a mesh names, a texture say, lies beside it or below.
    beside = [str(Path(path).parent) for path in (job.mesh, job.start) if path and Path(path).is_file()]
    known = [(path, "(?=/)") for path in beside] + [(path, r"(?![\w-])") for path in typed if path]
    names: dict[str, str] = {}
    patterns: list[str] = []
    for path, after in known:
        relative = os.path.relpath(Path(path).resolve(), run.resolve())
        names[relative] = path
        patterns.append(re.escape(relative) + after)
    patterns.sort(key=len, reverse=True)  # the longest first: it may begin with another
    reason = re.sub(rf"(?<![\w./-])({'|'.join(patterns)})", lambda found: names[found[0]], reason)
    own = re.match(r"[\w.-][\w./-]*", reason)
    if own and not own[0].startswith("..") and (run / own[0]).exists():
        reason = f"{run}/{reason}"
    return reason
