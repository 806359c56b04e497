"""What would happen: which stages run, which need not, and why.

The judgement that a stage makes of itself (`pipeline.run.stage`) is made here beforehand for the whole chain,
from the keys alone. Where a stage will run, the contents of its outputs are not known yet, and neither are
the keys of the stages after it.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pipeline.files import path_sha256
from pipeline.options.job import Job
from pipeline.run import staleness
from pipeline.run.chain import stage_options
from pipeline.run.snakefiles import Link
from pipeline.run.staleness import Entry


@dataclass(frozen=True)
class Step:
    """The judgement of one stage."""

    stage: str
    verdict: Literal["unchanged", "reuse", "run"]
    reason: str


def make_plan(job: Job, run: Path, chain: list[Link]) -> list[Step]:
    """Judge every stage of the chain; `run` need not exist. Reads files, writes none.

    Raises:
        FileNotFoundError: an input that no stage makes does not exist.
    """
    known: dict[str, str] = {}  # sha256 of every file that earlier stages have made, or will copy
    maker = {
        path: link.stage for link in chain for path in [*link.outputs.values(), f"stages/{link.stage}.json"]
    }
    steps = []
    for link in chain:
        module = f"pipeline.stages.{link.stage}"
        pending = {maker[path]: None for path in link.inputs.values() if path in maker and path not in known}
        entry = staleness.read_entry(run, link.stage)
        if pending:
            steps.append(Step(link.stage, "run", f"after {', '.join(pending)}"))
            continue
        hashes = {
            name: known[path] if path in known else path_sha256(_inside(run, path))
            for name, path in link.inputs.items()
        }
        options = stage_options(job, link.stage)
        key = staleness.key(options, module, hashes)
        faults = staleness.damaged(run, entry) if entry else []
        if entry and entry["key"] == key and not faults:
            steps.append(Step(link.stage, "unchanged", ""))
            made = staleness.entry_path(run, link.stage)
            known[f"stages/{link.stage}.json"] = path_sha256(made)
        elif sibling := staleness.twin(run, link.stage, key):
            steps.append(Step(link.stage, "reuse", f"from {sibling.name}"))
            entry = staleness.read_entry(sibling, link.stage)
        else:
            reason = _difference(entry, key, options, module, hashes, faults)
            steps.append(Step(link.stage, "run", reason + _checkpoint(run, link.stage, key)))
            continue
        assert entry is not None
        known |= {output["path"]: output["sha256"] for output in entry["outputs"].values()}
    return steps


def _inside(run: Path, path: str) -> Path:
    """Return a path relative to the run's folder, which need not exist, as an absolute one."""
    return Path(os.path.normpath(run.resolve() / path))


def _difference(
    entry: Entry | None,
    key: str,
    options: dict[str, object],
    module: str,
    hashes: dict[str, str],
    faults: list[str],
) -> str:
    """Say what makes an entry's key differ from the key wanted."""
    if entry is None:
        return "not made yet"
    if entry["key"] == key:
        return ", ".join(faults)
    source, versions = staleness.code(module)
    reasons = []
    if entry.get("options") != options:
        reasons.append("options changed")
    reasons += [
        f"{name} changed"
        for name, value in hashes.items()
        if entry["inputs"].get(name, {}).get("sha256") != value
    ]
    if entry.get("source") != source:
        reasons.append("source changed")
    if entry.get("versions") != versions:
        reasons.append("package versions changed")
    return ", ".join(reasons or ["inputs changed"])


def _checkpoint(run: Path, stage: str, key: str) -> str:
    owner = run / "checkpoints" / stage / ".key"
    resumable = (
        owner.is_file() and owner.read_bytes() == key.encode() and any(owner.parent.glob("*.checkpoint"))
    )
    return ", continues from its checkpoint" if resumable else ""
